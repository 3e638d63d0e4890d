//! Trouble with values whose checksum is right.

use crate::claim::{Claim, View};
use crate::contrast::jumps::JumpKind;
use crate::contrast::{Lonely, RequestCounts};
use crate::observation::RequestKey;
use crate::statistics::{at_least, in_runs_at_most};
use modlens_protocol::finding::Severity;

/// Values that make sense in another order only.
pub(super) fn word_order(view: &View<'_>) -> Vec<Claim> {
    let claims = view.units().filter(|(_, counts)| counts.order_mismatches.failed > 0).map(|(unit, counts)| {
        // The engine names an order only where it is sure of it.
        Claim::new("word_order", &counts.order_mismatches, 0.0).of_unit(unit).at_most(Severity::Warning)
    });
    claims.collect()
}

/// More of the answers than these are a habit of the device.
const MOST: f64 = 0.25;

/// In fewer answers, one that is odd is no jump.
const FEWEST: u64 = 20;

/// Single answers of all FFFF or all 0000, or with the values of another request.
pub(super) fn value_spike(view: &View<'_>) -> Vec<Claim> {
    // Where a gateway mixes up answers, those with the values of another request are its work.
    let is_mixed_up = !view.once("gateway_mixup", super::network::gateway_mixup).is_empty();
    let requests = view.requests.iter().copied();
    let claims = requests.filter(|(_, counts)| !counts.writes).flat_map(|(key, counts)| {
        let ones = (counts.near_ones == 0).then(|| spike(view, *key, &counts.all_ones, "all FFFF")).flatten();
        // A single register of 0 is a value like any other, and so are several where single ones of them are often 0.
        let zeros = key.quantity > 1 && counts.near_zeros == 0;
        let zeros = zeros.then(|| spike(view, *key, &counts.all_zeros, "all 0000")).flatten();
        let other = (!is_mixed_up).then(|| spike(view, *key, &counts.of_another, "those of another request")).flatten();
        let whole = [ones, zeros, other];
        let single = if whole.iter().all(Option::is_none) { registers(view, *key, counts) } else { Vec::new() };
        whole.into_iter().flatten().chain(single)
    });
    claims.collect()
}

/// Single registers that jump to a number without a meaning while the others of their block do not.
fn registers(view: &View<'_>, key: RequestKey, counts: &RequestCounts) -> Vec<Claim> {
    let claims = counts.registers.jumps().filter_map(|jump| {
        let share = jump.odd.share();
        let is_rare = share.rate() <= MOST && share.total >= FEWEST && share.failed >= LEAST_JUMPS;
        if !is_rare || view.significant(in_runs_at_most(share, jump.runs)).is_some() {
            return None;
        }
        // That a register holds just this number by chance, of all that are so far from what it holds otherwise.
        let chance = view.corrected(at_least(share, 1.0 / 32_768.0));
        let address = key.address.saturating_add(jump.register);
        let value = format!("{} ({:04X}) where it is {} to {} else", jump.value, jump.value, jump.others.0, jump.others.1);
        let claim = Claim::new("value_spike", &jump.odd, chance).of_unit(key.unit).at(key.function, address);
        Some(claim.fact("block", format!("address {address}")).fact("value", value).at_most(Severity::Warning))
    });
    claims.chain(sudden(view, key, counts)).collect()
}

/// A register that jumps more often than this for a single read is one that is switched.
const MOST_SUDDEN: f64 = 0.05;

/// A value that changes by chance is this once in so many times.
const SUDDEN_BY_CHANCE: f64 = 1e-4;

/// Registers that jump for single reads to 0, to ten times or a tenth of their value, or to its negative.
fn sudden<'a>(view: &'a View<'_>, key: RequestKey, counts: &'a RequestCounts) -> impl Iterator<Item = Claim> + 'a {
    counts.registers.sudden().filter_map(move |jump| {
        let share = jump.odd.share();
        if share.rate() > MOST_SUDDEN || share.total < FEWEST || share.failed < LEAST_JUMPS {
            return None;
        }
        let chance = view.significant(at_least(share, SUDDEN_BY_CHANCE))?;
        let address = key.address.saturating_add(jump.register);
        let value = match jump.kind {
            JumpKind::Zero => String::from("0"),
            kind => format!("{} the values beside them", kind.words()),
        };
        let claim = Claim::new("value_spike", &jump.odd, chance).of_unit(key.unit).at(key.function, address);
        Some(claim.fact("block", format!("address {address}")).fact("value", value).at_most(Severity::Warning))
    })
}

/// One jump may be anything.
const LEAST_JUMPS: u64 = 2;

fn spike(view: &View<'_>, key: RequestKey, series: &Lonely, value: &'static str) -> Option<Claim> {
    let share = series.odd.share();
    if share.failed == 0 || share.rate() > MOST || share.total < FEWEST {
        return None;
    }
    // Long runs of odd ones are a device without data; jumps are spread as by chance.
    if view.significant(in_runs_at_most(share, series.runs())).is_some() {
        return None;
    }
    // Registers that are not of the device hold anything: the chance that all of them are just this.
    let chance = share.total as f64 * (-16.0 * f64::from(key.quantity) * std::f64::consts::LN_2).exp();
    let claim = Claim::new("value_spike", &series.odd, chance.min(1.0)).of_unit(key.unit).at(key.function, key.address);
    Some(claim.fact("block", key.block()).fact("value", value).at_most(Severity::Warning))
}
