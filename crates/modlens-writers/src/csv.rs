//! CSV (RFC 4180): how values look. Lists are joined by single spaces, null is empty.
//!
//! Lines are made by `lines`, those of compact exchanges (nearly all) by `exchange_lines`: speed is decided there.

use std::mem::ManuallyDrop;

use memchr::memchr3;

use crate::line_format::{FileNameCheck, LineFormat};
use crate::text_block::Separator;
use crate::LineWriter;
use modlens_protocol::decimal::{push_int, push_short};
use modlens_protocol::hex::push_hex;
use modlens_protocol::timestamp::TimeFormatter;
use modlens_tables::cell_text::{bool_text, push_items, push_plain, push_source, push_us};
use modlens_tables::columns::{Cell, CellSink, Table};

/// Appends the header.
pub fn header(keys: &[&str], out: &mut Vec<u8>) {
    for (i, key) in keys.iter().enumerate() {
        if i > 0 {
            out.push(b',');
        }
        out.extend_from_slice(key.as_bytes());
    }
    out.extend_from_slice(b"\r\n");
}

/// Appends the rows of a table.
pub fn rows(table: &Table, columns: &[usize], out: &mut Vec<u8>) {
    LineWriter::<Csv>::new(table.kind, columns).all(table, out);
}

/// A line of CSV.
#[derive(Default)]
pub struct Csv {
    out: Vec<u8>,
    stamp: TimeFormatter,
    source: FileNameCheck,
}

impl LineFormat for Csv {
    const QUOTE: &str = "";
    const LIST_MARKS: [&str; 2] = ["", ""];
    const SEPARATOR: Separator = Separator::Blank;

    fn columns(&mut self, _: &[&str]) {}

    #[inline]
    fn out(&mut self) -> &mut Vec<u8> {
        &mut self.out
    }

    #[inline]
    fn column(&mut self, _: usize) {}

    fn push_key(&mut self, _: usize) {}

    #[inline]
    fn end_value(&mut self) {
        self.out.push(b',');
    }

    #[inline]
    fn complete(texts: &mut [Vec<u8>]) {
        let Some(last) = texts.last_mut() else { return };
        last.pop(); // the comma after the last value
        last.extend_from_slice(b"\r\n");
    }
}

impl CellSink for Csv {
    #[inline(always)]
    #[allow(clippy::inline_always)] // Reduces the match to one arm in each caller.
    fn put_cell(&mut self, cell: Cell<'_>) {
        let out = &mut self.out;
        let cell = ManuallyDrop::new(cell);
        match *cell {
            Cell::Null | Cell::Codes([]) => {}
            Cell::Int(n) => push_int(n, out),
            Cell::Us(ns) => push_us(ns, out),
            Cell::Time(ns) => self.stamp.push(ns, out),
            Cell::Bool(yes) => push_short(bool_text(yes), out),
            Cell::Word(text) => push_short(text.as_bytes(), out),
            Cell::Hex(bytes) => push_hex(bytes, out),
            Cell::Ints(ref items) => push_items::<b' '>(items, out),
            Cell::Source(file, place, number) if self.source.plain(file, needs_quotes) => push_source(file, place, number, out),
            _ => push_input_text(&ManuallyDrop::into_inner(cell), out),
        }
    }
}

/// Values that may contain text from the input, which may need quotes.
#[inline(never)]
fn push_input_text(cell: &Cell<'_>, out: &mut Vec<u8>) {
    let start = out.len();
    push_plain(cell, out);
    let never_needs_quotes = match cell {
        Cell::Value(value) => value.is_number(),
        cell => !matches!(cell, Cell::Text(_) | Cell::Fields(_) | Cell::Map(_) | Cell::Source(..)),
    };
    if !never_needs_quotes {
        quote(start, out);
    }
}

/// Whether a text has to be quoted.
fn needs_quotes(text: &[u8]) -> bool {
    is_formula(text) || memchr3(b',', b'"', b'\n', text).is_some() || text.iter().any(|&byte| is_control(byte))
}

/// Whether the byte is a control character, with which a terminal that shows the file would be controlled.
fn is_control(byte: u8) -> bool {
    byte < b' ' || byte == 0x7F
}

/// Whether a spreadsheet would interpret the text as a formula.
fn is_formula(text: &[u8]) -> bool {
    matches!(text.first(), Some(b'=' | b'+' | b'-' | b'@' | b'\t' | b'\r'))
}

/// Quotes the text from `start` on where necessary. An apostrophe prevents a spreadsheet from interpreting it as a
/// formula, which could run commands.
fn quote(start: usize, out: &mut Vec<u8>) {
    if !needs_quotes(&out[start..]) {
        return;
    }
    let is_formula = is_formula(&out[start..]);
    let text = out.split_off(start);
    out.push(b'"');
    if is_formula {
        out.push(b'\'');
    }
    for byte in text {
        if byte == b'"' {
            out.push(b'"');
        }
        // Line ends and tabs are part of a text; other control characters are replaced.
        out.push(if is_control(byte) && !matches!(byte, b'\n' | b'\r' | b'\t') { b'?' } else { byte });
    }
    out.push(b'"');
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quoted(text: &str) -> String {
        let mut line = Csv::default();
        line.put_cell(Cell::Text(text));
        String::from_utf8(line.out).unwrap()
    }

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        assert_eq!(quoted("plain.hex"), "plain.hex");
        assert_eq!(quoted("a,b"), "\"a,b\"");
        assert_eq!(quoted("say \"hi\""), "\"say \"\"hi\"\"\"");
        assert_eq!(quoted("=1+1"), "\"'=1+1\"");
        assert_eq!(quoted("a\nb"), "\"a\nb\"");
        assert_eq!(quoted("a\x1b[31mb"), "\"a?[31mb\"");
    }
}
