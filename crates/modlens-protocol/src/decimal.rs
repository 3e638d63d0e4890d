//! Appends integers and short texts to a buffer, fast.

use std::sync::OnceLock;

/// Appends an integer. Most are in the table.
#[inline]
pub fn push_int(value: i64, out: &mut Vec<u8>) {
    match decimal_texts().get(value as usize) {
        Some(entry) => push_entry(*entry, out),
        None => push_long(value, out),
    }
}

#[inline(never)]
fn push_long(value: i64, out: &mut Vec<u8>) {
    match value as u64 {
        value @ 10_000..100_000_000 => return push_eight_digits(value, out),
        value @ 100_000_000..1_000_000_000_000 => {
            // What is left of microseconds of days, once eight digits are off, is in the table.
            push_entry(decimal_texts()[(value / 100_000_000) as usize], out);
            let [high, low] = [value / 10_000 % 10_000, value % 10_000].map(|four| u32::from_le_bytes(last_four_digits(four)));
            out.extend_from_slice(&(u64::from(high) | u64::from(low) << 32).to_le_bytes());
            return;
        }
        _ => {}
    }
    if value < 0 {
        out.push(b'-');
    }
    push_unsigned(value.unsigned_abs(), out);
}

/// Appends a number of five to eight digits, which fit into one of eight bytes.
#[inline]
fn push_eight_digits(value: u64, out: &mut Vec<u8>) {
    let high = u64::from_le_bytes(decimal_texts()[(value / 10_000) as usize]);
    let length = high >> 56;
    let digits = high & ((1 << (8 * length)) - 1);
    let end = out.len() + length as usize + 4;
    let low = u64::from(u32::from_le_bytes(last_four_digits(value % 10_000)));
    out.extend_from_slice(&(digits | low << (8 * length)).to_le_bytes());
    out.truncate(end);
}

/// Appends a non-negative integer four digits at a time, from a table.
fn push_unsigned(value: u64, out: &mut Vec<u8>) {
    if let Some(entry) = decimal_texts().get(value as usize) {
        push_entry(*entry, out);
        return;
    }
    push_unsigned(value / 10_000, out);
    out.extend_from_slice(&last_four_digits(value % 10_000));
}

/// A number below 10,000 with its leading zeros.
#[inline]
fn last_four_digits(value: u64) -> [u8; 4] {
    // They are in the text of 1xxxx.
    let [_, a, b, c, d, ..] = decimal_texts()[10_000 + value as usize];
    [a, b, c, d]
}

/// Numbers that are written at a time, and the room that their longest texts take, each with a separator.
const GROUP: usize = 8;
const GROUP_BYTES: usize = 6 * GROUP;

/// Appends numbers of 16 bits, the high byte first, each with the separator after it.
///
/// Most values in tables are registers, and each of these costs one look-up and one copy of fixed size, without a check of the
/// room.
pub fn push_words<const SEPARATOR: u8>(bytes: &[u8], out: &mut Vec<u8>) {
    let table = decimal_texts();
    let (words, _) = bytes.as_chunks::<2>();
    let (groups, rest) = words.as_chunks::<GROUP>();
    let mut texts = [0; 64 + 8];
    for group in groups {
        let end = out.len() + texts_of::<SEPARATOR>(table, group, &mut texts);
        out.extend_from_slice(&texts[..GROUP_BYTES]);
        out.truncate(end);
    }
    let end = out.len() + texts_of::<SEPARATOR>(table, rest, &mut texts);
    out.extend_from_slice(&texts[..GROUP_BYTES]);
    out.truncate(end);
}

/// Writes the texts of at most `GROUP` numbers, each with the separator after it, and says how long they are together.
#[inline(always)]
#[allow(clippy::inline_always)] // For a whole group, without a loop.
fn texts_of<const SEPARATOR: u8>(table: &[[u8; 8]; 1 << 16], words: &[[u8; 2]], texts: &mut [u8; 64 + 8]) -> usize {
    let mut at = 0;
    for word in words {
        let entry = u64::from_le_bytes(table[usize::from(u16::from_be_bytes(*word))]);
        let length = entry >> 56;
        // The blank after the digits becomes another separator.
        let text = entry ^ u64::from(b' ' ^ SEPARATOR) << (8 * length);
        // The mask shows the compiler that a text begins before byte 43.
        texts[at & 63..][..8].copy_from_slice(&text.to_le_bytes());
        at += length as usize + 1;
    }
    at
}

