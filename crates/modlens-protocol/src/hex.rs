//! Hex digits, as fast as text comes.

/// No digit.
pub const BAD: u8 = 0xFF;

/// What a character is worth as a digit, or `BAD`.
pub const DIGITS: [u8; 256] = digits();

/// Beyond all bytes: a character is no digit.
pub const NO: u16 = 0x100;

/// What a digit is worth as the first of a byte, or `NO`.
pub static HIGH: [u16; 256] = worth(4);

/// The same as the second.
pub static LOW: [u16; 256] = worth(0);

const fn digits() -> [u8; 256] {
    let mut table = [BAD; 256];
    let mut i = 0u8;
    while i < 16 {
        let digit = if i < 10 { b'0' + i } else { b'a' + i - 10 };
        table[digit as usize] = i;
        table[digit.to_ascii_uppercase() as usize] = i;
        i += 1;
    }
    table
}

const fn worth(shift: u32) -> [u16; 256] {
    let mut table = [NO; 256];
    let mut i = 0;
    while i < 256 {
        if DIGITS[i] != BAD {
            table[i] = (DIGITS[i] as u16) << shift;
        }
        i += 1;
    }
    table
}

/// The digit at a place, or `BAD`.
#[inline]
pub fn digit(text: &[u8], at: usize) -> u8 {
    text.get(at).map_or(BAD, |&b| DIGITS[b as usize])
}

/// The byte that two digits at a place make.
#[inline]
pub fn pair(text: &[u8], at: usize) -> Option<u8> {
    let two = text.get(at..at + 2)?;
    let value = HIGH[two[0] as usize] | LOW[two[1] as usize];
    (value < NO).then_some(value as u8)
}

/// Appends the bytes of pairs without anything between; nothing, where one of them is none.
pub fn solid(digits: &[u8], out: &mut Vec<u8>) -> bool {
    let (before, mut bad) = (out.len(), 0);
    out.extend(digits.chunks_exact(2).map(|two| {
        let value = HIGH[two[0] as usize] | LOW[two[1] as usize];
        bad |= value;
        value as u8
    }));
    if bad & NO != 0 {
        out.truncate(before);
    }
    bad & NO == 0
}

/// Lower-case hex.
pub fn hex(bytes: &[u8]) -> String {
    let mut text = Vec::with_capacity(bytes.len() * 2);
    push_hex(bytes, &mut text);
    String::from_utf8(text).unwrap_or_default()
}

/// Appends lower-case hex.
#[inline]
pub fn push_hex(bytes: &[u8], out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + 2 * bytes.len(), 0);
    let (pairs, rest) = out[start..].as_chunks_mut::<16>();
    let (eights, tail) = bytes.as_chunks::<8>();
    for (pair, eight) in pairs.iter_mut().zip(eights) {
        *pair = digits_of(*eight);
    }
    for (pair, &byte) in rest.chunks_exact_mut(2).zip(tail) {
        pair.copy_from_slice(&[digit_of(byte >> 4), digit_of(byte & 15)]);
    }
}

/// The digits of eight bytes, without a table: so the compiler does all of them at once.
#[inline]
fn digits_of(bytes: [u8; 8]) -> [u8; 16] {
    let mut out = [0; 16];
    for (at, byte) in bytes.into_iter().enumerate() {
        out[2 * at] = digit_of(byte >> 4);
        out[2 * at + 1] = digit_of(byte & 15);
    }
    out
}

#[inline]
fn digit_of(value: u8) -> u8 {
    value + b'0' + if value > 9 { b'a' - b'0' - 10 } else { 0 }
}

/// The bytes of a hex text; blanks are ignored.
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
        }
    }
}
