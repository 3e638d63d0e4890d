//! What would make a damaged answer right: a byte less, another byte count, a place further on, inverted levels, or bits that are
//! missing throughout.

use modlens_engine::line_search::is_inverted;
use modlens_protocol::checksum::{crc16, crc_valid, CRC_BYTES};
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::parse_hex;
use modlens_protocol::mbap::layout_fits;
use modlens_protocol::oddity::{is_of_driver, lacks_last};

use crate::observation::{answer_length, data_length, Figures, Observation};

/// The length of the answer to the request on a serial line.
pub(super) fn due(seen: &Observation) -> Option<u32> {
    seen.key().and_then(|key| answer_length(key.function, key.quantity))
}

/// The byte count of a damaged answer, and the one that was due, where the first is greater and the answer has the length that the
/// second announces. With one byte too many, the first half of the checksum is there, and has to fit.
pub(super) fn counted_more(seen: &Observation) -> Option<Figures> {
    let [_, 1..=4, count, ..] = *seen.answer_head.as_slice() else { return None };
    let asked = seen.key().and_then(|key| data_length(key.function, key.quantity))?;
    let is_as_due = due(seen) == Some(seen.lengths[1]) && u32::from(count) > asked;
    let is_right = u32::from(count) > asked + 1 || lacks_last(&seen.answer_head);
    (is_as_due && is_right).then_some([count.into(), asked])
}

/// The byte count of an answer in ASCII to a read, and the one that was due, where the two differ.
pub(super) fn announced(seen: &Observation) -> Option<Figures> {
    let digits = seen.answer_head.strip_prefix(b":")?.get(..ANNOUNCING)?;
    let bytes = parse_hex(std::str::from_utf8(digits).ok()?)?;
    let [unit, function @ 1..=4, count] = *bytes.as_slice() else { return None };
    let asked = seen.key().and_then(|key| data_length(key.function, key.quantity))?;
    let differs = (unit, function) == (seen.unit, seen.function) && u32::from(count) != asked;
    differs.then_some([count.into(), asked])
}

/// The digits of unit, function and byte count.
const ANNOUNCING: usize = 6;

/// The byte that a damaged answer has too many, and its place counted from 1: without it the answer has the layout of its function and
/// a right checksum, or, of bytes that a line leaves, the first half of one, where the reader has stopped before the second.
pub(super) fn added_byte(seen: &Observation) -> Option<Figures> {
    let bytes = Some(&seen.answer_head).filter(|bytes| bytes.len() == seen.lengths[1] as usize)?;
    let is_stray = |at: &usize| is_of_driver(bytes[*at]) && bytes[*at] != bytes[at - 1];
    let are_few = (2..bytes.len()).filter(is_stray).count() <= MOST_STRAYS;
    let fits = |at: usize| {
        let rest = [&bytes[..at], &bytes[at + 1..]].concat();
        let is_whole = || layout_fits(Functions::embedded(), &rest[1..rest.len() - CRC_BYTES]);
        (are_few && is_stray(&at) && lacks_last(&rest)) || (crc_valid(&rest) && is_whole())
    };
    let at = (2..bytes.len()).find(|at| bytes.len() > LEAST_ANSWER && fits(*at))?;
    Some([bytes[at].into(), at as u32 + 1])
}

/// Half a checksum fits once in 256 times by chance, and is tried without so many bytes.
const MOST_STRAYS: usize = 6;

/// The shortest answer with data, a byte too many included.
const LEAST_ANSWER: usize = 6;

/// How many bytes are in front of the unit and the function of an answer, where the last of them are those of a line that nobody
/// drives, and what follows has room for the answer.
pub(super) fn place_behind_strays(seen: &Observation) -> Option<u32> {
    let bytes = &seen.answer_head;
    let is_idle = |byte: &u8| is_of_driver(*byte) || byte.count_ones() >= 6;
    let has_room = |at: usize| due(seen).is_none_or(|due| at as u32 + due <= seen.lengths[1]);
    let begins =
        |at: &usize| bytes[*at..].starts_with(&[seen.unit, seen.function]) && bytes[at - LEAST_STRAYS..*at].iter().all(is_idle);
    (LEAST_STRAYS..bytes.len()).filter(begins).find(|at| has_room(*at)).map(|at| at as u32)
}

/// So many bytes in front of an answer are a run.
const LEAST_STRAYS: usize = 3;

/// Whether what came is the beginning of the answer that is due, as far as the request shows it, as swapped wires change it.
pub(super) fn is_on_swapped_wires(seen: &Observation) -> bool {
    beginning(seen).is_some_and(|head| is_inverted(&seen.answer_head, &head))
}