/// A number with commas between thousands, for people.
///
/// ```
/// assert_eq!(modlens_protocol::decimal::thousands(1_234_567), "1,234,567");
/// ```
pub fn thousands(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Appends a short text by two overlapping copies of fixed size. A copy of variable size costs a function call, which
/// is more than everything else that is done with most texts.
#[inline]
pub fn push_short(text: &[u8], out: &mut Vec<u8>) {
    let (start, length) = (out.len(), text.len());
    if let (Some(head), Some(tail)) = (text.first_chunk::<16>(), text.last_chunk::<16>()) {
        if length > 32 {
            out.extend_from_slice(text);
            return;
        }
        out.extend_from_slice(&[0; 32]);
        out[start..start + 16].copy_from_slice(head);
        out[start + length - 16..start + length].copy_from_slice(tail);
    } else if let (Some(head), Some(tail)) = (text.first_chunk::<8>(), text.last_chunk::<8>()) {
        out.extend_from_slice(&[0; 16]);
        out[start..start + 8].copy_from_slice(head);
        out[start + length - 8..start + length].copy_from_slice(tail);
    } else if let (Some(head), Some(tail)) = (text.first_chunk::<4>(), text.last_chunk::<4>()) {
        out.extend_from_slice(&[0; 8]);
        out[start..start + 4].copy_from_slice(head);
        out[start + length - 4..start + length].copy_from_slice(tail);
    } else {
        for &byte in text {
            out.push(byte);
        }
    }
    out.truncate(start + length);
}

/// The decimal text of every 16-bit number: up to five digits, blanks, and the count of the digits in the last byte.
#[inline]
pub fn decimal_texts() -> &'static [[u8; 8]; 1 << 16] {
    static TABLE: OnceLock<Box<[[u8; 8]; 1 << 16]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut texts: Vec<[u8; 8]> = Vec::with_capacity(1 << 16);
        texts.extend((b'0'..=b'9').map(|digit| [digit, b' ', b' ', b' ', b' ', b' ', b' ', 1]));
        // A number is a tenth of it followed by a digit. It is made at every start, for which `to_string` takes too long.
        for tenth in 1..=usize::from(u16::MAX) / 10 {
            let mut entry = texts[tenth];
            let length = usize::from(entry[7]);
            entry[7] += 1;
            for digit in b'0'..=b'9' {
                entry[length] = digit;
                texts.push(entry);
            }
        }
        texts.truncate(1 << 16);
        texts.try_into().expect("as many texts")
    })
}

/// The same with a comma in place of the first blank: the numbers of a list, of which each is written with the separator after it.
#[inline]
pub fn texts_with_comma() -> &'static [[u8; 8]; 1 << 16] {
    static TABLE: OnceLock<Box<[[u8; 8]; 1 << 16]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut texts = Box::new(*decimal_texts());
        texts.iter_mut().for_each(|entry| entry[usize::from(entry[7])] = b',');
        texts
    })
}

/// Appends an entry of the table. A copy of fixed size followed by truncation is faster than a copy of the right size.
#[inline]
fn push_entry(entry: [u8; 8], out: &mut Vec<u8>) {
    let end = out.len() + entry[7] as usize;
    out.extend_from_slice(&entry);
    out.truncate(end);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_of_all_lengths() {
        let mut value = 1u64;
        while value < 1 << 63 {
            for near in [value - 1, value, value + 1, value / 3 * 2] {
                for signed in [near as i64, -(near as i64)] {
                    let mut out = Vec::new();
                    push_int(signed, &mut out);
                    assert_eq!(String::from_utf8(out).unwrap(), signed.to_string());
                }
            }
            value = value.saturating_mul(7);
        }
        for power in 0..19 {
            for near in [10i64.pow(power) - 1, 10i64.pow(power), 10i64.pow(power) + 10_000] {
                let mut out = Vec::new();
                push_int(near, &mut out);
                assert_eq!(String::from_utf8(out).unwrap(), near.to_string());
            }
        }
        let mut out = Vec::new();
        push_int(i64::MIN, &mut out);
        assert_eq!(String::from_utf8(out).unwrap(), i64::MIN.to_string());
    }

    #[test]
    fn texts_of_all_16_bit_numbers() {
        assert_eq!(decimal_texts().len(), 1 << 16);
        for (value, entry) in decimal_texts().iter().enumerate() {
            assert_eq!(&entry[..usize::from(entry[7])], value.to_string().as_bytes());
            let with_comma = texts_with_comma()[value];
            assert_eq!(&with_comma[..=usize::from(with_comma[7])], format!("{value},").as_bytes());
        }
    }

    #[test]
    fn lists_of_numbers_of_all_lengths() {
        for count in 0..130u32 {
            let numbers: Vec<u16> = (0..count).map(|at| (at.wrapping_mul(2_654_435_761) >> (at % 32)) as u16).collect();
            let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
            let mut out = b"before".to_vec();
            push_words::<b','>(&bytes, &mut out);
            push_words::<b' '>(&bytes, &mut out);
            let texts = numbers.iter().map(|number| format!("{number},")).collect::<Vec<_>>().concat();
            assert_eq!(String::from_utf8(out).unwrap(), format!("before{texts}{}", texts.replace(',', " ")));
        }
    }

    #[test]
    fn short_texts_of_all_lengths() {
        let text: Vec<u8> = (0..100).collect();
        for length in 0..text.len() {
            let mut out = b"before".to_vec();
            push_short(&text[..length], &mut out);
            assert_eq!(out, [b"before", &text[..length]].concat());
        }
    }
}
