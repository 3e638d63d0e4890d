//! Rows as text, Arrow and captures, straight from the columns.

pub mod arrow;
pub mod capture;
pub mod csv;
#[cfg(feature = "files")]
pub mod files;
pub mod influx;
pub mod jsonl;
pub mod lines;
#[cfg(feature = "files")]
mod parquet;
pub mod recording;
mod time;
mod values;
pub mod zeek;

use std::sync::OnceLock;

use crate::columns::{Cell, Items};
use crate::pdu::push_hex;
use crate::points::push_float;
use crate::records::Place;
use crate::Ns;

pub use lines::Lines;
pub use time::{day_number, push_time, Stamp};

/// Appends an integer.
#[inline]
pub fn push_int(value: i64, out: &mut Vec<u8>) {
    if value < 0 {
        out.push(b'-');
    }
    push_whole(value.unsigned_abs(), out);
}

/// Four digits at a time, looked up: nothing is divided for most numbers of a table.
fn push_whole(value: u64, out: &mut Vec<u8>) {
    if let Some(entry) = decimals().get(value as usize) {
        push_entry(*entry, out);
        return;
    }
    push_whole(value / 10_000, out);
    // A number with a one in front of them shows zeros, too.
    let [_, a, b, c, d, ..] = decimals()[10_000 + (value % 10_000) as usize];
    out.extend_from_slice(&[a, b, c, d]);
}

/// Appends a short text: a copy of a size that only the text knows costs more than all else that is done with it.
#[inline]
pub(crate) fn push_short(text: &[u8], out: &mut Vec<u8>) {
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

/// Numbers of 16 bits as text: up to five digits, and how many they are in the last byte.
fn decimals() -> &'static [[u8; 8]] {
    static TABLE: OnceLock<Vec<[u8; 8]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        (0..=u16::MAX)
            .map(|value| {
                let text = value.to_string();
                let mut entry = [0; 8];
                entry[..text.len()].copy_from_slice(text.as_bytes());
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

/// Appends where a row stands.
#[inline]
fn push_source(file: &str, place: Place, number: u64, out: &mut Vec<u8>) {
    push_short(file.as_bytes(), out);
    out.push(place_mark(place));
    push_int(number as i64, out);
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

fn truth(yes: bool) -> &'static [u8] {
    if yes {
        b"true"
    } else {
        b"false"
    }
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
        Cell::Bool(yes) => out.extend_from_slice(truth(*yes)),
        Cell::Word(text) | Cell::Text(text) => push_short(text.as_bytes(), out),
        Cell::Hex(bytes) => push_hex(bytes, out),
        Cell::Ints(items) => push_items(items, b' ', out),
        Cell::Codes(codes) => {
            for (i, code) in codes.iter().enumerate() {
                if i > 0 {
                    out.push(b' ');
                }
                push_short(code.doc().code.as_bytes(), out);
            }
        }
        Cell::Fields(fields) => fields.push(out),
        Cell::Map(map) => out.extend_from_slice(map.to_string().as_bytes()),
        Cell::Source(file, place, number) => push_source(file, *place, *number, out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_of_all_lengths() {
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
        let mut out = Vec::new();
        push_int(i64::MIN, &mut out);
        assert_eq!(String::from_utf8(out).unwrap(), i64::MIN.to_string());
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
