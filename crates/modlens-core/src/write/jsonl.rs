//! JSON lines: one object a row, null omitted.

use crate::columns::{Cell, Table};
use crate::write::{push_items, push_plain};

/// Appends the rows of a table.
pub fn rows(table: &Table, columns: &[usize], out: &mut Vec<u8>) {
    let keys: Vec<Vec<u8>> =
        columns.iter().map(|&column| format!("\"{}\":", table.kind.columns()[column].key).into_bytes()).collect();
    for row in 0..table.len() {
        out.push(b'{');
        let start = out.len();
        let row = table.row(row);
        for (key, &column) in keys.iter().zip(columns) {
            let cell = row.cell(column);
            if matches!(cell, Cell::Null) {
                continue;
            }
            if out.len() > start {
                out.push(b',');
            }
            out.extend_from_slice(key);
            push_cell(&cell, out);
        }
        out.extend_from_slice(b"}\n");
    }
}

#[inline]
fn push_cell(cell: &Cell<'_>, out: &mut Vec<u8>) {
    match cell {
        Cell::Int(_) | Cell::Float(_) | Cell::Us(_) | Cell::Bool(_) | Cell::Map(_) => push_plain(cell, out),
        Cell::Word(_) | Cell::Hex(_) | Cell::Time(_) => {
            out.push(b'"');
            push_plain(cell, out);
            out.push(b'"');
        }
        Cell::Ints(items) => {
            out.push(b'[');
            push_items(items, b',', out);
            out.push(b']');
        }
        Cell::Codes(codes) => {
            out.push(b'[');
            for (i, code) in codes.iter().enumerate() {
                if i > 0 {
                    out.push(b',');
                }
                out.push(b'"');
                out.extend_from_slice(code.doc().code.as_bytes());
                out.push(b'"');
            }
            out.push(b']');
        }
        other => {
            out.push(b'"');
            let start = out.len();
            push_plain(other, out);
            if out[start..].iter().any(|&byte| special(byte)) {
                let text = out.split_off(start);
                push_escaped(&text, out);
            }
            out.push(b'"');
        }
    }
}

fn special(byte: u8) -> bool {
    matches!(byte, b'"' | b'\\' | 0..0x20 | 0x7F)
}

/// Text is valid UTF-8 already; what JSON forbids raw is escaped.
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
