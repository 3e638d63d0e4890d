//! Findings on a request or response in relation to the frames before it: repeated, late, duplicated, from a second
//! master. `pairing` decides what a frame is; here that becomes a finding on the transaction, on the frame at hand, or on a
//! frame whose row is already written.

use crate::transactions::result::{DelayedFinding, FrameLocation, Overlap, PairingResult};
use crate::transactions::transaction::PendingTransaction;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::{Functions, Operation};

/// Notes a finding on a transaction; it is also shown on the frame at hand.
fn note(transaction: &mut PendingTransaction, result: &mut PairingResult, finding: Finding) {
    transaction.findings.push(finding);
    result.finding = Some(finding);
}

/// The request repeats that of an earlier transaction without response.
pub(crate) fn retry(transaction: &mut PendingTransaction, result: &mut PairingResult, repeated_txn: u64) {
    note(transaction, result, Finding::Retry);
    result.other = Some(repeated_txn);
}

/// Finds a read that is sent to all units, to which none responds; whether it is one.
pub(crate) fn broadcast(functions: &Functions, transaction: &mut PendingTransaction, result: &mut PairingResult) -> bool {
    let body = transaction.request.pdu().get(1..).unwrap_or(&[]);
    let is_read = functions.row(transaction.function, body).is_some_and(|row| row.operation == Operation::Read);
    if is_read {
        note(transaction, result, Finding::BroadcastRead);
    }
    is_read
}

/// The open request was echoed by the adapter.
pub(crate) fn note_echo(open: &mut PendingTransaction) {
    open.findings.push(Finding::LocalEcho);
}

/// The frame at hand is the echo of the request of this transaction.
pub(crate) fn echo(txn: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::LocalEcho), other: Some(txn) }
}

/// Finds a response that carries another transaction identifier than its request.
pub(crate) fn transaction_id(transaction: &mut PendingTransaction, result: &mut PairingResult, response_id: Option<u16>) {
    if response_id.is_some() && transaction.mbap_id != response_id {
        note(transaction, result, Finding::TransactionId);
    }
}

/// Finds a response with the transaction identifier of its request, but from another unit. To a broadcast, any unit responds.
pub(crate) fn other_unit(transaction: &mut PendingTransaction, result: &mut PairingResult, unit: u8) {
    if transaction.unit != unit && !transaction.findings.contains(&Finding::BroadcastRead) {
        note(transaction, result, Finding::WrongUnit);
        result.other = Some(transaction.txn);
    }
}

/// Two transactions overlap, and by now it is proven that two masters sent their requests. `transaction` is the one whose
/// response is at hand.
///
/// If it is one of the two, the finding is noted on it and in `result`, unless the frame has one already, and `None` is
/// given. The other transaction is named only in that of the later one. If it is neither, a delayed finding on the response
/// to the first is given.
pub(crate) fn two_masters(
    overlap: &Overlap,
    transaction: &mut PendingTransaction,
    result: &mut PairingResult,
) -> Option<DelayedFinding> {
    let (first_txn, later_txn) = (overlap.response.txn, overlap.later_txn);
    if first_txn != transaction.txn && later_txn != transaction.txn {
        return Some(DelayedFinding { finding: Finding::TwoMasters, location: overlap.response, other_txn: later_txn });
    }
    if result.finding.is_none() {
        note(transaction, result, Finding::TwoMasters);
        result.other = (later_txn == transaction.txn).then_some(first_txn);
    }
    None
}

/// Two transactions overlap without proof of two masters: the response to the first one came late.
pub(crate) fn unproven_overlap(overlap: &Overlap) -> DelayedFinding {
    DelayedFinding { finding: Finding::LateResponse, location: overlap.response, other_txn: overlap.later_txn }
}

/// The response was taken for that of another unit's request: it came from the wrong unit.
pub(crate) fn wrong_unit(transaction: &mut PendingTransaction, request_txn: u64) -> DelayedFinding {
    transaction.findings.push(Finding::WrongUnit);
    let (frame, start) = (transaction.response.number, transaction.response.start);
    let (txn, unit, origin) = (transaction.txn, transaction.unit, transaction.origin);
    let location = FrameLocation { txn, frame, unit, start, origin };
    DelayedFinding { finding: Finding::WrongUnit, location, other_txn: request_txn }
}

/// No request is known that the response answers.
pub(crate) fn unsolicited(txn: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::Unsolicited), other: None }
}

/// The response answers the request of `other`, whose timeout has passed.
pub(crate) fn late(txn: u64, other: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::LateResponse), other: Some(other) }
}

/// The response repeats the one before it.
pub(crate) fn duplicate(txn: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::Duplicate), other: None }
}

/// The response has the identifier of the one before it, to transaction `other`, and other content.
pub(crate) fn conflicting(txn: u64, other: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::ConflictingResponse), other: Some(other) }
}

/// The response comes from the unit of the open request `other`, but has another function.
pub(crate) fn wrong_function(txn: u64, other: u64) -> PairingResult {
    PairingResult { txn: Some(txn), finding: Some(Finding::WrongFunction), other: Some(other) }
}
