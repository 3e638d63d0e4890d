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
