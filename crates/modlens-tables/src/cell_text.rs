//! Values as plain text, as in a CSV cell without quotes. Filters compare this text.

use crate::columns::{Cell, Items};
use modlens_profiles::points::push_float;
use modlens_protocol::decimal::{push_int, push_short, push_words};
use modlens_protocol::hex::push_hex;
use modlens_protocol::source::Place;
use modlens_protocol::timestamp::push_time;
use modlens_protocol::Ns;

/// Appends the numbers of a list with one byte between them.
pub fn push_items<const SEPARATOR: u8>(items: &Items<'_>, out: &mut Vec<u8>) {
    let (start, count) = (out.len(), items.len());
    match *items {
        Items::Words(bytes) => push_words::<SEPARATOR>(bytes, out),
        Items::Bits(bytes, _) => {
            for &byte in &bytes[..count.div_ceil(8)] {
                out.extend_from_slice(&const { &bit_texts(SEPARATOR) }[usize::from(byte)]);
            }
            out.truncate(start + 2 * count);
        }
        Items::One(value) => {
            push_int(i64::from(value), out);
            return;
        }
        Items::Numbers(numbers) => {
            for number in numbers {
                push_int(*number as i64, out);
                out.push(SEPARATOR);
            }
        }
    }
    if count > 0 {
        out.pop();
    }
}

/// The bits of each byte as digits, the lowest bit first, each with the separator after it.
pub const fn bit_texts(separator: u8) -> [[u8; 16]; 256] {
    let mut texts = [[separator; 16]; 256];
    let mut at = 0;
    while at < 8 * 256 {
        texts[at / 8][2 * (at % 8)] = b'0' + ((at / 8) as u8 >> (at % 8) & 1);
        at += 1;
    }
    texts
}

/// Appends a duration in microseconds with as many decimals as it has.
#[inline]
pub fn push_us(ns: Ns, out: &mut Vec<u8>) {
    if ns < 0 {
        out.push(b'-');
    }
    let ns = ns.unsigned_abs();
    push_int((ns / 1000) as i64, out);
    let rest = (ns % 1000) as u16;
    if rest != 0 {
        let digits = [b'0' + (rest / 100) as u8, b'0' + (rest / 10 % 10) as u8, b'0' + (rest % 10) as u8];
        out.push(b'.');
        out.extend_from_slice(digits.trim_ascii_end_zeros());
    }
}

trait TrimZeros {
    fn trim_ascii_end_zeros(&self) -> &[u8];
}

impl TrimZeros for [u8; 3] {
    fn trim_ascii_end_zeros(&self) -> &[u8] {
        let length = 3 - self.iter().rev().take_while(|&&digit| digit == b'0').count();
        &self[..length]
    }
}

/// The position of a row in the input as the column `source` shows it: `file@offset`, `file:line` or `file#packet`.
pub fn source_text(file: &str, place: Place, number: u64) -> String {
    format!("{file}{}{number}", place_mark(place) as char)
}

/// Appends the position of a row in the input.
#[inline]
pub fn push_source(file: &str, place: Place, number: u64, out: &mut Vec<u8>) {
    push_short(file.as_bytes(), out);
    out.push(place_mark(place));
    push_int(number as i64, out);
}

/// The character between file and number, which names the kind of position.
fn place_mark(place: Place) -> u8 {
    match place {
        Place::Offset => b'@',
        Place::Line => b':',
        Place::Packet => b'#',
    }
}

/// A value as plain text, as in a CSV cell without quotes. Filters compare this text.
pub fn cell_text(cell: &Cell<'_>) -> String {
    let mut out = Vec::new();
    push_plain(cell, &mut out);
    String::from_utf8(out).unwrap_or_default()
}

/// The text of a truth value.
pub fn bool_text(yes: bool) -> &'static [u8] {
    if yes {
        b"true"
    } else {
        b"false"
    }
}

/// Appends a value as plain text, without any escaping.
pub fn push_plain(cell: &Cell<'_>, out: &mut Vec<u8>) {
    match cell {
        Cell::Null => {}
        Cell::Int(n) => push_int(*n, out),
        Cell::Float(value) => push_float(*value, value, out),
        Cell::Value(value) => value.push(out),
        Cell::Us(ns) => push_us(*ns, out),
        Cell::Time(ns) => push_time(*ns, out),
        Cell::Bool(yes) => out.extend_from_slice(bool_text(*yes)),
        Cell::Word(text) | Cell::Text(text) => push_short(text.as_bytes(), out),
        Cell::Hex(bytes) => push_hex(bytes, out),
        Cell::Ints(items) => push_items::<b' '>(items, out),
        Cell::Codes(codes) => {
            for (i, code) in codes.iter().enumerate() {
                if i > 0 {
                    out.push(b' ');
                }
                push_short(code.doc().code.as_bytes(), out);
            }
        }
        Cell::Fields(fields) => fields.push_json(out),
        Cell::Map(map) => out.extend_from_slice(map.to_string().as_bytes()),
        Cell::Source(file, place, number) => push_source(file, *place, *number, out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_digits_from_the_lowest_on() {
        let mut out = Vec::new();
        // Section 6.1 of the application protocol: CD 6B 05 are coils 20 to 38, 20 being the lowest bit of CD.
        push_items::<b' '>(&Items::Bits(&[0xCD, 0x6B, 0x05], 19), &mut out);
        assert_eq!(String::from_utf8(out).unwrap(), "1 0 1 1 0 0 1 1 1 1 0 1 0 1 1 0 1 0 1");
        for byte in 0..=255u8 {
            let mut out = Vec::new();
            push_items::<b';'>(&Items::Bits(&[byte], 8), &mut out);
            let digits: Vec<u8> = (0..8).flat_map(|bit| [b'0' + (byte >> bit & 1), b';']).collect();
            assert_eq!(out, digits[..15]);
        }
    }

    #[test]
    fn microseconds() {
        let text = |ns| {
            let mut out = Vec::new();
            push_us(ns, &mut out);
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(0), "0");
        assert_eq!(text(1_234_567), "1234.567");
        assert_eq!(text(1_500), "1.5");
        assert_eq!(text(-20), "-0.02");
        assert_eq!(text(7_000), "7");
    }
}
