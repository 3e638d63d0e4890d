//! JSON lines: one object per row. Columns without a value are omitted.

use std::mem::ManuallyDrop;

use crate::line_format::{FileNameCheck, LineFormat};
use crate::text_block::Separator;
use crate::LineWriter;
use modlens_protocol::decimal::{push_int, push_short};
use modlens_protocol::finding::Finding;
use modlens_protocol::hex::push_hex;
use modlens_protocol::timestamp::TimeFormatter;
use modlens_tables::cell_text::{bool_text, push_items, push_plain, push_source, push_us};
use modlens_tables::columns::{Cell, CellSink, Table};

/// Appends the rows of a table.
pub fn rows(table: &Table, columns: &[usize], out: &mut Vec<u8>) {
    LineWriter::<Jsonl>::new(table.kind, columns).all(table, out);
}

/// Writes a line of JSON.
#[derive(Default)]
pub struct Jsonl {
    out: Vec<u8>,
    stamp: TimeFormatter,
    source: FileNameCheck,
    keys: Vec<KeyText>,
    /// The index of the current column.
    at: usize,
}

/// Room for the longest column name with a comma, quotes and a colon around it. A copy of fixed size is faster.
const KEY_BYTES: usize = 32;

/// The text before a value: a comma, the quoted name of the column, a colon.
#[derive(Clone, Copy)]
struct KeyText {
    bytes: [u8; KEY_BYTES],
    length: usize,
}

impl KeyText {
    fn new(name: &str) -> Self {
        let text = format!(",\"{name}\":");
        let mut bytes = [0; KEY_BYTES];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Self { bytes, length: text.len() }
    }
}

impl LineFormat for Jsonl {
    const QUOTE: &str = "\"";
    const LIST_MARKS: [&str; 2] = ["[", "]"];
    const SEPARATOR: Separator = Separator::Comma;

    fn columns(&mut self, keys: &[&str]) {
        self.keys = keys.iter().map(|key| KeyText::new(key)).collect();
    }

    #[inline]
    fn out(&mut self) -> &mut Vec<u8> {
        &mut self.out
    }

    #[inline]
    fn column(&mut self, at: usize) {
        self.at = at;
    }

    #[inline]
    fn push_key(&mut self, at: usize) {
        let KeyText { bytes, length } = self.keys[at];
        let end = self.out.len() + length;
        self.out.extend_from_slice(&bytes);
        self.out.truncate(end);
    }

    #[inline]
    fn end_value(&mut self) {}

    /// The comma before the first value is replaced by the opening brace.
    #[inline]
    fn complete(texts: &mut [Vec<u8>]) {
        if let Some(first) = texts.first_mut() {
            match first.first_mut() {
                Some(comma) => *comma = b'{',
                None => first.push(b'{'),
            }
        }
        if let Some(last) = texts.last_mut() {
            last.extend_from_slice(b"}\n");
        }
    }
}

impl CellSink for Jsonl {
    #[inline(always)]
    #[allow(clippy::inline_always)] // Reduces the match to one arm in each caller.
    fn put_cell(&mut self, cell: Cell<'_>) {
        let cell = ManuallyDrop::new(cell);
        if matches!(*cell, Cell::Null) {
            return;
        }
        self.push_key(self.at);
        let out = &mut self.out;
        match *cell {
            Cell::Int(n) => push_int(n, out),
            Cell::Us(ns) => push_us(ns, out),
            Cell::Bool(yes) => push_short(bool_text(yes), out),
            Cell::Word(text) => quoted(out, |out| push_short(text.as_bytes(), out)),
            Cell::Hex(bytes) => quoted(out, |out| push_hex(bytes, out)),
            Cell::Time(ns) => quoted(out, |out| self.stamp.push(ns, out)),
            Cell::Ints(ref items) => {
                out.push(b'[');
                push_items::<b','>(items, out);
                out.push(b']');
            }
            Cell::Codes(codes) => push_codes(codes, out),
            Cell::Source(file, place, number) if self.source.plain(file, needs_escapes) => {
                quoted(out, |out| push_source(file, place, number, out));
            }
            _ => push_input_text(&ManuallyDrop::into_inner(cell), out),
        }
    }
}

#[inline]
fn push_codes(codes: &[Finding], out: &mut Vec<u8>) {
    out.push(b'[');
    for (i, code) in codes.iter().enumerate() {
        out.extend_from_slice(if i > 0 { b",\"" } else { b"\"" });
        push_short(code.doc().code.as_bytes(), out);
        out.push(b'"');
    }
    out.push(b']');
}

#[inline]
fn quoted(out: &mut Vec<u8>, push: impl FnOnce(&mut Vec<u8>)) {
    out.push(b'"');
    push(out);
    out.push(b'"');
}

/// Values that may contain text from the input, which may need escaping.
#[inline(never)]
fn push_input_text(cell: &Cell<'_>, out: &mut Vec<u8>) {
    if matches!(cell, Cell::Float(_) | Cell::Fields(_) | Cell::Map(_)) {
        return push_plain(cell, out);
    }
    quoted(out, |out| {
        let start = out.len();
        push_plain(cell, out);
        if needs_escapes(&out[start..]) {
            let text = out.split_off(start);
            push_escaped(&text, out);
        }
    });
}

/// Whether the text contains a byte that JSON does not allow in a string.
fn needs_escapes(text: &[u8]) -> bool {
    text.iter().any(|byte| matches!(byte, b'"' | b'\\' | 0..0x20 | 0x7F))
}

/// Appends text with the escapes that JSON requires. The text is valid UTF-8 already.
fn push_escaped(text: &[u8], out: &mut Vec<u8>) {
    for &byte in text {
        match byte {
            b'"' | b'\\' => out.extend_from_slice(&[b'\\', byte]),
            b'\n' => out.extend_from_slice(b"\\n"),
            0..0x20 | 0x7F => out.extend_from_slice(format!("\\u{byte:04x}").as_bytes()),
            _ => out.push(byte),
        }
    }
}
