//! Trouble of networks: connections, framings, unit numbers, mixed-up answers.

use crate::claim::{Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::statistics::{at_least, Share};
use modlens_protocol::framing::Mode;

/// Answers that come after the next request, from one moment on.
pub(super) fn lockstep(_view: &View<'_>) -> Vec<Claim> {
    Vec::new()
}

/// Connections that are refused while others are open.
pub(super) fn connection_limit(_view: &View<'_>) -> Vec<Claim> {
    Vec::new()
}

/// Connections that do not last.
pub(super) fn connection_churn(_view: &View<'_>) -> Vec<Claim> {
    Vec::new()
}

/// Requests in RTU on a connection, and no answer in it.
pub(super) fn framing_mismatch(view: &View<'_>) -> Vec<Claim> {
    let requests = &view.bus.requests_seen;
    if !view.bus.facts.is_network || view.bus.facts.mode != Some(Mode::Rtu) {
        return Vec::new();
    }
    let Some(chance) = view.significant(at_least(requests.share(), 0.2)) else { return Vec::new() };
    vec![Claim::new("framing_mismatch", requests, chance).fact("client_framing", "RTU over TCP")]
}

/// A unit number that nobody answers to.
pub(super) fn gateway_unit_id(view: &View<'_>) -> Vec<Claim> {
    let answers = |counts: &UnitCounts| counts.failures.total - counts.failures.failed - unreachable(counts);
    let best = view.units().filter(|(_, counts)| answers(counts) > 0).max_by_key(|(_, counts)| answers(counts));
    let claims = view.units().filter_map(|(unit, counts)| {
        if !view.bus.facts.is_network && unit != 0 {
            return None;
        }
        let share = Share { failed: counts.silent.failed + unreachable(counts), total: counts.failures.total };
        let (other, _) = best.filter(|(other, _)| *other != unit)?;
        if answers(counts) > 0 {
            return None;
        }
        let usual = view.others(unit, |other| other.silent.share()).rate().clamp(0.05, 0.5);
        let chance = view.significant(at_least(share, usual))?;
        Some(
            Claim::new("gateway_unit_id", &counts.failures, chance)
                .of_unit(unit)
                .with_share(share)
                .fact("others", format!(", while unit {other} is answered"))
                .fact("try_unit", other.to_string()),
        )
    });
    claims.collect()
}

/// Refusals of a gateway that cannot reach the unit.
fn unreachable(counts: &UnitCounts) -> u64 {
    counts.exceptions[10].failed + counts.exceptions[11].failed
}

/// Answers with identifier, unit or function of another request.
pub(super) fn gateway_mixup(view: &View<'_>) -> Vec<Claim> {
    if !view.bus.facts.is_network {
        return Vec::new();
    }
    let sum = |of: fn(&UnitCounts) -> Tally| {
        view.bus.units.values().fold(Tally::default(), |mut sum, counts| {
            sum.merge(&of(counts));
            sum
        })
    };
    let units = |counts: &UnitCounts| {
        counts.answered_by.values().fold(Tally::default(), |mut sum, tally| {
            sum.merge(tally);
            sum
        })
    };
    let kinds = [
        ("the transaction identifier", sum(|counts| counts.other_ids.clone())),
        ("the unit", sum(units)),
        ("the function", sum(|counts| counts.other_functions.clone())),
    ];
    let (what, mut tally) = kinds.into_iter().max_by_key(|(_, tally)| tally.failed).expect("three");
    let share = Share { failed: tally.failed, total: view.bus.requests_seen.total.max(tally.failed) };
    let Some(chance) = view.beyond_accident(share) else { return Vec::new() };
    (tally.total, tally.before, tally.after) = (share.total, 0, 0);
    vec![Claim::new("gateway_mixup", &tally, chance).fact("what", what)]
}
