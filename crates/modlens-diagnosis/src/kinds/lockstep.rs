//! Answers that come one request late, or a few, from one moment on: each is taken for that of a later request.

use super::network;
use crate::claim::{Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::Symptom;
use crate::observation::MOST_LAG;
use crate::statistics::{at_least, in_runs_at_most, Share};

/// Answers that the client takes for those of the next request.
pub(super) fn lockstep(view: &View<'_>) -> Vec<Claim> {
    let on_lines = view.units().filter_map(|(unit, counts)| {
        let (behind, bits, lag) = counts.epochs.behind();
        // The evidence may begin after any of the requests.
        let chance = view.significant(behind.total as f64 * (-(bits as f64)).exp2()).filter(|_| behind.failed > 0)?;
        Some(of_master(Claim::new("lockstep", &behind, chance), unit, lag))
    });
    let on_lines: Vec<Claim> = on_lines.chain(by_length(view)).collect();
    if !on_lines.is_empty() {
        return on_lines;
    }
    if let Some(claim) = behind_in_log(view) {
        return vec![claim];
    }
    let counts = &view.bus.connections;
    let share = Share { failed: counts.lockstep.min(counts.answers), total: counts.answers };
    let Some(chance) = view.beyond_accident(share).filter(|_| !mixes_clients_up(view)) else { return Vec::new() };
    // A client is out of step from an answer on that came too late; how many were in step before is not counted.
    let (first, last) = (counts.lockstep_since, counts.lockstep_until);
    let after = counts.answers_in_step.min(share.total - share.failed);
    let tally = Tally { failed: share.failed, total: share.total, first, last, after, ..Tally::default() };
    let mut claim = of_client(Claim::new("lockstep", &tally, chance).with_share(share));
    claim.has_begun = true;
    vec![claim]
}

/// Answers of another length than asked for that are as long as the request before asks for, some of them longer and some shorter
/// than their own: each fits the request before, and no unit that has its own idea of lengths gives such. From the first on most
/// answers are so; where only some are, the unit is slow now and then.
fn by_length<'a>(view: &'a View<'_>) -> impl Iterator<Item = Claim> + 'a {
    view.units().filter_map(|(unit, counts)| {
        let (lag, [shorter, longer]) = (1..).zip(&counts.as_long_as_before).max_by_key(|(lag, sides)| {
            // Of several earlier requests that fit as often, it is the last one.
            (sides.iter().map(|tally| tally.failed).sum::<u64>(), std::cmp::Reverse(*lag))
        })?;
        let share = shorter.share().with(longer.share());
        let garbled = &counts.garbled;
        let window = garbled.total - garbled.before - garbled.after;
        let is_constant = garbled.failed * 10 > window * 6;
        let is_sure = shorter.failed.min(longer.failed) >= 3 && share.rate() >= 0.9;
        if counts.epochs.behind().0.failed > 0 || !is_constant || !is_sure {
            return None;
        }
        // Of the lengths that are asked for, one of two is right by chance.
        let chance = view.significant(MOST_LAG as f64 * at_least(share, 0.5))?;
        let behind = |(symptom, of, _): &(Symptom, Option<u8>, _)| (*symptom, *of) == (Symptom::OtherLength, Some(unit));
        let (_, _, seen) = view.bus.symptoms.all().find(behind)?;
        let all = Share { failed: seen.all.failed, total: counts.failures.total.max(seen.all.failed) };
        Some(of_master(Claim::new("lockstep", &seen.all, chance).with_share(all), unit, lag))
    })
}

/// Puts into words that a master takes each answer of a unit for that of a request so many before it.
fn of_master(claim: Claim, unit: u8, lag: usize) -> Claim {
    let (steps, request) = STEPS[lag - 1];
    let claim = claim.of_unit(unit).fact("subject", format!("the master of unit {unit}"));
    claim.fact("steps", steps).fact("request", request)
}

/// How far an answer is late, and which request it answers.
const STEPS: [(&str, &str); MOST_LAG] = [
    ("one step late", "the request before"),
    ("two steps late", "the request before the last one"),
    ("three steps late", "the third request before"),
];

/// Puts into words that a client takes answers for those of later requests.
fn of_client(claim: Claim) -> Claim {
    claim.fact("subject", "the client").fact("steps", "out of step").fact("request", "an earlier request than their own")
}

/// Whether several clients get answers that are not theirs, at least half as often as one that belongs to the request before.
fn mixes_clients_up(view: &View<'_>) -> bool {
    let lockstep = view.bus.connections.lockstep;
    network::has_several_clients(view)
        && view.once("gateway_mixup", network::gateway_mixup).iter().any(|mixed| mixed.harm * 2 > lockstep)
}

/// A shorter run of answers that come after the next request may be that of a slow unit.
const LONG_LOCKSTEP: u64 = 5;

/// In a client's log, from one line on each answer comes after the next request. A client that asks ahead by intention does so
/// from the beginning on.
fn behind_in_log(view: &View<'_>) -> Option<Claim> {
    let runs = &view.bus.step_runs;
    let share = Share { failed: runs.failures(), total: runs.total() };
    if view.bus.facts.is_network || runs.begins_failed() || runs.longest < LONG_LOCKSTEP || runs.in_long() * 10 < share.failed * 8
    {
        return None;
    }
    let chance = view.significant(in_runs_at_most(share, runs.count_of_long() + share.failed - runs.in_long()))?;
    let tally = Tally { total: share.total, ..view.bus.steps_behind.clone() };
    let mut claim = of_client(Claim::new("lockstep", &tally, chance).with_share(share));
    claim.has_begun = true;
    Some(claim)
}
