//! What would make a damaged answer right: a byte less, another byte count, a place further on, or inverted levels.

use modlens_engine::line_search::is_inverted;
use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::functions::Functions;
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
    let Some(key) = seen.key() else { return false };
    let rest = match data_length(key.function, key.quantity) {
        Some(count) if matches!(key.function, 1..=4) => vec![count as u8],
        _ => key.address.to_be_bytes().to_vec(),
    };
    is_inverted(&seen.answer_head, &[&[key.unit, key.function], &rest[..]].concat())
}
