//! What the recording cannot tell, and which one could.

use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::claim::{duration, FEW};
use crate::contrast::{BusContrast, RequestCounts};
use modlens_protocol::timestamp::time_text;

const BOTH_DIRECTIONS: &str = "a recording that hears both directions, such as a tap on the line itself";

/// What could not be judged on a bus.
pub(super) fn of_bus(name: &str, bus: &BusContrast) -> Vec<Json> {
    let mut found = Vec::new();
    let mut say = |what: &str, needs: &str| found.push(json!({"bus": name, "what": what, "needs": needs}));
    let requests = bus.requests_seen.total;
    if let Some(lists) = &bus.lists {
        say(&format!("pairs and times: {}", lists.words()), BOTH_DIRECTIONS);
    }
    if requests == 0 && bus.answers_alone() > 1 {
        say("what was asked, and when: no request is in the recording", BOTH_DIRECTIONS);
    } else if requests < FEW {
        say("too few requests for percentages", "a longer recording: ten requests to each unit at least, a hundred are better");
    }
    let silent: u64 = bus.units.values().map(|unit| unit.silent.failed).sum();
    if requests > 0 && requests == silent && bus.frames.of(Verdict::Noise) == 0 {
        say("whether the units answer at all: no answer is in the recording", BOTH_DIRECTIONS);
    }
    let has_times = bus.units.values().any(|unit| unit.response_times.count + unit.waited.count > 0);
    if requests > 0 && !has_times {
        say(
            "pace and timeouts: the recording has no clock, or one that is too coarse",
            "a recording with times of a millisecond or better, such as one of modlens tap",
        );
    }
    if bus.frames.of(Verdict::NoChecksum) > 0 {
        let lack = if bus.frames.of(Verdict::Ok) > 0 { "some frames have no checksum" } else { "the recording has no checksums" };
        say(&format!("damage on the wire: {lack}"), "a recording of the bytes on the wire");
    }
    if bus.facts.mode == Some(Mode::Rtu) && !bus.facts.is_network && bus.facts.char_ns.is_none() && requests > 0 {
        say("bus load: unknown without the line settings", "an option, for example --line 19200-8E1");
    }
    if let Some((from, to, usual)) = hole(bus) {
        let between = if bus.facts.clock == Clock::Utc {
            format!(" from {} to {}", time_text(whole_ms(from)), time_text(whole_ms(to)))
        } else {
            String::new()
        };
        let what = format!(
            "the {}{between}, in which nothing was asked, though otherwise the requests come again within {}: the recording has a \
             hole, its clock was set forward, or the master rested",
            duration(to - from),
            duration(usual)
        );
        say(&what, "a recording without a gap, with a clock that nobody sets");
    }
    let steps: u64 = bus.requests.sorted().iter().map(|(_, counts)| counts.steps_back).max().unwrap_or(0);
    if steps > 0 {
        let times = if steps == 1 { String::from("once") } else { format!("{steps} times") };
        let what = format!("pace and times across the steps of the clock, which went backwards {times}");
        say(&what, "a recording with a clock that nobody sets, such as one of modlens tap");
    }
    found
}

/// Without what is finer than a millisecond: a sentence is for people.
fn whole_ms(time: Ns) -> Ns {
    time - time.rem_euclid(1_000_000)
}

/// Requests that were sent more rarely have no rhythm that a hole could break.
const RHYTHM: u64 = 8;

/// So many times as long as usual is no jitter, and no retry.
const OUT_OF_RHYTHM: Ns = 20;

/// The time without any request that breaks the rhythm of all, from the last start before to the first one after, and the
/// longest usual time from one request to the next of its kind.
///
/// A unit that does not answer is still asked, so a hole is no unit's fault.
fn hole(bus: &BusContrast) -> Option<(Ns, Ns, Ns)> {
    let requests = bus.requests.sorted();
    let rhythmic: Vec<&RequestCounts> =
        requests.iter().map(|(_, counts)| *counts).filter(|counts| counts.period.count >= RHYTHM).collect();
    let pauses = || rhythmic.iter().filter_map(|counts| counts.longest_pause);
    let (from, to) = (pauses().map(|(from, _)| from).max()?, pauses().map(|(_, to)| to).min()?);
    let usual = rhythmic.iter().filter_map(|counts| counts.period.percentile(0.75)).max()?;
    (to > from && (to - from) / OUT_OF_RHYTHM >= usual).then_some((from, to, usual))
}
