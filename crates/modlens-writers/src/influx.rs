//! `InfluxDB` line protocol with the names that Telegraf's Modbus plugin uses, so that dashboards made for it work.
//!
//! Readings: `modbus,name=BUS,bus=BUS,slave_id=1,type=holding_register POINT=42 NS`, with the values of one frame in
//! one line. Transactions: `modbus_transaction,bus=...,slave_id=...,function=...,status=...
//! response_time_us=...,length=...i NS`. A row without a time cannot be stored in a time series: it is counted and left
//! out.

use modlens_protocol::decimal::push_int;
use modlens_tables::cell_text::{push_plain, push_us};
use modlens_tables::columns::{Cell, Table, TableKind};

/// The indices of columns of a table; all names are in `columns.toml`.
fn columns_of<const N: usize>(kind: TableKind, keys: [&str; N]) -> [usize; N] {
    keys.map(|key| kind.column(key).expect("a column"))
}

/// Appends the rows of a table (readings or transactions). Returns the number of rows that were left out because they
/// have no time.
pub fn rows(table: &Table, out: &mut Vec<u8>) -> usize {
    if table.kind == TableKind::Readings {
        readings(table, out)
    } else {
        transactions(table, out)
    }
}

/// Appends readings; consecutive ones of the same frame share a line.
fn readings(table: &Table, out: &mut Vec<u8>) -> usize {
    let keys = ["time", "bus", "unit", "register_type", "address", "status", "name", "value", "value_text", "frame", "operation"];
    let [time, bus, unit, kind, address, status, name, value, text, frame, operation] = columns_of(TableKind::Readings, keys);
    let mut left_out = 0;
    let mut line: Option<(i64, i64, bool)> = None;
    for row in 0..table.len() {
        // A write that was refused or not answered is not a value of the register.
        if !matches!(table.cell(row, status), Cell::Word("ok" | "broadcast" | "unsolicited")) {
            continue;
        }
        let (Cell::Time(ns), Cell::Int(number)) = (table.cell(row, time), table.cell(row, frame)) else {
            left_out += 1;
            continue;
        };
        let Some(point) = point(table, row, name, address) else { continue };
        let written = matches!(table.cell(row, operation), Cell::Word("write"));
        let key = (ns, number, written);
        if line == Some(key) {
            out.pop(); // the line end, because the line is continued
            let tail = format!(" {ns}");
            out.truncate(out.len() - tail.len());
            out.push(b',');
        } else {
            out.extend_from_slice(b"modbus");
            push_tag("name", &table.cell(row, bus), out);
            push_tag("bus", &table.cell(row, bus), out);
            push_tag("slave_id", &table.cell(row, unit), out);
            push_tag("type", &table.cell(row, kind), out);
            out.push(b' ');
        }
        line = Some(key);
        push_escaped(point.as_bytes(), out);
        out.push(b'=');
        match (table.cell(row, value), table.cell(row, text)) {
            (Cell::Null, text) => push_quoted(&text, out),
            (number, _) => push_plain(&number, out),
        }
        end_line(ns, out);
    }
    left_out
}

/// The name of the point, or the address of a bare register.
fn point(table: &Table, row: usize, name: usize, address: usize) -> Option<String> {
    match (table.cell(row, name), table.cell(row, address)) {
        (Cell::Text(name) | Cell::Word(name), _) => Some(name.to_owned()),
        (_, Cell::Int(address)) => Some(format!("address_{address}")),
        _ => None,
    }
}

/// Appends one line per transaction. Returns the number of rows without a time.
fn transactions(table: &Table, out: &mut Vec<u8>) -> usize {
    let keys = ["time", "bus", "unit", "function", "status", "response_time_us", "request_hex", "response_hex"];
    let [time, bus, unit, function, status, response_time, request, response] = columns_of(TableKind::Transactions, keys);
    let mut left_out = 0;
    for row in 0..table.len() {
        let Cell::Time(ns) = table.cell(row, time) else {
            left_out += 1;
            continue;
        };
        out.extend_from_slice(b"modbus_transaction");
        for (key, column) in [("bus", bus), ("slave_id", unit), ("function", function), ("status", status)] {
            push_tag(key, &table.cell(row, column), out);
        }
        out.push(b' ');
        if let Cell::Us(ns) = table.cell(row, response_time) {
            out.extend_from_slice(b"response_time_us=");
            push_us(ns, out);
            out.push(b',');
        }
        let bytes = |column| if let Cell::Hex(bytes) = table.cell(row, column) { bytes.len() } else { 0 };
        out.extend_from_slice(b"length=");
        push_int((bytes(request) + bytes(response)) as i64, out);
        out.push(b'i');
        end_line(ns, out);
    }
    left_out
}

/// Appends the time and the end of the line.
fn end_line(ns: i64, out: &mut Vec<u8>) {
    out.push(b' ');
    push_int(ns, out);
    out.push(b'\n');
}

/// Appends a tag, unless its value is empty.
fn push_tag(key: &str, value: &Cell<'_>, out: &mut Vec<u8>) {
    let start = out.len();
    out.push(b',');
    out.extend_from_slice(key.as_bytes());
    out.push(b'=');
    let value_start = out.len();
    push_plain(value, out);
    let text = out.split_off(value_start);
    // The protocol does not allow a tag without a value.
    if text.is_empty() {
        out.truncate(start);
    } else {
        push_escaped(&text, out);
    }
}

/// Appends text with comma, equals sign and space escaped. Line ends cannot be escaped and are replaced.
fn push_escaped(text: &[u8], out: &mut Vec<u8>) {
    for &byte in text {
        match byte {
            b',' | b'=' | b' ' => out.extend_from_slice(&[b'\\', byte]),
            b'\n' | b'\r' => out.push(b'_'),
            _ => out.push(byte),
        }
    }
    // A backslash at the end would escape the next character of the protocol.
    if text.last() == Some(&b'\\') {
        out.push(b'_');
    }
}

/// Appends a field value as a quoted string.
fn push_quoted(text: &Cell<'_>, out: &mut Vec<u8>) {
    let start = out.len();
    push_plain(text, out);
    let text = out.split_off(start);
    out.push(b'"');
    for byte in text {
        match byte {
            b'"' | b'\\' => out.extend_from_slice(&[b'\\', byte]),
            b'\n' | b'\r' => out.push(b' '),
            _ => out.push(byte),
        }
    }
    out.push(b'"');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_are_escaped_and_never_empty() {
        let text = |cell: &Cell<'_>| {
            let mut out = Vec::new();
            push_tag("bus", cell, &mut out);
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(&Cell::Text("a b,c=d")), ",bus=a\\ b\\,c\\=d");
        assert_eq!(text(&Cell::Null), "");
        assert_eq!(text(&Cell::Text("x\ny\\")), ",bus=x_y\\_");
    }
}
