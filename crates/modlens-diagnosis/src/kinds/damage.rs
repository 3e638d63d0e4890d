//! Damage, told apart by where in the frame it is and whose frames it hits.

use crate::claim::{Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::observation::DamagedPart;
use crate::statistics::{at_least, fisher, Share};
use modlens_protocol::framing::Verdict;

/// The share of random damage that falls into the first, or the last, two bytes of a frame of eight.
const RANDOM_AT_END: f64 = 0.25;

/// One or two stray bytes where drivers are switched.
pub(super) fn no_bias(view: &View<'_>) -> Vec<Claim> {
    let mut strays = view.bus.noise.strays.clone();
    let turns = view.bus.frames.frames[Verdict::Ok as usize];
    // Strays of other bytes than a driver leaves speak against it.
    if strays.failed * 10 < strays.total * 8 || turns == 0 {
        return Vec::new();
    }
    let share = Share { failed: strays.failed.min(turns), total: turns };
    let Some(chance) = view.beyond_accident(share) else { return Vec::new() };
    (strays.total, strays.before, strays.after) = (turns, 0, 0);
    let sum = |side: usize| -> u64 { view.bus.units.values().map(|counts| counts.strays[side].failed).sum() };
    let sides = match (sum(0), sum(1)) {
        (0, 0) => String::new(),
        (before, after) if after * 9 < before => String::from(", nearly all of them in front of answers"),
        (before, after) if before * 9 < after => String::from(", nearly all of them behind answers"),
        (before, after) => format!(", {before} in front of answers and {after} behind them"),
    };
    vec![Claim::new("no_bias", &strays, chance).with_share(share).fact("sides", sides)]
}

/// Damage in the middle of frames, of more than one unit or in both directions.
pub(super) fn line_noise(view: &View<'_>) -> Vec<Claim> {
    let frames = &view.bus.frames;
    let damaged = frames.frames[Verdict::BadChecksum as usize] + frames.frames[Verdict::Incomplete as usize];
    let good = frames.frames[Verdict::Ok as usize];
    let share = Share { failed: damaged, total: damaged + good };
    let (Some(chance), true) = (view.beyond_accident(share), good > damaged) else { return Vec::new() };
    let inside = parts(view, DamagedPart::Bit) + parts(view, DamagedPart::Inside);
    let known = inside + parts(view, DamagedPart::Start) + parts(view, DamagedPart::End) + parts(view, DamagedPart::Whole);
    let units: Vec<u8> = view.units().filter(|(_, counts)| damage(counts).failed > 0).map(|(unit, _)| unit).collect();
    let requests: u64 = view.units().map(|(_, counts)| counts.bad_requests.failed).sum();
    // Of one unit alone, single bits are noise near it; what else it may be has kinds of its own.
    let is_of_one = units.len() < 2 && requests == 0 && view.units().count() > 1;
    if inside * 3 < known || (is_of_one && parts(view, DamagedPart::Bit) * 3 < known) {
        return Vec::new();
    }
    let tally = view.units().fold(Tally::default(), |mut sum, (_, counts)| {
        sum.merge(&counts.garbled);
        sum.merge(&counts.bad_requests);
        sum
    });
    let mut claim = Claim::new("line_noise", &tally, chance).with_share(share);
    (claim.first, claim.last, claim.has_begun, claim.has_ended) = ends(view);
    let spread = match (units.len(), requests) {
        (_, 0) => String::from("all of them answers"),
        (1, _) => format!("{requests} of them requests"),
        (many, _) => format!("of {many} units, {requests} of them requests"),
    };
    claim = claim.fact("spread", spread);
    if let Some(event) = burst(view) {
        claim = claim.fact("event", event).fact("event_advice", "; what the write switches (a contactor, a pump, an inverter)");
    }
    vec![claim]
}

/// First and last failure of all units, and whether the trouble has begun or ended in between: that of all requests.
fn ends(view: &View<'_>) -> (Option<crate::contrast::tally::Place>, Option<crate::contrast::tally::Place>, bool, bool) {
    let claim = Claim::new("line_noise", &view.bus.requests_seen, 0.0);
    (claim.first, claim.last, claim.has_begun, claim.has_ended)
}

fn parts(view: &View<'_>, part: DamagedPart) -> u64 {
    let of = |counts: &UnitCounts| counts.damaged_parts[part as usize].failed + counts.request_parts[part as usize].failed;
    view.units().map(|(_, counts)| of(counts)).sum()
}

fn damage(counts: &UnitCounts) -> Share {
    counts.garbled.share().with(Share { failed: counts.bad_requests.failed, total: 0 })
}

/// Whether failures come right behind writes.
fn burst(view: &View<'_>) -> Option<String> {
    let sum = |index: usize| view.units().fold(Share::default(), |sum, (_, counts)| sum.with(counts.by_write[index]));
    let (quiet, written) = (sum(0), sum(1));
    view.significant(fisher(written, quiet))?;
    (written.rate() > 3.0 * quiet.rate()).then(|| {
        format!(
            "; right after writes {} of {} requests fail, otherwise {} of {}",
            written.failed, written.total, quiet.failed, quiet.total
        )
    })
}

/// Damage at the first bytes of a unit's answers, or at the last bytes of requests.
pub(super) fn driver_enable(view: &View<'_>) -> Vec<Claim> {
    let answers = view.units().filter_map(|(unit, counts)| {
        let start = &counts.damaged_parts[DamagedPart::Start as usize];
        let chance = at_the_edge(view, start, counts.garbled.share())?;
        let late = "its driver-enable timing: it sends before its own transceiver, or the master's, has turned round; a delay before the answer helps";
        Some(
            Claim::new("driver_enable", start, chance)
                .of_unit(unit)
                .fact("where", "in the first one or two bytes of its answers")
                .fact("what_to_check", format!("Unit {unit}: {late}. Also how long the master holds its driver after a request."))
                .fact("experiment", format!("Set a longer response delay in unit {unit}: the first bytes are whole."))
                .at_most(crate::claim::severity_of(Share { failed: start.failed, total: counts.failures.total })),
        )
    });
    let requests = view.units().fold((Tally::default(), Share::default()), |(mut tally, mut all), (_, counts)| {
        tally.merge(&counts.request_parts[DamagedPart::End as usize]);
        all = all.with(Share { failed: counts.bad_requests.failed, total: counts.failures.total });
        (tally, all)
    });
    let from_master = at_the_edge(view, &requests.0, requests.1).map(|chance| {
        Claim::new("driver_enable", &requests.0, chance)
            .fact("where", "at the end of requests")
            .fact("what_to_check", "The master's adapter: it switches its driver off before the last byte has left (wait for the transmitter to be empty, not for its buffer).")
            .fact("experiment", "Use an adapter that switches by itself: the requests are whole.")
            .at_most(crate::claim::severity_of(requests.1))
    });
    answers.chain(from_master).collect()
}

/// The chance that damage falls to this edge of the frame by accident.
fn at_the_edge(view: &View<'_>, edge: &Tally, damaged: Share) -> Option<f64> {
    if edge.failed * 10 < edge.total * 7 {
        return None;
    }
    view.beyond_accident(damaged)?;
    view.significant(at_least(edge.share(), RANDOM_AT_END))
}

/// The answers of one unit are damaged from the first byte on, and nothing else is.
pub(super) fn duplicate_address(view: &View<'_>) -> Vec<Claim> {
    if view.bus.facts.is_network {
        return Vec::new();
    }
    view.units().filter_map(|(unit, counts)| duplicate(view, unit, counts)).collect()
}

fn duplicate(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let whole = &counts.damaged_parts[DamagedPart::Whole as usize];
    let twice = counts.second_answers.failed;
    let share = Share { failed: (counts.garbled.failed + twice).min(counts.failures.total), total: counts.failures.total };
    // Noise mostly leaves the first bytes as they are.
    if whole.failed * 5 < whole.total * 2 || whole.failed + twice == 0 {
        return None;
    }
    let requests = counts.bad_requests.share();
    let others = view.others(unit, damage);
    // Against the requests of the same unit, and against the other units where there are any.
    let mut chance = fisher(share, Share { failed: requests.failed, total: requests.total });
    if others.total > 0 {
        chance = chance.max(fisher(share, others));
    }
    let chance = view.significant(chance)?;
    if share.rate() < 0.1 || others.rate() * 10.0 > share.rate() {
        return None;
    }
    let tally = if counts.garbled.failed > twice { &counts.garbled } else { &counts.second_answers };
    let clean = match (requests.failed, others.total, others.failed) {
        (0, 0, _) => String::from("its requests are clean"),
        (0, _, 0) => String::from("its requests and all other units are clean"),
        (0, _, other) => format!("its requests are clean; of the other units only {other} answers are damaged"),
        (bad, _, other) => format!("only {bad} of its requests and {other} answers of other units are damaged"),
    };
    Some(Claim::new("duplicate_address", tally, chance).of_unit(unit).with_share(share).fact("clean", clean))
}
