//! Decodes and encodes hex digits without a branch per digit.

/// Marks a character that is no hex digit in `DIGIT_VALUES`.
pub const INVALID_DIGIT: u8 = 0xFF;

/// The value of each character as a hex digit, or `INVALID_DIGIT`.
pub const DIGIT_VALUES: [u8; 256] = digit_values();

/// Marks a character that is no hex digit in the tables of 16-bit values. The bit lies above all byte values, so that it
/// survives when several entries are combined by OR, and one test at the end finds any invalid digit.
pub const INVALID: u16 = 0x100;

/// The value of each character as the first digit of a byte, or `INVALID`.
pub static HIGH_DIGIT_VALUES: [u16; 256] = shifted_digit_values(4);

/// The value of each character as the second digit of a byte, or `INVALID`.
pub static LOW_DIGIT_VALUES: [u16; 256] = shifted_digit_values(0);

/// Builds `DIGIT_VALUES`.
const fn digit_values() -> [u8; 256] {
    let mut table = [INVALID_DIGIT; 256];
    let mut i = 0u8;
    while i < 16 {
        let digit = if i < 10 { b'0' + i } else { b'a' + i - 10 };
        table[digit as usize] = i;
        table[digit.to_ascii_uppercase() as usize] = i;
        i += 1;
    }
    table
}

/// Builds a table of digit values shifted to the left.
const fn shifted_digit_values(shift: u32) -> [u16; 256] {
    let mut table = [INVALID; 256];
    let mut i = 0;
    while i < 256 {
        if DIGIT_VALUES[i] != INVALID_DIGIT {
            table[i] = (DIGIT_VALUES[i] as u16) << shift;
        }
        i += 1;
    }
    table
}

/// The value of the hex digit at position `at`, or `INVALID_DIGIT`.
#[inline]
pub fn digit_at(text: &[u8], at: usize) -> u8 {
    text.get(at).map_or(INVALID_DIGIT, |&b| DIGIT_VALUES[b as usize])
}

/// The byte that the two hex digits at position `at` encode.
#[inline]
pub fn byte_at(text: &[u8], at: usize) -> Option<u8> {
    let two = text.get(at..at + 2)?;
    let value = HIGH_DIGIT_VALUES[two[0] as usize] | LOW_DIGIT_VALUES[two[1] as usize];
    (value < INVALID).then_some(value as u8)
}

/// Decodes pairs of hex digits without separators and appends the bytes to `out`. If any character is no hex digit, returns
/// false and leaves `out` unchanged.
pub fn decode_pairs(digits: &[u8], out: &mut Vec<u8>) -> bool {
    let (before, mut bad) = (out.len(), 0);
    out.extend(digits.chunks_exact(2).map(|two| {
        let value = HIGH_DIGIT_VALUES[two[0] as usize] | LOW_DIGIT_VALUES[two[1] as usize];
        bad |= value;
        value as u8
    }));
    if bad & INVALID != 0 {
        out.truncate(before);
    }
    bad & INVALID == 0
}

/// The bytes as lower-case hex digits.
pub fn hex(bytes: &[u8]) -> String {
    let mut text = Vec::with_capacity(bytes.len() * 2);
    push_hex(bytes, &mut text);
    String::from_utf8(text).unwrap_or_default()
}

/// Appends the bytes as lower-case hex digits: sixteen at a time, and the last ones again with those before them, so that no
/// copy has a length that is not known to the compiler.
#[inline]
pub fn push_hex(bytes: &[u8], out: &mut Vec<u8>) {
    let end = out.len() + 2 * bytes.len();
    if let Some(last) = bytes.last_chunk::<16>() {
        for group in bytes.as_chunks::<16>().0 {
            push_digits_of(group, out);
        }
        out.truncate(end - 2 * last.len());
        push_digits_of(last, out);
    } else if let (Some(first), Some(last)) = (bytes.first_chunk::<8>(), bytes.last_chunk::<8>()) {
        push_digits_of(first, out);
        out.truncate(end - 2 * last.len());
        push_digits_of(last, out);
    } else {
        let mut few = [0; 8];
        few.iter_mut().zip(bytes).for_each(|(to, &byte)| *to = byte);
        push_digits_of(&few, out);
        out.truncate(end);
    }
}

/// Appends the hex digits of some bytes.
#[inline(always)]
#[allow(clippy::inline_always)] // See `digits_of`.
fn push_digits_of<const BYTES: usize>(bytes: &[u8; BYTES], out: &mut Vec<u8>) {
    out.extend_from_slice(digits_of(bytes).as_flattened());
}

/// The hex digits of some bytes. It uses no table, and is a loop, so that the compiler converts all of them at once:
/// each byte becomes a number of 16 bits, whose halves become its two digits.
#[inline(always)]
#[allow(clippy::inline_always)] // A dozen instructions for eight bytes.
pub fn digits_of<const BYTES: usize>(bytes: &[u8; BYTES]) -> [[u8; 2]; BYTES] {
    let mut digits = [[0; 2]; BYTES];
    for (to, &byte) in digits.iter_mut().zip(bytes) {
        let halves = (u16::from(byte) >> 4 | u16::from(byte) << 8) & 0x0F0F;
        let is_letter = ((halves + 0x0606) >> 4) & 0x0101;
        *to = (halves + 0x3030 + is_letter * u16::from(b'a' - b'0' - 10)).to_le_bytes();
    }
    digits
}

/// Decodes hex digits; white space between them is ignored. `None` for an odd number of digits or another character.
pub fn parse_hex(text: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> = text.chars().filter(|c| !c.is_whitespace()).map(|c| c.to_digit(16).map(|d| d as u8)).collect();
    let digits = digits.filter(|digits| digits.len() % 2 == 0)?;
    Some(digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hex_of_all_lengths() {
        for length in 0..70_u8 {
            let bytes: Vec<u8> = (0..length).map(|at| at.wrapping_mul(37)).collect();
            let expected: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
            assert_eq!(hex(&bytes), expected.concat());
            let mut out = b"before".to_vec();
            push_hex(&bytes, &mut out);
            assert_eq!(out, ["before", &expected.concat()].concat().as_bytes());
        }
    }
}
