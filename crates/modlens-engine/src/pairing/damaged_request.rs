//! Requests that arrived damaged, and how their retries are recognised.
//!
//! A unit drops a frame with a wrong checksum, and the master sends the request again after its timeout (serial line
//! specification, 2.4.1). The next request is therefore nearly always the retry of a damaged request without response. It
//! is enough to check that the damaged bytes may have been that request; the checksum, which differs between requests,
//! is part of the comparison.

use crate::damage::glitch::is_glitch;

/// Bits that noise flips in a frame now and then. The checksums of two different requests differ in eight of sixteen
/// bits on average.
const MAX_FLIPPED_BITS: u32 = 3;

/// A second sender pulls bits to 0: for each bit that is wrongly 1, at least so many must be wrongly 0. Between two
/// different frames, the two numbers are about equal.
const MIN_CLEARED_BITS_PER_SET_BIT: u32 = 4;

/// Intact bytes at the start without which the request cannot be recognised.
const MIN_INTACT_BYTES: usize = 3;

/// The bytes on the wire of a damaged request.
#[derive(Clone, Debug)]
pub(super) struct DamagedRequest(Vec<u8>);

impl DamagedRequest {
    pub(super) fn of(wire: &[u8]) -> Self {
        Self(wire.to_vec())
    }

    /// Whether the damaged bytes may have been this intact request. Both are whole frames on the wire, checksum included.
    ///
    /// Of equal length: at most three bits are flipped anywhere, or the first three bytes are intact and at least four times
    /// as many bits were pulled to 0 as to 1, which is what a second sender does. Shorter: it was cut after at least three
    /// intact bytes, and nothing but a glitch of the line driver follows the cut. A longer one never was.
    pub(super) fn may_have_been(&self, intact: &[u8]) -> bool {
        let damaged = &self.0;
        let intact_bytes = damaged.iter().zip(intact).take_while(|(is, was)| is == was).count();
        if damaged.len() != intact.len() {
            return intact_bytes >= MIN_INTACT_BYTES && damaged.len() < intact.len() && is_glitch(&damaged[intact_bytes..]);
        }
        let bits =
            |changed: fn(u8, u8) -> u8| damaged.iter().zip(intact).map(|(&is, &was)| changed(is, was).count_ones()).sum::<u32>();
        let (cleared, set) = (bits(|is, was| !is & was), bits(|is, was| is & !was));
        cleared + set <= MAX_FLIPPED_BITS || (intact_bytes >= MIN_INTACT_BYTES && cleared >= MIN_CLEARED_BITS_PER_SET_BIT * set)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The request of the specification's example (V1.1b3, 6.3), with its checksum.
    const INTACT: [u8; 8] = [0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87];

    fn recognised_after(damage: impl Fn(&mut Vec<u8>)) -> bool {
        let mut bytes = INTACT.to_vec();
        damage(&mut bytes);
        DamagedRequest::of(&bytes).may_have_been(&INTACT)
    }

    #[test]
    fn a_request_is_recognised_after_flipped_bits_a_lost_end_or_a_collision() {
        assert!(recognised_after(|bytes| bytes[1] ^= 0x40));
        assert!(recognised_after(|bytes| (bytes[0], bytes[7]) = (0x10, 0x81)));
        assert!((3..8).all(|length| recognised_after(|bytes| bytes.truncate(length))));
        // A driver that is switched off too early leaves a stray byte.
        assert!(recognised_after(|bytes| bytes.splice(6.., [0xF0]).for_each(drop)));
        assert!(recognised_after(|bytes| bytes[3..].copy_from_slice(&[0x29, 0, 1, 0x12, 0x83])));
    }

    #[test]
    fn another_request_is_not_taken_for_the_damaged_one() {
        // The request for the next register, with its own checksum, whole and cut; two bytes only; one byte too many.
        let next = [0x11, 0x03, 0x00, 0x6C, 0x00, 0x03, 0xC7, 0x46];
        assert!(!DamagedRequest::of(&next).may_have_been(&INTACT) && !DamagedRequest::of(&next[..6]).may_have_been(&INTACT));
        assert!(!recognised_after(|bytes| bytes.truncate(2)) && !recognised_after(|bytes| bytes.push(0)));
    }
}
