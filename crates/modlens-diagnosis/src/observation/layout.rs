//! What is wrong with a frame whose checksum or header is right, and whose layout is not that of its function.

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::possible_directions;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, StandardLayout, EXCEPTION_BIT};
use modlens_protocol::mbap::PREFIX_BYTES;
use modlens_protocol::oddity;
use modlens_protocol::status::Status;

use super::figures;

/// What is wrong with the layout of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutFault {
    /// The byte count has two bytes.
    WideCount,
    /// The byte count is not that of the bytes that follow.
    WrongCount,
    /// The length field of the MBAP header is wrong.
    HeaderLength,
    /// The two bytes of the checksum are swapped.
    SwappedChecksum,
    /// Bytes follow the frame that the MBAP header announces.
    BytesAfter,
    /// An exception response without its code.
    NoExceptionCode,
    /// The request: its byte count, quantity and data do not agree.
    Request,
    /// Something else.
    Other,
}

/// The fault of the answer in a row with these findings, or of a request that no master sends. `None` where the layout is right, or the bytes are
/// damaged.
pub(super) fn layout_fault(batch: &Batch, row: &Transaction, has: impl Fn(Finding) -> bool) -> Option<LayoutFault> {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    let is_odd = has(Finding::LengthMismatch) || has(Finding::MbapLength);
    let pdu = row.request.pdu.of(&batch.arena);
    if is_odd && row.status != Status::BadRequest && !pdu.is_empty() && !is_request(pdu) {
        return Some(if has_count(pdu[0]) { LayoutFault::Request } else { LayoutFault::Other });
    }
    if has(Finding::MbapLength) {
        let odd = if answer.is_empty() { request } else { answer };
        let is_right = figures::of_header(odd).is_some_and(|[announced, present]| announced == present);
        return Some(match odd.get(PREFIX_BYTES + 1..) {
            Some([function]) if is_right && function & EXCEPTION_BIT != 0 => LayoutFault::NoExceptionCode,
            Some([function, ..]) if is_right && counts_bytes(*function) => LayoutFault::WrongCount,
            _ if is_right => LayoutFault::Other,
            _ if figures::added(odd).is_some() => LayoutFault::BytesAfter,
            _ => LayoutFault::HeaderLength,
        });
    }
    if row.mode != Mode::Rtu {
        return None;
    }
    match row.status {
        Status::BadResponse if oddity::is_swapped(answer) => Some(LayoutFault::SwappedChecksum),
        // What is too short for its function ends with the checksum of what is there.
        Status::BadResponse | Status::Unsolicited if has(Finding::Incomplete) && crc_valid(answer) => Some(match answer {
            [_, function, _, _] if function & EXCEPTION_BIT != 0 => LayoutFault::NoExceptionCode,
            [_, function, ..] if counts_bytes(*function) => count_fault(answer),
            _ => LayoutFault::Other,
        }),
        Status::BadRequest if oddity::is_swapped(request) => Some(LayoutFault::SwappedChecksum),
        Status::Ok if has(Finding::LengthMismatch) && is_read(answer) => {
            Some(count_fault(answer)).filter(|fault| *fault != LayoutFault::Other)
        }
        Status::Ok | Status::Exception => None,
        _ if has(Finding::LengthMismatch) && crc_valid(answer) && !counts_bytes(answer[1]) => Some(LayoutFault::Other),
        _ if has(Finding::LengthMismatch) && crc_valid(answer) => Some(count_fault(answer)),
        // An answer with a wide byte count and one register looks like a request for far too many.
        _ if has(Finding::QuantityLimit) && crc_valid(request) && has_wide_count(request) => Some(LayoutFault::WideCount),
        _ => None,
    }
}

/// Whether a request of this function has a byte count.
fn has_count(function: u8) -> bool {
    matches!(function, 0x0F | 0x10 | 0x17)
}

/// Whether a PDU may be a request by its layout: its quantity, its byte count and its data agree.
fn is_request(pdu: &[u8]) -> bool {
    pdu[0] & EXCEPTION_BIT != 0 || possible_directions(Functions::embedded(), pdu).0
}

/// What is wrong with the byte count of an answer, its checksum included.
fn count_fault(answer: &[u8]) -> LayoutFault {
    match body(answer) {
        _ if has_wide_count(answer) => LayoutFault::WideCount,
        Some([count, data @ ..]) if usize::from(*count) != data.len() => LayoutFault::WrongCount,
        _ => LayoutFault::Other,
    }
}

/// Whether an answer of this function begins with a byte count.
fn counts_bytes(function: u8) -> bool {
    matches!(function, 1..=4 | 0x0C | 0x11 | 0x14 | 0x15 | 0x17)
}

/// The layout of a function that reads coils or registers.
fn read_of(function: u8) -> Option<StandardLayout> {
    let layout = Functions::embedded().standard_request(function)?.kind;
    matches!(layout, StandardLayout::ReadBits | StandardLayout::ReadRegisters | StandardLayout::ReadWriteRegisters)
        .then_some(layout)
}

/// Whether an answer is one to a read of coils or registers.
fn is_read(answer: &[u8]) -> bool {
    answer.get(1).is_some_and(|function| read_of(*function).is_some()) && crc_valid(answer)
}

/// What stands between the function code and the checksum.
fn body(frame: &[u8]) -> Option<&[u8]> {
    frame.get(2..frame.len().checked_sub(2)?)
}

/// Whether a frame is an answer to a read whose byte count has two bytes.
fn has_wide_count(frame: &[u8]) -> bool {
    matches!(body(frame), Some([0, count, data @ ..]) if !data.is_empty() && usize::from(*count) == data.len() && read_of(frame[1]).is_some())
}

/// The bytes of an RTU answer to a request for so many: unit, function, byte count, data and checksum; eight where a write is
/// confirmed (section 6 of the application protocol). `None` of other functions.
pub(crate) fn answer_length(function: u8, quantity: u16) -> Option<u32> {
    let data = data_length(function, quantity).map(|data| data + 5);
    data.or_else(|| is_write(function).then_some(WRITE_ANSWER))
}

/// The length of the answer to a write of one or several.
const WRITE_ANSWER: u32 = 8;

fn is_write(function: u8) -> bool {
    let kind = Functions::embedded().standard_request(function).map(|request| request.kind);
    matches!(kind, Some(StandardLayout::WriteOne | StandardLayout::WriteBits | StandardLayout::WriteRegisters))
}

/// The bytes of the data that a read of so many asks for.
pub(crate) fn data_length(function: u8, quantity: u16) -> Option<u32> {
    let read = read_of(function)?;
    Some(if read == StandardLayout::ReadBits { u32::from(quantity).div_ceil(8) } else { 2 * u32::from(quantity) })
}

/// Whether an answer of this length lacks the byte count of what was asked for: unit, function, data and checksum are all.
pub(crate) fn lacks_count(length: u32, function: u8, quantity: u16) -> bool {
    data_length(function, quantity).is_some_and(|data| length == data + 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_byte_count_is_found_wrong() {
        // Answers to function 3, with any checksum: a count of two bytes, and one that counts registers.
        assert_eq!(count_fault(&[1, 3, 0, 4, 0, 1, 0, 2, 0xAA, 0xBB]), LayoutFault::WideCount);
        assert_eq!(count_fault(&[1, 3, 2, 0, 1, 0, 2, 0xAA, 0xBB]), LayoutFault::WrongCount);
        // Four registers without a count: 4 bytes around 8 of data.
        assert!(lacks_count(12, 3, 4) && !lacks_count(13, 3, 4) && lacks_count(6, 1, 16) && !lacks_count(8, 6, 1));
    }
}
