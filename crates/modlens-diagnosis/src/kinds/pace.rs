//! Trouble with pace: too soon, in pieces, too much.

use crate::claim::{duration, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::statistics::{fisher, Share};
use modlens_protocol::finding::Severity;

/// A unit that fails after short silences and answers after longer ones.
pub(super) fn polled_too_fast(view: &View<'_>) -> Vec<Claim> {
    view.units().filter_map(|(unit, counts)| too_fast(view, unit, counts)).collect()
}

fn too_fast(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let splits = counts.by_gap.splits();
    let count = splits.len() as f64;
    let likeliest = splits.into_iter().map(|(limit, below, above)| (fisher(below, above) * count, limit, below, above));
    let (chance, limit, below, above) = likeliest.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let chance = view.significant(chance)?;
    if below.rate() < 3.0 * above.rate() || explained_by_previous(counts, below, above) {
        return None;
    }
    let words = |share: Share| format!("{} of {} requests", share.failed, share.total);
    Some(
        Claim::new("polled_too_fast", &counts.failures, chance)
            .of_unit(unit)
            .with_share(below)
            .fact("limit", duration(limit))
            .fact("short", words(below))
            .fact("long", words(above)),
    )
}

/// Whether the unit asked before tells failures from successes better than the silence does.
fn explained_by_previous(counts: &UnitCounts, below: Share, above: Share) -> bool {
    let all = counts.failures.share();
    let best = counts.by_previous.values().map(|inside| fisher(*inside, all.without(*inside))).fold(1.0, f64::min);
    best < fisher(below, above)
}

/// Pauses inside of requests that make them fail.
pub(super) fn gaps_in_frames(view: &View<'_>) -> Vec<Claim> {
    let claims = view.units().filter_map(|(unit, counts)| {
        let [without, with] = counts.by_pause;
        let chance = view.significant(fisher(with, without))?;
        let words = |share: Share| format!("{} of {}", share.failed, share.total);
        (with.rate() > 2.0 * without.rate()).then(|| {
            Claim::new("gaps_in_frames", &counts.failures, chance)
                .of_unit(unit)
                .with_share(with)
                .fact("what", format!("requests fail with a pause inside {}, without one {}", words(with), words(without)))
        })
    });
    let failing: Vec<Claim> = claims.collect();
    if failing.is_empty() {
        return in_pieces(view);
    }
    failing
}

/// A sender whose frames come in pieces while those of others do not, though nobody fails for it.
fn in_pieces(view: &View<'_>) -> Vec<Claim> {
    let sum = |side: usize| {
        view.bus.units.values().fold(Tally::default(), |mut sum, counts| {
            sum.merge(&counts.pauses[side]);
            sum
        })
    };
    let [requests, answers] = [sum(0), sum(1)];
    let words = |share: Share| format!("{} of {}", share.failed, share.total);
    let claim = |tally: &Tally, others: Share, chance: f64, sender: String| {
        Claim::new("gaps_in_frames", tally, chance)
            .at_most(Severity::Info)
            .fact("what", format!("frames of {sender} come in pieces: {}, of others {}", words(tally.share()), words(others)))
    };
    // The master's requests against all answers, and each unit's answers against all other frames.
    if let Some(chance) = view.significant(fisher(requests.share(), answers.share())).filter(|_| requests.share().rate() > 0.01) {
        return vec![claim(&requests, answers.share(), chance, String::from("the master"))];
    }
    let all = requests.share().with(answers.share());
    let of_units = view.bus.units.iter().filter_map(|(unit, counts)| {
        let own = counts.pauses[1].share();
        let chance = view.significant(fisher(own, all.without(own)))?;
        (own.rate() > 0.01 && own.rate() > 3.0 * all.without(own).rate())
            .then(|| claim(&counts.pauses[1], all.without(own), chance, format!("unit {unit}")).of_unit(*unit))
    });
    of_units.collect()
}

/// From this share of the time on, a line is full.
const FULL: f64 = 0.7;

/// Frames and response times that fill the time.
pub(super) fn bus_saturated(view: &View<'_>) -> Vec<Claim> {
    let frames = &view.bus.frames;
    let (Some(char_ns), Some((first, last)), false) = (view.bus.facts.char_ns, frames.span, view.bus.facts.is_network) else {
        return Vec::new();
    };
    let busy = frames.bytes.iter().sum::<u64>() as f64 * char_ns as f64;
    let span = (last - first) as f64;
    if view.bus.requests_seen.total < 30 || busy < FULL * span {
        return Vec::new();
    }
    let share = Share { failed: (busy.min(span) / 1e6) as u64, total: (span / 1e6) as u64 };
    let heaviest =
        view.bus.requests.sorted().into_iter().max_by_key(|(key, counts)| (counts.sent() * u64::from(key.quantity), **key));
    let most = heaviest.map_or(String::new(), |(key, counts)| {
        format!("; most of it is unit {}, {} registers from {} on, {} times", key.unit, key.quantity, key.address, counts.sent())
    });
    let mut claim = Claim::new("bus_saturated", &view.bus.requests_seen, 0.0).with_share(share).fact("most", most);
    (claim.has_begun, claim.has_ended, claim.examples) = (false, false, Vec::new());
    vec![claim]
}
