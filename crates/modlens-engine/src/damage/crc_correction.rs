//! Which single inserted or removed byte makes the CRC of a damaged frame valid.
//!
//! Two CRC registers are computed for every place in one pass: the register over the bytes before the place, and the one
//! that would make the register over all bytes end in zero, given the bytes after the place. A change at a place fits if
//! it leads from the first register to the second. So all places are tried in time that is linear in the frame's length.

use crate::rtu_model::crc_scan::step_back_bit;
use modlens_protocol::checksum::{update_byte, CRC_INIT};

/// The register that a step over a zero byte turns into this one.
fn step_back(state: u16) -> u16 {
    (0..8).fold(state, |state, _| step_back_bit(state))
}

/// For each place: the register before it, and the register that is needed there for the CRC to be valid.
fn registers(bytes: &[u8]) -> (Vec<u16>, Vec<u16>) {
    let mut before = Vec::with_capacity(bytes.len() + 1);
    before.push(CRC_INIT);
    for &byte in bytes {
        before.push(update_byte(before[before.len() - 1], byte));
    }
    let mut needed = vec![0; bytes.len() + 1];
    for (at, &byte) in bytes.iter().enumerate().rev() {
        needed[at] = step_back(needed[at + 1]) ^ u16::from(byte);
    }
    (before, needed)
}

/// The last index at which one inserted byte would make the CRC valid. In a frame of 256 random bytes one such index
/// exists by chance.
pub fn missing_byte(bytes: &[u8]) -> Option<usize> {
    let (before, needed) = registers(bytes);
    // Before the step, a byte changes only the low half of the register; so the high halves have to agree.
    (0..=bytes.len()).rev().find(|&at| (before[at] ^ step_back(needed[at])) >> 8 == 0)
}

/// The first index from `from` on, and the first of `values`, at which that byte inserted makes the CRC valid.
pub fn inserted_byte(bytes: &[u8], from: usize, values: &[u8]) -> Option<(usize, u8)> {
    let (before, needed) = registers(bytes);
    (from..=bytes.len()).find_map(|at| {
        let fits = |value: &&u8| update_byte(before[at], **value) == needed[at];
        values.iter().find(fits).map(|&value| (at, value))
    })
}

/// The index of a byte that equals the one before it and without which the CRC is valid.
pub fn doubled_byte(bytes: &[u8]) -> Option<usize> {
    let (before, needed) = registers(bytes);
    (1..bytes.len()).find(|&at| bytes[at] == bytes[at - 1] && before[at] == needed[at + 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::checksum::{crc16, crc_valid};
    use proptest::prelude::*;

    fn framed(body: &[u8]) -> Vec<u8> {
        [body, &crc16(body).to_le_bytes()].concat()
    }

    proptest! {
        #[test]
        fn a_missing_byte_is_found_where_an_inserted_one_makes_the_crc_valid(body in proptest::collection::vec(any::<u8>(), 3..40), at in any::<usize>()) {
            let mut frame = framed(&body);
            frame.remove(at % frame.len());
            let place = missing_byte(&frame);
            prop_assert!(place.is_some());
            let place = place.unwrap();
            let is_valid_with = |byte: u8| crc_valid(&[&frame[..place], &[byte], &frame[place..]].concat());
            prop_assert!((0..=255).any(is_valid_with));
        }

        #[test]
        fn a_doubled_byte_is_found(body in proptest::collection::vec(any::<u8>(), 3..40), at in any::<usize>()) {
            let mut frame = framed(&body);
            let at = at % frame.len();
            frame.insert(at, frame[at]);
            let copy = doubled_byte(&frame);
            prop_assert!(copy.is_some_and(|copy| frame[copy] == frame[at]));
            frame.remove(copy.unwrap());
            prop_assert!(crc_valid(&frame));
        }

        #[test]
        fn a_byte_of_given_value_is_found_where_it_was_taken_out(body in proptest::collection::vec(any::<u8>(), 3..40), at in any::<usize>()) {
            let taken = at % (body.len() + 1);
            let mut frame = framed(&[&body[..taken], &[0x11], &body[taken..]].concat());
            frame.remove(taken);
            // The slow way: each place in turn, the whole CRC each time.
            let with = |place: usize| [&frame[..place], &[0x11], &frame[place..]].concat();
            let slow = (0..=frame.len()).find(|&place| crc_valid(&with(place)));
            prop_assert!(slow.is_some_and(|place| place <= taken));
            prop_assert_eq!(inserted_byte(&frame, 0, &[0x11]), slow.map(|place| (place, 0x11)));
            prop_assert_eq!(inserted_byte(&frame, taken, &[0x11]), Some((taken, 0x11)));
        }

        #[test]
        fn no_byte_is_missing_where_none_makes_the_crc_valid(bytes in proptest::collection::vec(any::<u8>(), 3..12)) {
            let with = |at: usize, byte: u8| [&bytes[..at], &[byte], &bytes[at..]].concat();
            let any = (0..=bytes.len()).any(|at| (0..=255u8).any(|byte| crc_valid(&with(at, byte))));
            prop_assert_eq!(missing_byte(&bytes).is_some(), any);
        }
    }
}
