//! Requests that arrived damaged, and those that the master sent again in their place.
//!
//! A unit drops a frame with a wrong checksum, and the master asks again after its time-out (serial line specification,
//! 2.4.1). So what follows a damaged request without an answer is nearly always the same one: it only has to be seen that
//! the damaged bytes may have been it, and the checksum, which differs in every other request, helps.

use crate::damage::chain::is_glitch;

/// Flipped bits, as many as disturb a frame now and then; chance has eight of the sixteen in another checksum.
const MOST_FLIPS: u32 = 3;

/// Where another sender pulled bits to 0, so many are 0 that should be 1 for each that is wrong the other way. In another
/// frame they are as many.
const PULLED: u32 = 4;

/// A request of which no more is there could be any.
const LEAST: usize = 3;

/// What came of a request.
#[derive(Clone, Debug)]
pub(super) struct Wreck(Vec<u8>);

impl Wreck {
    /// These bytes on the wire.
    pub(super) fn of(wire: &[u8]) -> Self {
        Self(wire.to_vec())
    }

    /// Whether it was this frame before something happened to it.
    pub(super) fn is_of(&self, whole: &[u8]) -> bool {
        let bits = |of: fn(u8, u8) -> u8| self.0.iter().zip(whole).map(|(&is, &was)| of(is, was).count_ones()).sum::<u32>();
        let begun = self.0.iter().zip(whole).take_while(|(is, was)| is == was).count();
        if self.0.len() != whole.len() {
            return begun >= LEAST && self.0.len() < whole.len() && is_glitch(&self.0[begun..]);
        }
        bits(|is, was| is ^ was) <= MOST_FLIPS
            || (begun >= LEAST && bits(|is, was| !is & was) >= PULLED * bits(|is, was| is & !was))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The request of the specification's example (V1.1b3, 6.3), with its checksum.
    const WHOLE: [u8; 8] = [0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87];

    fn is(spoil: impl Fn(&mut Vec<u8>)) -> bool {
        let mut bytes = WHOLE.to_vec();
        spoil(&mut bytes);
        Wreck::of(&bytes).is_of(&WHOLE)
    }

    #[test]
    fn flipped_bits_a_lost_end_and_a_collision_are_seen_through() {
        assert!(is(|bytes| bytes[1] ^= 0x40) && is(|bytes| (bytes[0], bytes[7]) = (0x10, 0x81)));
        assert!((3..8).all(|length| is(|bytes| bytes.truncate(length))));
        assert!(is(|bytes| bytes.splice(6.., [0xF0]).for_each(drop)), "a driver that is switched off too early leaves a stray");
        assert!(is(|bytes| bytes[3..].copy_from_slice(&[0x29, 0, 1, 0x12, 0x83])));
    }

    #[test]
    fn other_requests_are_others() {
        // The register behind, with its own checksum; less than anything can be told from; and one byte too many.
        let next = [0x11, 0x03, 0x00, 0x6C, 0x00, 0x03, 0xC7, 0x46];
        assert!(!Wreck::of(&next).is_of(&WHOLE) && !Wreck::of(&next[..6]).is_of(&WHOLE));
        assert!(!is(|bytes| bytes.truncate(2)) && !is(|bytes| bytes.push(0)));
    }
}
