//! CRC-16/MODBUS and LRC (serial line specification, 6.2).
//!
//! Every frame's CRC is checked, so `crc_valid_at` uses the fastest instructions of the processor; all other functions use
//! tables. The bit-by-bit procedure of the specification is in the tests, as an oracle.

use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
mod carryless;

/// x^16 + x^15 + x^2 + 1, bits reversed (serial line specification, 6.2.2).
const POLYNOMIAL: u16 = 0xA001;

/// The period of the CRC register in bits: after so many zero bits it has its old value again. It is the order of x modulo
/// the polynomial.
pub const CRC_PERIOD_BITS: usize = 32_767;

/// The number of bytes of the CRC at the end of an RTU frame (serial line specification, 2.5.1).
pub const CRC_BYTES: usize = 2;

/// The initial value of the CRC register (serial line specification, 6.2.2).
pub const CRC_INIT: u16 = 0xFFFF;

/// `TABLES[k][b]` is the effect on the register of byte `b` followed by `k` zero bytes.
static TABLES: [[u16; 256]; 8] = tables();

/// Builds `TABLES`.
const fn tables() -> [[u16; 256]; 8] {
    let mut all = [[0u16; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut state = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            state = if state & 1 == 1 { (state >> 1) ^ POLYNOMIAL } else { state >> 1 };
            bit += 1;
        }
        all[0][byte] = state;
        byte += 1;
    }
    let mut k = 1;
    while k < 8 {
        let mut byte = 0;
        while byte < 256 {
            let before = all[k - 1][byte];
            all[k][byte] = (before >> 8) ^ all[0][(before & 0xFF) as usize];
            byte += 1;
        }
        k += 1;
    }
    all
}

/// The CRC register after one more byte.
#[inline]
pub fn update_byte(state: u16, byte: u8) -> u16 {
    (state >> 8) ^ TABLES[0][((state ^ u16::from(byte)) & 0xFF) as usize]
}

/// The CRC register after more bytes, of which eight are processed per step.
pub fn update(mut state: u16, data: &[u8]) -> u16 {
    let mut words = data.chunks_exact(8);
    for w in words.by_ref() {
        let low = (state ^ u16::from_le_bytes([w[0], w[1]])).to_le_bytes();
        state = TABLES[7][low[0] as usize]
            ^ TABLES[6][low[1] as usize]
            ^ TABLES[5][w[2] as usize]
            ^ TABLES[4][w[3] as usize]
            ^ TABLES[3][w[4] as usize]
            ^ TABLES[2][w[5] as usize]
            ^ TABLES[1][w[6] as usize]
            ^ TABLES[0][w[7] as usize];
    }
    words.remainder().iter().fold(state, |state, &byte| update_byte(state, byte))
}

/// The CRC-16/MODBUS of these bytes. It is transmitted low byte first.
///
/// ```
/// assert_eq!(modlens_protocol::checksum::crc16(&[0x11, 0x03, 0x00, 0x6B, 0x00, 0x03]), 0x8776);
/// ```
pub fn crc16(data: &[u8]) -> u16 {
    update(CRC_INIT, data)
}

/// Whether the last two bytes are the CRC of those before them, in which case the register over all bytes is zero. False for
/// fewer than four bytes.
pub fn crc_valid(frame: &[u8]) -> bool {
    crc_valid_at(frame, frame.len())
}

/// Whether the first `length` bytes end with their CRC. This is faster if more bytes follow in the slice, because blocks of
/// 16 bytes can then be read across the end. False for fewer than four bytes.
#[inline]
pub fn crc_valid_at(bytes: &[u8], length: usize) -> bool {
    if length < 4 || length > bytes.len() {
        return false;
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(valid) = carryless::valid(bytes, length) {
        return valid;
    }
    is_valid_by_tables(&bytes[..length])
}

/// Whether the bytes end with their CRC, computed with tables. The last bytes are padded with zeros to eight: a register
/// of zero stays zero over zero bytes, and no other value becomes zero.
fn is_valid_by_tables(frame: &[u8]) -> bool {
    let (words, rest) = frame.split_at(frame.len() & !7);
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    update(update(CRC_INIT, words), &last) == 0
}

/// The LRC of the binary bytes of an ASCII frame: the two's complement of their sum (serial line specification, 6.2.1).
pub fn lrc(data: &[u8]) -> u8 {
    data.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte)).wrapping_neg()
}

