//! CSV (RFC 4180): lists joined by single spaces, null empty.

use memchr::memchr3;

use crate::columns::{Cell, Table};
use crate::write::push_plain;

/// Appends the names of the columns as a row.
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
    for row in 0..table.len() {
        let row = table.row(row);
        for (i, &column) in columns.iter().enumerate() {
            if i > 0 {
                out.push(b',');
            }
            push_cell(&row.cell(column), out);
        }
        out.extend_from_slice(b"\r\n");
    }
}

#[inline]
fn push_cell(cell: &Cell<'_>, out: &mut Vec<u8>) {
    match cell {
        Cell::Value(value) if value.is_number() => value.push(out),
        Cell::Text(_) | Cell::Map(_) | Cell::Source(..) | Cell::Value(_) => {
            let start = out.len();
            push_plain(cell, out);
            quote(start, out);
        }
        cell => push_plain(cell, out),
    }
}

/// Text from outside: quoted where it must be, and never the start of a spreadsheet's formula.
fn quote(start: usize, out: &mut Vec<u8>) {
    let text = &out[start..];
    let formula = matches!(text.first(), Some(b'=' | b'+' | b'-' | b'@' | b'\t' | b'\r'));
    let special = memchr3(b',', b'"', b'\n', text).is_some() || text.contains(&b'\r');
    if !formula && !special {
        return;
    }
    let text = out.split_off(start);
    out.push(b'"');
    if formula {
        out.push(b'\'');
    }
    for byte in text {
        if byte == b'"' {
            out.push(b'"');
        }
        out.push(byte);
    }
    out.push(b'"');
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quoted(text: &str) -> String {
        let mut out = Vec::new();
        push_cell(&Cell::Text(text), &mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        assert_eq!(quoted("plain.hex"), "plain.hex");
        assert_eq!(quoted("a,b"), "\"a,b\"");
        assert_eq!(quoted("say \"hi\""), "\"say \"\"hi\"\"\"");
        assert_eq!(quoted("=1+1"), "\"'=1+1\"");
        assert_eq!(quoted("a\nb"), "\"a\nb\"");
    }
}
