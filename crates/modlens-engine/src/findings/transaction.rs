//! Findings on a transaction: a response compared with its request, an exception, or no response at all.

use crate::findings::{words, Found};
use crate::transactions::transaction::PendingTransaction;
use modlens_protocol::direction::{data_bytes, echo_differences, expected_data_bytes};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::pdu::u16_at;
use modlens_protocol::status::Status;

/// Notes that a request had no response, unless the specification wants none.
pub(crate) fn note_no_response(transaction: &mut PendingTransaction) {
    if transaction.status == Status::NoResponse && !transaction.expects_no_response {
        transaction.findings.push(Finding::NoResponse);
    }
}

/// Notes that the response is an exception.
pub(crate) fn note_exception(transaction: &mut PendingTransaction) {
    if transaction.exception.is_some() {
        transaction.findings.push(Finding::Exception);
    }
}

/// Finds what is odd about a closed transaction, and words what was noted of it before: no response, and an exception.
/// Findings are added to `found`, not to the transaction. A transaction that is read back from a file was checked when it was
/// written; of it only the exception is worded.
pub(crate) fn find(functions: &Functions, transaction: &PendingTransaction, found: &mut Found) {
    if !transaction.is_reimported {
        response(functions, transaction, found);
        if transaction.findings.contains(&Finding::NoResponse) {
            found.push((Finding::NoResponse, words::no_response(transaction.unit, transaction.waited)));
        }
    }
    if let Some(end) = transaction.connection_end {
        found.push((Finding::ConnectionClosed, words::connection_closed(end)));
    }
    if let Some(code) = transaction.exception.filter(|_| transaction.findings.contains(&Finding::Exception)) {
        found.push((Finding::Exception, words::exception(code)));
    }
}

/// The bytes of registers or bits that a good response has, and those that were requested; `None` where the request does not
/// say, and for an exception.
pub(crate) fn response_lengths(functions: &Functions, transaction: &PendingTransaction) -> Option<(usize, usize)> {
    let (request, response) = (transaction.request.pdu(), transaction.response.pdu());
    let is_exception = response.first().is_none_or(|code| code & EXCEPTION_BIT != 0);
    let row = functions.row(*request.first()?, &request[1..]).filter(|_| !is_exception)?;
    data_bytes(row, response).zip(expected_data_bytes(row, request))
}

/// Compares a response with its request: the fields that it must repeat, its length, and, if that is right, the padding
/// following its last bit. Nothing is compared if one of the two is missing or damaged, in an exception, or for an unknown
/// function.
fn response(functions: &Functions, transaction: &PendingTransaction, found: &mut Found) {
    let (request, response) = (transaction.request.pdu(), transaction.response.pdu());
    let is_damaged = transaction.status == Status::BadRequest || !transaction.response.is_good;
    if is_damaged || request.is_empty() || response.is_empty() || response[0] & EXCEPTION_BIT != 0 {
        return;
    }
    let Some(row) = functions.row(request[0], &request[1..]) else { return };
    for (name, requested, answered) in echo_differences(row, request, response) {
        found.push((Finding::EchoMismatch, words::echo_mismatch(name, requested, answered)));
    }
    if let Some((length, expected)) = response_lengths(functions, transaction) {
        if expected != length {
            found.push((Finding::ResponseLength, words::response_length(length, expected)));
        } else if let Some((last, bits)) = set_padding(row.offsets.response_block, row.offsets.quantity, request, response) {
            found.push((Finding::PaddingBits, words::padding_bits(last, bits)));
        }
    }
}

/// The last byte of a response with bits, and how many of its bits were requested, if a bit after those is set. `None` for
/// registers, and where the bits requested fill the last byte. `block` and `quantity` are offsets in the body of the PDU.
fn set_padding(block: Option<(usize, bool)>, quantity: Option<usize>, request: &[u8], response: &[u8]) -> Option<(u8, u16)> {
    let (_, has_bits) = block?;
    let requested_bits = u16_at(&request[1..], quantity?)? % 8;
    let last = *response.last()?;
    (has_bits && requested_bits != 0 && last >> requested_bits != 0).then_some((last, requested_bits))
}
