//! The text of the cells in tables: addresses, values, times in milliseconds, states and their styles.

use modlens_protocol::register_type::{Space, LAST_ADDRESS};
use serde_json::Value as Json;

use crate::view::notation::AddressNotation;
use crate::view::safe_text::{push_visible, visible};
use crate::view::style::Style;
use crate::view::value_list::ValueList;
use modlens_tables::columns::{Cell, Items, RowRef, TableKind};

/// Durations of at least this many microseconds are shown without tenths of a millisecond.
const WHOLE_MS_FROM_US: f64 = 100_000.0;

/// The number of bits shown as one group, in wire order.
const BITS_PER_GROUP: usize = 8;

/// Finds the columns of a table by name.
#[derive(Clone, Copy)]
pub struct ColumnLookup(pub TableKind);

impl ColumnLookup {
    /// The index of a column, which must exist.
    pub fn at(self, key: &str) -> usize {
        self.0.column(key).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// The number in a column of a row.
pub fn number(row: &RowRef<'_>, column: usize) -> Option<i64> {
    match row.cell(column) {
        Cell::Int(number) => Some(number),
        _ => None,
    }
}

/// The text in a column of a row.
pub fn word<'a>(row: &RowRef<'a>, column: usize) -> Option<&'a str> {
    match row.cell(column) {
        Cell::Word(text) | Cell::Text(text) => Some(text),
        _ => None,
    }
}

/// The value in a column of a row, as text.
pub fn text(row: &RowRef<'_>, column: usize) -> String {
    modlens_tables::cell_text::cell_text(&row.cell(column))
}

/// A duration in milliseconds: `1.2`, `250`.
pub fn milliseconds(row: &RowRef<'_>, column: usize) -> Option<String> {
    match row.cell(column) {
        Cell::Us(ns) => {
            let us = ns as f64 / 1e3;
            Some(format!("{:.*}", usize::from(us < WHOLE_MS_FROM_US), us / 1e3))
        }
        _ => None,
    }
}

/// The short name of a table: `hr`, `ir`, `co` or `di`.
pub fn short_name(kind: Option<&str>) -> Option<&'static str> {
    Space::from_word(kind?).map(Space::short_name)
}

fn is_bits(kind: Option<&str>) -> bool {
    kind.and_then(Space::from_word).is_some_and(Space::is_bits)
}

/// A range of addresses: `107-109`, `40108`. It ends at 65535 even if the request asked for more.
pub fn address_range(first: Option<i64>, quantity: Option<i64>, kind: Option<&str>, base: AddressNotation) -> String {
    let Some(first) = first else { return String::new() };
    let text = |wire: i64| base.address(wire.clamp(0, LAST_ADDRESS.into()) as u32, kind.and_then(Space::from_word));
    match quantity {
        None | Some(0 | 1) => text(first),
        Some(quantity) => format!("{}-{}", text(first), text(first + quantity - 1)),
    }
}

/// The code and name of a function: `  3 Read Holding Registers`.
pub fn function_long(code: Option<i64>, name: Option<&str>) -> String {
    code.map_or_else(String::new, |code| format!("{code:3} {}", visible(name.unwrap_or("unknown"))))
}

/// The code of a function and the access it makes: ` 3 read hr`.
pub fn function_short(code: Option<i64>, name: Option<&str>, operation: Option<&str>, kind: Option<&str>) -> String {
    let Some(code) = code else { return String::new() };
    let does = match operation {
        Some("read") => "read",
        Some("write") => "write",
        Some("read_write") => "r/w",
        _ => "",
    };
    match short_name(kind) {
        Some(short_name) if !does.is_empty() => format!("{code:2} {does} {short_name}"),
        _ => format!("{code:2} {}", visible(name.unwrap_or("unknown"))),
    }
}

/// The finding codes of a row, separated by commas and without duplicates. A code that equals the row's state is left
/// out.
pub fn findings(row: &RowRef<'_>, column: usize, state: &str) -> String {
    let Cell::Codes(codes) = row.cell(column) else { return String::new() };
    let mut codes_shown: Vec<&str> = Vec::new();
    for code in codes.iter().map(|finding| finding.doc().code) {
        if code != state && !codes_shown.contains(&code) {
            codes_shown.push(code);
        }
    }
    codes_shown.join(",")
}

/// The columns that contain the values of a transaction.
#[derive(Clone, Copy)]
pub struct TransactionValues {
    readings: usize,
    data: usize,
    operation: usize,
    register_type: usize,
    write_address: usize,
    write_quantity: usize,
    write_data: usize,
    fields: usize,
}

