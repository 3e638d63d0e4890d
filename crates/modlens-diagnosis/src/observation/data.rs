//! What the data of answers look like, and how near two values are to each other.

/// What the data of an answer look like, for comparison with other answers to the same request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Data {
    /// There is an answer with a block of data.
    pub is_present: bool,
    /// All registers are FFFF.
    pub all_ones: bool,
    /// All registers are 0000.
    pub all_zeros: bool,
    /// The first four bytes; none where there are fewer.
    pub opening: Option<[u8; COMPARED_BYTES]>,
    /// The first two registers; the second one is 0 where there is none.
    pub head: [u16; 2],
    /// The first or the last register is FFFF; and 0000. A single register touches FFFF where it is near: -1 is next to 0.
    pub touches: [bool; 2],
    /// How many bytes.
    pub length: u16,
}

impl Data {
    /// Whether all registers are 0000 or FFFF, which many answers are.
    pub fn is_plain(self) -> bool {
        self.all_ones || self.all_zeros
    }

    /// Whether those that are compared are, or nothing is.
    pub(crate) fn opens_plain(self) -> bool {
        self.opening.is_none_or(|bytes| bytes == [0; COMPARED_BYTES] || bytes == [0xFF; COMPARED_BYTES])
    }
}

/// Answers to different requests are compared by so many bytes.
pub(crate) const COMPARED_BYTES: usize = 4;

/// How far two values of a register are apart. It may be signed, so 65535 is next to 0.
#[inline]
pub(crate) fn apart(one: u16, other: u16) -> u32 {
    let difference = one.wrapping_sub(other);
    difference.min(difference.wrapping_neg()).into()
}

/// Registers that differ by less than this may be the next value of the same series.
pub(crate) const FAR: u32 = 64;

/// What a block of data looks like; `bits` are no registers.
#[inline(always)]
#[allow(clippy::inline_always)] // Most callers need a part of it.
pub(crate) fn data(block: &[u8], bits: bool) -> Data {
    let register = |at: usize| block.get(at..at + 2).map_or(0, |pair| u16::from_be_bytes([pair[0], pair[1]]));
    let opening: Option<[u8; COMPARED_BYTES]> = block.first_chunk().copied();
    let head = match opening {
        _ if bits => [0, 0],
        Some([one, two, three, four]) => [u16::from_be_bytes([one, two]), u16::from_be_bytes([three, four])],
        None => [register(0), 0],
    };
    let last = block.last_chunk().map_or(0, |pair| u16::from_be_bytes(*pair));
    let is_near_ones = block.len() == 2 && !bits && apart(last, 0xFFFF) < FAR;
    let touches = [head[0] == 0xFFFF || last == 0xFFFF || is_near_ones, head[0] == 0 || last == 0];
    // All bytes are looked at only where a register may be one of many alike; a single byte is none, and begins with 0 then.
    let is_all = |byte: u8| !bits && !block.is_empty() && block.iter().all(|other| *other == byte);
    let (all_ones, all_zeros) = match touches {
        [false, false] => (false, false),
        [true, _] | [_, true] => (is_all(0xFF), is_all(0)),
    };
    Data { is_present: true, head, touches, all_ones, all_zeros, opening, length: block.len() as u16 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // As the words of `Data` say it, register by register.
        #[test]
        fn data_are_what_their_registers_say(
            block in prop::collection::vec(prop_oneof![Just(0u8), Just(0xFF), any::<u8>()], 0..9),
            is_long_and_plain in any::<bool>(),
            bits in any::<bool>(),
        ) {
            let plain = block.first().map_or(Vec::new(), |first| vec![*first; block.len()]);
            let block = if is_long_and_plain { plain } else { block };
            let register = |at: usize| block.get(at..at + 2).map_or(0, |pair| u16::from(pair[0]) << 8 | u16::from(pair[1]));
            let (last, head) = (register(block.len().saturating_sub(2)), [register(0), register(2)]);
            let head = if bits { [0, 0] } else { head };
            let is_all = |byte: u8| !bits && !block.is_empty() && block.iter().all(|other| *other == byte);
            let seen = data(&block, bits);
            prop_assert_eq!((seen.all_ones, seen.all_zeros), (is_all(0xFF), is_all(0)));
            prop_assert_eq!(seen.head, head);
            let is_near = block.len() == 2 && !bits && !(0x3F..=0xFFBF).contains(&last);
            prop_assert_eq!(seen.touches, [head[0] == 0xFFFF || last == 0xFFFF || is_near, head[0] == 0 || last == 0]);
            prop_assert_eq!(seen.opening.is_some(), block.len() >= COMPARED_BYTES);
            prop_assert_eq!(usize::from(seen.length), block.len());
        }
    }
}