/// `BACKWARDS[k][b]` is the value on which byte `b` and `k` zero bytes more have the effect that `b` itself would have had on the
/// register: the step on a zero byte, taken back `k` times.
static BACKWARDS: [[u16; 256]; 8] = backwards();

/// Builds `BACKWARDS`.
const fn backwards() -> [[u16; 256]; 8] {
    let mut all = [[0u16; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut state = byte as u16;
        let mut k = 0;
        while k < 8 {
            all[k][byte] = state;
            let mut bit = 0;
            while bit < 8 {
                // The step sets the highest bit if and only if it shifted a one out.
                state = if state & 0x8000 == 0 { state << 1 } else { (state ^ POLYNOMIAL) << 1 | 1 };
                bit += 1;
            }
            k += 1;
        }
        byte += 1;
    }
    all
}

/// The first length from `least` on at which the bytes end with their CRC.
///
/// Let T be the step of the register on a zero byte. From state s on, the register is 0 after byte `j` if and only if s is the
/// sum of T^-i of bytes i up to j. So eight bytes are eight look-ups that need not wait for each other.
pub fn first_valid_length(bytes: &[u8], least: usize) -> Option<usize> {
    let mut state = update(CRC_INIT, bytes.get(..least)?);
    if state == 0 {
        return Some(least);
    }
    let mut length = least;
    let mut words = bytes[least..].chunks_exact(8);
    for word in words.by_ref() {
        let mut sum = 0;
        let mut is_zero = false;
        for (effects, &byte) in BACKWARDS.iter().zip(word) {
            sum ^= effects[usize::from(byte)];
            is_zero |= sum == state;
        }
        if is_zero {
            break;
        }
        let [low, high] = (state ^ sum).to_le_bytes();
        state = TABLES[7][usize::from(low)] ^ TABLES[6][usize::from(high)];
        length += 8;
    }
    bytes[length..].iter().find_map(|&byte| {
        state = update_byte(state, byte);
        length += 1;
        (state == 0).then_some(length)
    })
}

/// The single bit whose inversion makes the CRC of `frame` valid, as (index of the byte, number of the bit), if there is
/// one.
///
/// In frames of up to 256 bytes, the limit of the specification, there is at most one, because the Hamming distance of the
/// code is 4.
pub fn correctable_bit(frame: &[u8]) -> Option<(usize, u8)> {
    // Bits are counted from the end of the transmission, which sends the lowest bit of each byte first.
    let behind = bits_behind(crc16(frame))?;
    let index = frame.len().checked_sub(1 + behind / 8)?;
    Some((index, 7 - (behind % 8) as u8))
}

/// The number of bits transmitted after a single wrong bit that leaves this value in the register; `None` if no single bit
/// does.
fn bits_behind(residue: u16) -> Option<usize> {
    /// Marks values that no single wrong bit leaves.
    const NONE: u16 = u16::MAX;
    static BEHIND: OnceLock<Box<[u16]>> = OnceLock::new();
    let behind = BEHIND.get_or_init(|| {
        let mut behind = vec![NONE; 1 << 16].into_boxed_slice();
        // A wrong bit at the very end leaves the polynomial; each bit transmitted after it shifts the register again.
        let one_more = |&state: &u16| Some(if state & 1 == 1 { state >> 1 ^ POLYNOMIAL } else { state >> 1 });
        let states = std::iter::successors(Some(POLYNOMIAL), one_more).take(CRC_PERIOD_BITS);
        states.zip(0..).for_each(|(state, bits)| behind[usize::from(state)] = bits);
        behind
    });
    let bits = behind[usize::from(residue)];
    (bits != NONE).then_some(usize::from(bits))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The procedure of the serial line specification, 6.2.2, bit by bit.
    fn crc_by_specification(data: &[u8]) -> u16 {
        let mut register = 0xFFFFu16;
        for &byte in data {
            register ^= u16::from(byte);
            for _ in 0..8 {
                let out = register & 1;
                register >>= 1;
                if out == 1 {
                    register ^= 0xA001;
                }
            }
        }
        register
    }

    #[test]
    fn checksums_of_published_examples() {
        assert_eq!(crc16(&[0x01, 0x83, 0x04]).to_le_bytes(), [0x40, 0xF3]);
        assert_eq!(crc16(&[0x01, 0x86, 0x04]).to_le_bytes(), [0x43, 0xA3]);
        assert_eq!(lrc(&[0x11, 0x03, 0x00, 0x6B, 0x00, 0x03]), 0x7E);
    }

    proptest! {
        #[test]
        fn tables_agree_with_the_specification(data in proptest::collection::vec(any::<u8>(), 0..300)) {
            prop_assert_eq!(crc16(&data), crc_by_specification(&data));
        }

        #[test]
        fn all_implementations_accept_valid_and_reject_wrong_checksums(
            data in proptest::collection::vec(any::<u8>(), 2..300),
            behind in proptest::collection::vec(any::<u8>(), 0..40),
            at in any::<usize>(),
            flip in any::<u8>(),
        ) {
            let length = data.len() + 2;
            let mut bytes = [&data, &crc_by_specification(&data).to_le_bytes()[..], &behind].concat();
            bytes[at % length] ^= flip;
            let right = crc_by_specification(&bytes[..length]) == 0;
            prop_assert_eq!(right, flip == 0);
            prop_assert_eq!(is_valid_by_tables(&bytes[..length]), right);
            prop_assert_eq!(crc_valid_at(&bytes, length), right);
            prop_assert_eq!(crc_valid(&bytes[..length]), right);
        }

        #[test]
        fn all_implementations_agree_on_any_bytes(bytes in proptest::collection::vec(0u8..3, 4..60)) {
            // With few values and short frames some checksums are valid by chance.
            for length in 4..=bytes.len() {
                let right = crc_by_specification(&bytes[..length]) == 0;
                prop_assert_eq!((is_valid_by_tables(&bytes[..length]), crc_valid_at(&bytes, length)), (right, right));
            }
        }

        #[test]
        fn the_first_valid_length_agrees_with_the_specification(
            data in proptest::collection::vec(0u8..3, 2..40),
            behind in proptest::collection::vec(0u8..2, 0..12),
            least in 0usize..60,
        ) {
            let bytes = [&data[..], &crc16(&data).to_le_bytes(), &behind].concat();
            let naive = (least..=bytes.len()).find(|&length| crc_by_specification(&bytes[..length]) == 0);
            prop_assert_eq!(first_valid_length(&bytes, least), naive);
        }

        #[test]
        fn a_bit_is_reported_exactly_if_its_inversion_makes_the_frame_valid(mut data in proptest::collection::vec(any::<u8>(), 4..60)) {
            let mut mends = Vec::new();
            for place in 0..8 * data.len() {
                data[place / 8] ^= 1 << (place % 8);
                if crc_valid(&data) {
                    mends.push((place / 8, (place % 8) as u8));
                }
                data[place / 8] ^= 1 << (place % 8);
            }
            prop_assert_eq!(correctable_bit(&data), mends.first().copied().filter(|_| !crc_valid(&data)));
        }

        #[test]
        fn one_flipped_bit_is_found(data in proptest::collection::vec(any::<u8>(), 2..250), at in any::<usize>(), bit in 0u8..8) {
            let mut frame = data.clone();
            frame.extend(crc_by_specification(&data).to_le_bytes());
            let at = at % frame.len();
            frame[at] ^= 1 << bit;
            prop_assert_eq!(correctable_bit(&frame), Some((at, bit)));
        }

        #[test]
        fn merged_frames_never_validate(a in proptest::collection::vec(any::<u8>(), 2..60), b in proptest::collection::vec(any::<u8>(), 2..60)) {
            let mut both = a.clone();
            both.extend(crc16(&a).to_le_bytes());
            both.extend(&b);
            both.extend(crc16(&b).to_le_bytes());
            prop_assert!(!crc_valid(&both));
        }
    }
}
