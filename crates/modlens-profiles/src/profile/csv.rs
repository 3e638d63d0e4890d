//! The notation for spreadsheets: `#base=1` lines for the device, a header line with the keys, and a line per point.
//!
//! ```text
//! #base=1
//! #id=acme.meter
//! at,name,type,scale,unit,enum
//! hr:104,setpoint,s16,0.1,°C,
//! hr:105,mode,,,,0=off;1=on
//! ```

use crate::profile::keys::{ValueKind, DEVICE, POINT};
use crate::profile::model::Mistake;
use crate::profile::source_tree::{SourceEntry, SourceNode, SourceValue};

/// Parses CSV into a tree. Mistakes in the CSV itself are added to `mistakes`.
pub fn parse(text: &str, mistakes: &mut Vec<Mistake>) -> SourceNode {
    let text = text.trim_start_matches('\u{feff}');
    let mut device = Vec::new();
    let mut header: Option<Vec<String>> = None;
    let mut registers = Vec::new();
    let delimiter = delimiter(text);
    // If semicolons or tabs separate the cells, commas may be decimal points.
    let decimal_comma = delimiter != ',';
    for (line, cells) in records(text, delimiter, mistakes) {
        if let Some(setting) = cells[0].strip_prefix('#') {
            // Spreadsheets append delimiters up to the width of the table.
            device.extend(parse_setting(setting.trim_end_matches(delimiter), line, decimal_comma));
        } else if cells.iter().all(|cell| cell.trim().is_empty()) {
            // Spreadsheets leave lines without content, or with delimiters only.
        } else if let Some(header) = &header {
            if cells.len() > header.len() {
                mistakes.push(Mistake::new(line, "", format!("{} cells, but {} keys in the header", cells.len(), header.len())));
            }
            registers.push(parse_point(header, &cells, line, decimal_comma));
        } else {
            header = Some(cells.iter().map(|cell| cell.trim().to_ascii_lowercase()).collect());
        }
    }
    if header.is_none() {
        mistakes.push(Mistake::new(1, "at", "no line of keys such as at,name,type,scale,unit".into()));
    }
    let entry = |key: &str, value| SourceEntry { key: key.into(), line: 1, node: SourceNode { line: 1, value } };
    let entries = vec![
        entry("profile", SourceValue::Integer(1)),
        entry("device", SourceValue::Map(device)),
        entry("registers", SourceValue::List(registers)),
    ];
    SourceNode { line: 1, value: SourceValue::Map(entries) }
}

/// A setting of the device, from a line such as `#base=1`.
fn parse_setting(setting: &str, line: u32, decimal_comma: bool) -> Option<SourceEntry> {
    // A line that begins with # but has no = is a comment.
    let (key, value) = setting.split_once('=')?;
    let key = key.trim().to_ascii_lowercase();
    let key = if key == "base" { "address_base".to_owned() } else { key };
    let value_kind = DEVICE.iter().find(|known| known.key == key).map_or(ValueKind::Text, |known| known.value_kind);
    Some(SourceEntry { key, line, node: parse_cell(value_kind, value.trim(), line, decimal_comma) })
}

/// A point, from the header and a line of cells. Empty cells are left out.
fn parse_point(header: &[String], cells: &[String], line: u32, decimal_comma: bool) -> SourceNode {
    let filled = header.iter().zip(cells).filter(|(_, cell)| !cell.trim().is_empty());
    let entries = filled.map(|(key, text)| {
        let value_kind = POINT.iter().find(|known| known.key == *key).map_or(ValueKind::Text, |known| known.value_kind);
        SourceEntry { key: key.clone(), line, node: parse_cell(value_kind, text.trim(), line, decimal_comma) }
    });
    SourceNode { line, value: SourceValue::Map(entries.collect()) }
}

/// Converts a cell to the kind of value that its key takes. Text that cannot be converted stays text, which the checks
/// refuse with its line.
fn parse_cell(value_kind: ValueKind, text: &str, line: u32, decimal_comma: bool) -> SourceNode {
    // An apostrophe keeps a spreadsheet from taking the text for a formula.
    let unmarked = text.strip_prefix('\'').filter(|rest| rest.trim_start_matches('\'').starts_with(['=', '+', '-', '@']));
    let text = unmarked.unwrap_or(text);
    let one = |text: &str| SourceNode {
        line,
        value: parse_number(text, decimal_comma).unwrap_or_else(|| SourceValue::Text(text.to_owned())),
    };
    let parts = || text.split(';').map(str::trim).filter(|part| !part.is_empty());
    let value = match value_kind {
        ValueKind::Number | ValueKind::Whole | ValueKind::Base => return one(text),
        ValueKind::Numbers | ValueKind::Codes => SourceValue::List(parts().map(one).collect()),
        ValueKind::Names => {
            SourceValue::List(parts().map(|part| SourceNode { line, value: SourceValue::Text(part.into()) }).collect())
        }
        ValueKind::Labels | ValueKind::Wording => {
            let entry = |part: &str| {
                let (key, label) = part.split_once('=').unwrap_or((part, ""));
                SourceEntry {
                    key: key.trim().into(),
                    line,
                    node: SourceNode { line, value: SourceValue::Text(label.trim().into()) },
                }
            };
            SourceValue::Map(parts().map(entry).collect())
        }
        _ => SourceValue::Text(text.to_owned()),
    };
    SourceNode { line, value }
}

/// A decimal or hexadecimal number; with `decimal_comma`, the decimal point may be a comma.
fn parse_number(text: &str, decimal_comma: bool) -> Option<SourceValue> {
    if let Some(digits) = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        return i128::from_str_radix(digits, 16).ok().map(SourceValue::Integer);
    }
    if let Ok(parse_number) = text.parse() {
        return Some(SourceValue::Integer(parse_number));
    }
    let with_decimal_point = if decimal_comma { text.replacen(',', ".", 1) } else { text.to_owned() };
    with_decimal_point.parse::<f64>().ok().map(|_| SourceValue::Float(with_decimal_point))
}

/// The delimiter that is most frequent in the header line.
fn delimiter(text: &str) -> char {
    let header = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty()).unwrap_or("");
    [',', ';', '\t'].into_iter().max_by_key(|&separator| header.matches(separator).count()).unwrap_or(',')
}

/// The records of an RFC 4180 file, each with the line that it begins on.
fn records(text: &str, delimiter: char, mistakes: &mut Vec<Mistake>) -> Vec<(u32, Vec<String>)> {
    let mut all = Vec::new();
    let (mut line, mut first_line) = (1, 1);
    let (mut cells, mut cell, mut is_quoted, mut is_line_empty) = (Vec::new(), String::new(), false, true);
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if is_quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cell.push('"');
            }
            '"' if is_quoted || cell.is_empty() => is_quoted = !is_quoted,
            '\n' if !is_quoted => {
                cells.push(std::mem::take(&mut cell).trim_end_matches('\r').to_owned());
                all.push((first_line, std::mem::take(&mut cells)));
                (line, is_line_empty) = (line + 1, true);
                first_line = line;
                continue;
            }
            // A comment or setting is a single cell, even if it contains delimiters.
            separator if separator == delimiter && !is_quoted && !(cells.is_empty() && cell.starts_with('#')) => {
                cells.push(std::mem::take(&mut cell));
            }
            other => {
                line += u32::from(other == '\n');
                cell.push(other);
            }
        }
        is_line_empty = false;
    }
    if is_quoted {
        mistakes.push(Mistake::new(first_line, "", "a quotation mark that is never closed".into()));
    }
    if !is_line_empty {
        cells.push(cell);
        all.push((first_line, cells));
    }
    all
}
