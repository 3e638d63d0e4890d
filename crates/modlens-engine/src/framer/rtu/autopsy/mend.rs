//! Which single change would make a checksum right: a byte put in, a byte taken out.
//!
//! The register over what stands before a place, and the one that what stands behind it needs to end in zero, are
//! both worked out in one pass; a change at a place fits if it leads from the one to the other. So all places of a
//! frame are tried in time that is linear in its length.

use crate::framer::rtu::join::back as back_a_bit;
use modlens_protocol::checksum::{step, INIT};

/// The register before a zero byte.
fn back(state: u16) -> u16 {
    (0..8).fold(state, |state, _| back_a_bit(state))
}

/// For each place: the register before it, and the one needed there.
fn registers(bytes: &[u8]) -> (Vec<u16>, Vec<u16>) {
    let mut before = Vec::with_capacity(bytes.len() + 1);
    before.push(INIT);
    for &byte in bytes {
        before.push(step(before[before.len() - 1], byte));
    }
    let mut needed = vec![0; bytes.len() + 1];
    for (at, &byte) in bytes.iter().enumerate().rev() {
        needed[at] = back(needed[at + 1]) ^ u16::from(byte);
    }
    (before, needed)
}

/// Where one byte could be missing: the last of those places. By chance there is one in a frame of 256 bytes.
pub fn missing_byte(bytes: &[u8]) -> Option<usize> {
    let (before, needed) = registers(bytes);
    // A byte changes the low half of the register only, before the step.
    (0..=bytes.len()).rev().find(|&at| (before[at] ^ back(needed[at])) >> 8 == 0)
}

/// Which byte stands there twice: without it the checksum is right.
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
        fn a_missing_byte_is_found_where_putting_one_in_mends(body in proptest::collection::vec(any::<u8>(), 3..40), at in any::<usize>()) {
            let mut frame = framed(&body);
            frame.remove(at % frame.len());
            let place = missing_byte(&frame);
            prop_assert!(place.is_some());
            let place = place.unwrap();
            let mended = |byte: u8| crc_valid(&[&frame[..place], &[byte], &frame[place..]].concat());
            prop_assert!((0..=255).any(mended));
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
        fn nothing_is_missing_where_no_byte_mends(bytes in proptest::collection::vec(any::<u8>(), 3..12)) {
            let any = (0..=bytes.len()).any(|at| (0..=255u8).any(|byte| crc_valid(&[&bytes[..at], &[byte], &bytes[at..]].concat())));
            prop_assert_eq!(missing_byte(&bytes).is_some(), any);
        }
    }
}