/// Whether what came is the request, as swapped wires change it: whole, or so much of it that it is no answer. The confirmation of a
/// write of one value has the same bytes.
pub(super) fn is_request_on_swapped_wires(seen: &Observation) -> bool {
    let request = &seen.request_head;
    let is_unlike_answer = |length: usize| beginning(seen).is_some_and(|head| !request[..length].starts_with(&head));
    (LEAST_OF_REQUEST..=request.len())
        .any(|length| is_unlike_answer(length) && is_inverted(&seen.answer_head, &request[..length]))
}

/// Fewer bytes of a request may as well begin its answer.
const LEAST_OF_REQUEST: usize = 5;

/// How the answer to the request begins: unit, function, and byte count or address.
fn beginning(seen: &Observation) -> Option<Vec<u8>> {
    let key = seen.key()?;
    let rest = match data_length(key.function, key.quantity) {
        Some(count) if matches!(key.function, 1..=4 | READ_WRITE) => vec![count as u8],
        _ => key.address.to_be_bytes().to_vec(),
    };
    Some([&[key.unit, key.function], &rest[..]].concat())
}

/// Whether the answer to a read is whole but for the two bytes of its checksum.
pub(super) fn lacks_checksum_only(seen: &Observation) -> bool {
    if let [unit, READ_FIFO, high, low, ..] = *seen.answer_head.as_slice() {
        // What is in the queue, the answer alone says.
        let count = u32::from(u16::from_be_bytes([high, low]));
        return (unit, READ_FIFO) == (seen.unit, seen.function) && count >= 2 && seen.lengths[1] == FIFO_HEAD + count;
    }
    let is_read = matches!(seen.function, 1..=4 | READ_WRITE);
    is_read
        && due(seen) == Some(seen.lengths[1] + CRC_BYTES as u32)
        && beginning(seen).is_some_and(|head| seen.answer_head.starts_with(&head))
}

/// Functions whose answers have data, besides the four that read.
const READ_WRITE: u8 = 23;
const READ_FIFO: u8 = 24;

/// The bytes of an answer with a queue that are in front of what its byte count counts: unit, function and the count itself.
const FIFO_HEAD: u32 = 4;

/// The bits of a byte without the highest one.
const SEVEN: u8 = 0x7F;

/// Whether no byte of an answer has its highest bit, and its checksum is right with that bit in some bytes of its data: in any of a few,
/// or in one of many, so that chance makes it so once in sixty times at most.
pub(super) fn lacks_highest_bits(seen: &Observation) -> bool {
    let Some((head, bytes)) = as_long_as_due(seen).filter(|(_, bytes)| bytes.iter().all(|byte| *byte <= SEVEN)) else {
        return false;
    };
    let Some((body, there)) = bytes.split_last_chunk::<CRC_BYTES>() else { return false };
    let right = |body: &[u8]| crc16(body).to_le_bytes().map(|byte| byte & SEVEN) == *there;
    let whole = [&head[..], &body[head.len()..]].concat();
    let places: Vec<usize> = (head.len()..whole.len()).collect();
    let fits_with = |raised: &mut dyn Iterator<Item = usize>| {
        let mut whole = whole.clone();
        raised.for_each(|at| whole[at] |= !SEVEN);
        right(&whole)
    };
    if places.len() > MOST_BITS {
        return fits_with(&mut std::iter::empty()) || places.iter().any(|at| fits_with(&mut std::iter::once(*at)));
    }
    (0..1_u32 << places.len())
        .any(|chosen| fits_with(&mut places.iter().copied().filter(|at| chosen >> (at - head.len()) & 1 == 1)))
}

/// All bits of so many bytes are tried.
const MOST_BITS: usize = 8;

/// Whether what came is the answer in seven bits, with a parity bit as the highest of each byte.
pub(super) fn has_parity_bits(seen: &Observation) -> bool {
    let Some((_, bytes)) = as_long_as_due(seen) else { return false };
    let is_odd = |byte: &u8| byte.count_ones() % 2 == 1;
    bytes.iter().all(is_odd) || !bytes.iter().any(is_odd)
}

/// How the answer begins, and what came, where it is as long as what is due and the same in the lower bits.
fn as_long_as_due(seen: &Observation) -> Option<(Vec<u8>, &[u8])> {
    let (head, bytes) = (beginning(seen)?, &seen.answer_head[..]);
    let is_whole =
        bytes.len() == seen.lengths[1] as usize && due(seen) == Some(seen.lengths[1]) && bytes.len() > head.len() + CRC_BYTES;
    let is_alike = head.iter().zip(bytes).all(|(one, other)| one & SEVEN == other & SEVEN);
    (is_whole && is_alike).then_some((head, bytes))
}
