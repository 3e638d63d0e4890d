//! Rows as text, Arrow and captures, straight from the columns.

pub mod arrow;
pub mod capture;
pub mod csv;
#[cfg(feature = "files")]
pub mod files;
pub mod influx;
pub mod jsonl;
pub mod recording;
mod time;
pub mod zeek;

use std::sync::OnceLock;

use crate::columns::{Cell, Items};
use crate::pdu::push_hex;
use crate::points::push_float;
use crate::records::Place;
use crate::Ns;

pub use time::{day_number, push_time};

/// Appends an integer.
#[inline]
pub fn push_int(value: i64, out: &mut Vec<u8>) {
    if let Some(entry) = usize::try_from(value).ok().and_then(|value| decimals().get(value)) {
        push_entry(*entry, out);
        return;
    }
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

/// Numbers of 16 bits as text: up to five digits, and how many they are in the last byte.
fn decimals() -> &'static [[u8; 8]] {
    static TABLE: OnceLock<Vec<[u8; 8]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        (0..=u16::MAX)
            .map(|value| {
                let mut entry = [0; 8];
                let mut buffer = itoa::Buffer::new();
                let text = buffer.format(value).as_bytes();
                entry[..text.len()].copy_from_slice(text);
                entry[7] = text.len() as u8;
                entry
            })
            .collect()
    })
}

/// A copy of fixed size and a cut are faster than a copy of the right size.
#[inline]
fn push_entry(entry: [u8; 8], out: &mut Vec<u8>) {
    let end = out.len() + entry[7] as usize;
    out.extend_from_slice(&entry);
    out.truncate(end);
}

/// Appends the numbers of a list with one byte between them.
///
/// Most of a table is registers: each is one look-up and one copy of fixed size.
pub fn push_items(items: &Items<'_>, between: u8, out: &mut Vec<u8>) {
    let (start, count) = (out.len(), items.len());
    match *items {
        Items::Words(bytes) => {
            let table = decimals();
            // Copies of eight bytes go beyond the last number.
            out.resize(start + 6 * count + 8, 0);
            let mut at = start;
            for word in bytes.chunks_exact(2) {
                let entry = &table[usize::from(u16::from_be_bytes([word[0], word[1]]))];
                out[at..at + 8].copy_from_slice(entry);
                at += usize::from(entry[7]);
                out[at] = between;
                at += 1;
            }
            out.truncate(at);
        }
        Items::Bits(bytes, _) => {
            out.resize(start + 2 * count, between);
            for (i, digit) in out[start..].iter_mut().step_by(2).enumerate() {
                *digit = b'0' + (bytes[i / 8] >> (i % 8) & 1);
            }
        }
        Items::One(value) => {
            push_int(i64::from(value), out);
            return;
        }
    }
    if count > 0 {
        out.pop();
    }
}

/// Appends nanoseconds as microseconds, with as many decimals as there are.
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

/// Where a row stands, as `source` spells it.
pub fn source_text(file: &str, place: Place, number: u64) -> String {
    format!("{file}{}{number}", place_mark(place) as char)
}

fn place_mark(place: Place) -> u8 {
    match place {
        Place::Offset => b'@',
        Place::Line => b':',
        Place::Packet => b'#',
    }
}

/// A value as plain text: the spelling of CSV cells and of text comparisons.
pub fn cell_text(cell: &Cell<'_>) -> String {
    let mut out = Vec::new();
    push_plain(cell, &mut out);
    String::from_utf8(out).unwrap_or_default()
}

/// Appends a value as plain text, without any escaping.
fn push_plain(cell: &Cell<'_>, out: &mut Vec<u8>) {
    match cell {
        Cell::Null => {}
        Cell::Int(n) => push_int(*n, out),
        Cell::Float(value) => push_float(*value, value, out),
        Cell::Value(value) => value.push(out),
        Cell::Us(ns) => push_us(*ns, out),
        Cell::Time(ns) => push_time(*ns, out),
        Cell::Bool(yes) => out.extend_from_slice(if *yes { b"true" } else { b"false" }),
        Cell::Word(text) | Cell::Text(text) => out.extend_from_slice(text.as_bytes()),
        Cell::Hex(bytes) => push_hex(bytes, out),
        Cell::Ints(items) => push_items(items, b' ', out),
        Cell::Codes(codes) => {
            for (i, code) in codes.iter().enumerate() {
                if i > 0 {
                    out.push(b' ');
                }
                out.extend_from_slice(code.doc().code.as_bytes());
            }
        }
        Cell::Map(map) => out.extend_from_slice(map.to_string().as_bytes()),
        Cell::Source(file, place, number) => {
            out.extend_from_slice(file.as_bytes());
            out.push(place_mark(*place));
            push_int(*number as i64, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
