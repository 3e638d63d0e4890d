//! Findings on a transaction that contradicts the profile of its unit.

use crate::findings::{words, Found};
use crate::transactions::transaction::PendingTransaction;
use modlens_profiles::order_check::Mismatch;
use modlens_profiles::points::Plan;
use modlens_protocol::finding::Finding;
use modlens_protocol::status::Status;

/// Finds a function that the profile does not list. A damaged request may have had any function code, so it is left out.
pub(crate) fn function(plan: &Plan, transaction: &PendingTransaction, found: &mut Found) {
    let device = &plan.profile.device;
    if !device.lists_function(transaction.function) && transaction.status != Status::BadRequest {
        found.push((Finding::UnsupportedFunction, words::unsupported_function(transaction.function, &device.functions)));
    }
}

/// Words a point whose values make sense only in another order of bytes than the profile declares.
pub(crate) fn order(plan: &Plan, mismatch: &Mismatch, found: &mut Found) {
    let compiled = plan.compiled_point(mismatch.compiled_index);
    let declared = plan.point(compiled).order.word();
    let detail = words::order_mismatch(&compiled.name, mismatch.order.word(), declared, &mismatch.reason);
    found.push((Finding::OrderMismatch, detail));
}
