//! What the cells of tables say: addresses, values, times in milliseconds, states and their colours.

use serde_json::Value as Json;

use crate::view::grid::Values;
use crate::view::text::{push_visible, visible};
use crate::view::{Base, Style};
use modlens_tables::columns::{Cell, Items, RowRef, TableKind};

/// From here on tenths of a millisecond are noise.
const LONG_US: f64 = 100_000.0;

/// Bits are shown in groups, in wire order.
const GROUP: usize = 8;

/// The columns of a table by name, for those that read several of a row's.
#[derive(Clone, Copy)]
pub struct Keys(pub TableKind);

impl Keys {
    /// The place of a column.
    pub fn at(self, key: &str) -> usize {
        self.0.column(key).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// A number of a row.
pub fn number(row: &RowRef<'_>, column: usize) -> Option<i64> {
    match row.cell(column) {
        Cell::Int(number) => Some(number),
        _ => None,
    }
}

/// A text of a row.
pub fn word<'a>(row: &RowRef<'a>, column: usize) -> Option<&'a str> {
    match row.cell(column) {
        Cell::Word(text) | Cell::Text(text) => Some(text),
        _ => None,
    }
}

/// A text of a row that may have been made for it.
pub fn text(row: &RowRef<'_>, column: usize) -> String {
    modlens_tables::cell_text::cell_text(&row.cell(column))
}

/// A duration as milliseconds: `1.2`, `250`.
pub fn milliseconds(row: &RowRef<'_>, column: usize) -> Option<String> {
    match row.cell(column) {
        Cell::Us(ns) => {
            let us = ns as f64 / 1e3;
            Some(format!("{:.*}", usize::from(us < LONG_US), us / 1e3))
        }
        _ => None,
    }
}

/// Short name of a type of registers.
pub fn short(kind: Option<&str>) -> Option<&'static str> {
    Some(match kind? {
        "coil" => "co",
        "discrete_input" => "di",
        "input_register" => "ir",
        "holding_register" => "hr",
        _ => return None,
    })
}

fn is_bits(kind: Option<&str>) -> bool {
    matches!(kind, Some("coil" | "discrete_input"))
}

/// A block of addresses: `107-109`, `40108`. The last address is 65535, whatever was asked for.
pub fn span(first: Option<i64>, quantity: Option<i64>, kind: Option<&str>, base: Base) -> String {
    let Some(first) = first else { return String::new() };
    let start = base.address(first, kind);
    match quantity {
        None | Some(0 | 1) => start,
        Some(quantity) => format!("{start}-{}", base.address((first + quantity - 1).min(0xFFFF), kind)),
    }
}

/// Code and name of a function: `  3 Read Holding Registers`.
pub fn function_long(code: Option<i64>, name: Option<&str>) -> String {
    code.map_or_else(String::new, |code| format!("{code:3} {}", visible(name.unwrap_or("unknown"))))
}

/// Code and what the function does to which registers: ` 3 read hr`.
pub fn function_short(code: Option<i64>, name: Option<&str>, operation: Option<&str>, kind: Option<&str>) -> String {
    let Some(code) = code else { return String::new() };
    let does = match operation {
        Some("read") => "read",
        Some("write") => "write",
        Some("read_write") => "r/w",
        _ => "",
    };
    match short(kind) {
        Some(short) if !does.is_empty() => format!("{code:2} {does} {short}"),
        _ => format!("{code:2} {}", visible(name.unwrap_or("unknown"))),
    }
}

/// The codes of a row's findings, with commas; what its state says already is left out.
pub fn findings(row: &RowRef<'_>, column: usize, state: &str) -> String {
    let Cell::Codes(codes) = row.cell(column) else { return String::new() };
    let mut said: Vec<&str> = Vec::new();
    for code in codes.iter().map(|finding| finding.doc().code) {
        if code != state && !said.contains(&code) {
            said.push(code);
        }
    }
    said.join(",")
}

/// Where the values of a transaction stand.
#[derive(Clone, Copy)]
pub struct Carried {
    readings: usize,
    data: usize,
    operation: usize,
    register_type: usize,
    write_address: usize,
    write_quantity: usize,
    write_data: usize,
    fields: usize,
}

impl Carried {
    /// Looks the columns up.
    pub fn new(keys: Keys) -> Self {
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

    /// What a transaction carried: values read, values written, decoded fields.
    ///
    /// Where a profile names values, their names and values stand in place of the registers.
    pub fn values<'a>(self, row: &RowRef<'a>, base: Base) -> Values<'a> {
        if let Cell::Map(Json::Object(named)) = row.cell(self.readings) {
            let one = |(name, value): (&String, &Json)| (visible(&format!("{name}={}", reading(value))), 1);
            return Values::Texts(named.iter().map(one).collect());
        }
        let (data, kind) = (ints(row.cell(self.data)), word(row, self.register_type));
        let does = word(row, self.operation);
        if let (Some(items), Some("read"), false) = (data, does, is_bits(kind)) {
            return Values::Numbers(items); // nearly every row
        }
        let mut texts = Vec::new();
        if let Some(items) = data {
            push_block(&items, kind, &mut texts);
        }
        if does == Some("read_write") {
            let first = number(row, self.write_address);
            texts.push((format!("{}:", span(first, number(row, self.write_quantity), kind, base)), 0));
        }
        if let Some(items) = ints(row.cell(self.write_data)) {
            push_block(&items, kind, &mut texts);
        }
        if let cell @ Cell::Fields(_) = row.cell(self.fields) {
            let fields: serde_json::Map<String, Json> =
                serde_json::from_str(&modlens_tables::cell_text::cell_text(&cell)).unwrap_or_default();
            for (key, value) in fields.iter().filter(|(key, _)| *key != "byte_count") {
                texts.push((visible(&format!("{key}={}", field(value))), 1));
            }
        }
        Values::Texts(texts)
    }
}

fn ints(cell: Cell<'_>) -> Option<Items<'_>> {
    match cell {
        Cell::Ints(items) => Some(items),
        _ => None,
    }
}

/// Registers one by one, bits in groups; and how many values each text is.
fn push_block(items: &Items<'_>, kind: Option<&str>, texts: &mut Vec<(String, usize)>) {
    let group = if is_bits(kind) { GROUP } else { 1 };
    for start in (0..items.len()).step_by(group) {
        let end = (start + group).min(items.len());
        texts.push(((start..end).map(|index| items.get(index).to_string()).collect(), end - start));
    }
}

fn reading(value: &Json) -> String {
    if value.is_null() {
        "-".into()
    } else {
        field(value)
    }
}

/// A decoded field on one line.
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

/// The colour of a transaction's status.
pub fn status_style(status: &str) -> Style {
    match status {
        "ok" => Style::Good,
        "exception" | "unrequested" => Style::Odd,
        "no_response" | "bad_request" | "bad_response" => Style::Bad,
        "broadcast" => Style::Note,
        "not_seen" => Style::Dim,
        _ => Style::Plain,
    }
}

/// The colour of a frame's verdict.
pub fn verdict_style(verdict: &str) -> Style {
    match verdict {
        "ok" | "no_checksum" => Style::Good,
        "bad_checksum" | "incomplete" => Style::Bad,
        "noise" => Style::Odd,
        _ => Style::Plain,
    }
}

/// The colour of a finding's severity.
pub fn severity_style(severity: &str) -> Style {
    match severity {
        "error" => Style::Bad,
        "warning" => Style::Odd,
        "info" => Style::Note,
        _ => Style::Plain,
    }
}

/// Parts of a text that are there, with spaces between them, made visible.
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
