//! Values that a unit does not take.

use modlens_protocol::functions::{Functions, StandardLayout};

use crate::claim::{Claim, View, REFUSED_BY_ACCIDENT};
use crate::contrast::RequestCounts;
use crate::observation::RequestKey;
use crate::statistics::{at_least, Share};

/// Whether exception 3 to a request refuses what is written: there is one value, or as many others were taken.
#[allow(clippy::trivially_copy_pass_by_ref)] // Keys stay in their map.
pub(super) fn is_of_value(key: &RequestKey, counts: &RequestCounts) -> bool {
    let kind = Functions::embedded().standard_request(key.function).map(|request| request.kind);
    let is_write = matches!(kind, Some(StandardLayout::WriteOne | StandardLayout::WriteBits | StandardLayout::WriteRegisters));
    is_write && counts.refused_with(3) > counts.refused_with(2) && (key.quantity == 1 || counts.good > 0)
}

/// Writes of values that are refused.
pub(super) fn value_refused(view: &View<'_>) -> Vec<Claim> {
    let all = &view.requests;
    let of_value = all.iter().filter(|(key, counts)| is_of_value(key, counts) && counts.refused_with(3) > 1);
    let claims = of_value.filter_map(|(key, counts)| {
        let share = Share { failed: counts.refused_with(3), total: counts.sent() };
        let chance = view.significant(at_least(share, REFUSED_BY_ACCIDENT))?;
        let taken = if counts.good > 0 { ", and other values were taken" } else { "" };
        let claim = Claim::new("value_refused", &counts.bad, chance).of_unit(key.unit).at(key.function, key.address);
        Some(claim.with_share(share).fact("block", key.block()).fact("taken", taken))
    });
    claims.collect()
}