impl TransactionValues {
    /// Looks up the columns.
    pub fn new(keys: ColumnLookup) -> Self {
        Self {
            readings: keys.at("readings"),
            data: keys.at("data"),
            operation: keys.at("operation"),
            register_type: keys.at("register_type"),
            write_address: keys.at("write_address"),
            write_quantity: keys.at("write_quantity"),
            write_data: keys.at("write_data"),
            fields: keys.at("fields"),
        }
    }

    /// The values of a transaction: values read, values written, decoded fields.
    ///
    /// Where a profile names the values, their names and values replace the registers.
    pub fn values<'a>(self, row: &RowRef<'a>, base: AddressNotation) -> ValueList<'a> {
        if let Cell::Map(Json::Object(named)) = row.cell(self.readings) {
            let named_value = |(name, value): (&String, &Json)| (visible(name), visible(&reading(value)));
            return ValueList::Named(named.iter().map(named_value).collect());
        }
        let (data, kind) = (ints(row.cell(self.data)), word(row, self.register_type));
        let does = word(row, self.operation);
        if let (Some(items), Some("read"), false) = (data, does, is_bits(kind)) {
            return ValueList::Numbers(items); // the case of nearly every row
        }
        let mut texts = Vec::new();
        if let Some(items) = data {
            push_block(&items, kind, &mut texts);
        }
        if does == Some("read_write") {
            let first = number(row, self.write_address);
            texts.push((format!("{}:", address_range(first, number(row, self.write_quantity), kind, base)), 0));
        }
        if let Some(items) = ints(row.cell(self.write_data)) {
            push_block(&items, kind, &mut texts);
        }
        if let cell @ Cell::Fields(_) = row.cell(self.fields) {
            let fields: serde_json::Map<String, Json> =
                serde_json::from_str(&modlens_tables::cell_text::cell_text(&cell)).unwrap_or_default();
            // Texts come first; the objects that they were made of need not be shown again.
            let names = fields.get("identification").and_then(Json::as_object);
            for (key, value) in names.into_iter().flatten() {
                texts.push((visible(&format!("{key}={value}")), 1));
            }
            let is_shown = |key: &str| key != "byte_count" && (names.is_none() || !matches!(key, "identification" | "objects"));
            for (key, value) in fields.iter().filter(|(key, _)| is_shown(key)) {
                texts.push((visible(&format!("{key}={}", field(value))), 1));
            }
        }
        ValueList::Texts(texts)
    }
}

fn ints(cell: Cell<'_>) -> Option<Items<'_>> {
    match cell {
        Cell::Ints(items) => Some(items),
        _ => None,
    }
}

/// Appends registers one by one and bits in groups, each with the number of values that it represents.
fn push_block(items: &Items<'_>, kind: Option<&str>, texts: &mut Vec<(String, usize)>) {
    let group = if is_bits(kind) { BITS_PER_GROUP } else { 1 };
    for start in (0..items.len()).step_by(group) {
        let end = (start + group).min(items.len());
        texts.push(((start..end).map(|index| items.get(index).to_string()).collect(), end - start));
    }
}

/// The text of a converted value.
fn reading(value: &Json) -> String {
    if value.is_null() {
        "-".into()
    } else {
        field(value)
    }
}

/// The text of a decoded field, on one line.
fn field(value: &Json) -> String {
    let joined = |parts: Vec<String>| parts.join(" ");
    match value {
        Json::Object(map) => {
            format!("{{{}}}", joined(map.iter().map(|(key, inner)| format!("{key}={}", field(inner))).collect()))
        }
        Json::Array(list) => format!("[{}]", joined(list.iter().map(field).collect())),
        Json::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// The style of a transaction's status.
pub fn status_style(status: &str) -> Style {
    match status {
        "ok" => Style::Good,
        "exception" | "unsolicited" => Style::Odd,
        "no_response" | "bad_request" | "bad_response" => Style::Bad,
        "broadcast" => Style::Note,
        "not_observed" => Style::Dim,
        _ => Style::Plain,
    }
}

/// The style of a frame's verdict.
pub fn verdict_style(verdict: &str) -> Style {
    match verdict {
        "ok" | "no_checksum" => Style::Good,
        "bad_checksum" | "incomplete" => Style::Bad,
        "noise" => Style::Odd,
        _ => Style::Plain,
    }
}

/// The style of a finding's severity.
pub fn severity_style(severity: &str) -> Style {
    match severity {
        "error" => Style::Bad,
        "warning" => Style::Odd,
        "info" => Style::Note,
        _ => Style::Plain,
    }
}

/// Joins the texts that are not empty with spaces, and escapes unsafe characters.
pub fn joined(parts: &[String]) -> String {
    let mut out = String::new();
    for part in parts.iter().filter(|part| !part.is_empty()) {
        if !out.is_empty() {
            out.push(' ');
        }
        push_visible(part, &mut out);
    }
    out
}
