//! Which part of a damaged frame is damaged: the checksum shows it, if the rest is right.

use modlens_engine::records::{Batch, Frame, Transaction};
use modlens_protocol::checksum::{correctable_bit, crc16, crc_valid};
use modlens_protocol::direction::{expected_data_bytes, Direction};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::oddity::wrong_bit;
use modlens_protocol::status::Status;

/// The damaged part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamagedPart {
    /// Its first one or two bytes, or they are missing: with the right ones, the checksum fits.
    Start,
    /// Its last one or two bytes are missing or wrong, and everything before fits.
    End,
    /// One bit.
    Bit,
    /// Somewhere after an intact beginning.
    Inside,
    /// From the first byte on, and not only there.
    Whole,
}

/// How many there are.
pub const DAMAGED_PARTS: usize = 5;

/// The longest beginning that a driver cuts off.
const MOST_LOST: usize = 2;

/// The damaged part of the request or answer of a row; `None` where neither is damaged, or the framing has no checksum that
/// could tell.
pub(super) fn damaged_part(batch: &Batch, row: &Transaction) -> Option<DamagedPart> {
    if row.mode != Mode::Rtu {
        return None;
    }
    match row.status {
        Status::BadResponse => {
            let wire = row.response.wire.of(&batch.arena);
            let request = row.request.pdu.of(&batch.arena);
            // A valid answer of another length than asked for is not damaged.
            if crc_valid(wire) {
                return None;
            }
            Some(response_part(wire, row.unit, row.function, request))
        }
        Status::BadRequest => Some(request_part(row.request.wire.of(&batch.arena))),
        _ => None,
    }
}

/// Whether one bit of the damaged answer of a row would make its checksum right, and the frame none of its function.
pub(super) fn has_chance_bit(batch: &Batch, row: &Transaction) -> bool {
    let wire = row.response.wire.of(&batch.arena);
    let is_damaged = row.mode == Mode::Rtu && row.status == Status::BadResponse;
    is_damaged && correctable_bit(wire).is_some() && wrong_bit(Functions::embedded(), wire).is_none()
}

/// The damaged part of an answer to this request. A last byte that is wrong may be a single wrong bit as well, as in a request.
pub(crate) fn response_part(wire: &[u8], unit: u8, function: u8, request: &[u8]) -> DamagedPart {
    let head = [unit, function];
    if wire.starts_with(&head) && is_cut_at_end(wire, response_length(wire, request)) {
        return DamagedPart::End;
    }
    if wrong_bit(Functions::embedded(), wire).is_some() {
        return DamagedPart::Bit;
    }
    if fits_with_start(wire, head) {
        return DamagedPart::Start;
    }
    if !wire.starts_with(&head) {
        return DamagedPart::Whole;
    }
    DamagedPart::Inside
}

/// The damaged part of a request that is part of no transaction, because too little of it came.
pub(super) fn damaged_request(row: &Frame, wire: &[u8]) -> Option<DamagedPart> {
    let is_damaged = !row.verdict.is_good() && row.verdict != Verdict::Noise;
    let is_request = row.mode == Mode::Rtu && row.direction == Direction::Request && row.txn.is_none();
    (is_damaged && is_request).then(|| request_part(wire))
}

/// A last byte that is wrong may be a single wrong bit as well; of random bits, one in eight is in it.
fn request_part(wire: &[u8]) -> DamagedPart {
    if is_cut_at_end(wire, Some(8)) {
        DamagedPart::End
    } else if wrong_bit(Functions::embedded(), wire).is_some() {
        DamagedPart::Bit
    } else {
        DamagedPart::Inside
    }
}

/// Whether the checksum fits if the first bytes are replaced, or preceded, by what they should be.
fn fits_with_start(wire: &[u8], head: [u8; 2]) -> bool {
    (1..=MOST_LOST).any(|lost| {
        let preceded = [&head[..lost], wire].concat();
        let replaced = wire.get(lost..).map(|rest| [&head[..lost], rest].concat());
        crc_valid(&preceded) || replaced.is_some_and(|bytes| crc_valid(&bytes))
    })
}

/// Length of an answer: as its byte count says, if that is what was asked for, or eight bytes where a write is confirmed
/// (section 6 of the application protocol).
fn response_length(wire: &[u8], request: &[u8]) -> Option<usize> {
    match request.first()? {
        1..=4 | 23 => {
            let count = usize::from(*wire.get(2)?);
            let row = Functions::embedded().row(request[0], &request[1..])?;
            let is_asked = expected_data_bytes(row, request).is_none_or(|expected| expected == count);
            is_asked.then_some(5 + count)
        }
        5 | 6 | 15 | 16 => Some(8),
        _ => None,
    }
}

/// Whether the frame ends one byte early, or in a wrong last byte, and its checksum fits as far as it can be seen.
fn is_cut_at_end(wire: &[u8], length: Option<usize>) -> bool {
    let Some(length) = length.filter(|length| *length >= 4) else { return false };
    if wire.len() + 1 != length && wire.len() != length {
        return false;
    }
    let (body, checksum) = wire.split_at(length - 2);
    checksum[0] == crc16(body).to_le_bytes()[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer to `01 03 00 00 00 01`, with the checksum of the specification's algorithm: 01 03 02 00 07 F9 86.
    const ANSWER: [u8; 7] = [1, 3, 2, 0, 7, 0xF9, 0x86];
    const REQUEST: [u8; 5] = [3, 0, 0, 0, 1];

    fn part(wire: &[u8]) -> DamagedPart {
        response_part(wire, 1, 3, &REQUEST)
    }

    #[test]
    fn the_damaged_part_is_found() {
        assert_eq!(part(&ANSWER[1..]), DamagedPart::Start);
        assert_eq!(part(&ANSWER[2..]), DamagedPart::Start);
        assert_eq!(part(&[0xC5, 0x30, 2, 0, 7, 0xF9, 0x86]), DamagedPart::Start);
        assert_eq!(part(&ANSWER[..6]), DamagedPart::End);
        assert_eq!(part(&[1, 3, 2, 0, 7, 0xF9, 0xFE]), DamagedPart::End);
        assert_eq!(part(&[1, 3, 2, 0, 6, 0xF9, 0x86]), DamagedPart::Bit);
        assert_eq!(part(&[1, 3, 2, 0x55, 0x66, 0xF9, 0x86]), DamagedPart::Inside);
        assert_eq!(part(&[0, 2, 0, 9, 0, 0]), DamagedPart::Whole);
        // With a byte count that nobody asked for, one byte that fits says nothing: the checksum of 01 03 04 00 07 00 09 begins with
        // 8B.
        assert_eq!(crc16(&[1, 3, 4, 0, 7, 0, 9]).to_le_bytes()[0], 0x8B);
        assert_eq!(part(&[1, 3, 4, 0, 7, 0, 9, 0x8B]), DamagedPart::Inside);
    }
}
