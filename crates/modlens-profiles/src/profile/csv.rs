//! The spreadsheet's spelling: `#base=1` lines for the device, a line of keys, a line a point.
//!
//! ```text
//! #base=1
//! #id=acme.meter
//! at,name,type,scale,unit,enum
//! hr:104,setpoint,s16,0.1,°C,
//! hr:105,mode,,,,0=off;1=on
//! ```

use crate::profile::keys::{Shape, DEVICE, POINT};
use crate::profile::node::{Entry, Node, Value};
use crate::profile::Mistake;

/// The tree of a text; what is no such table goes to `mistakes`.
pub fn parse(text: &str, mistakes: &mut Vec<Mistake>) -> Node {
    let text = text.trim_start_matches('\u{feff}');
    let mut device = Vec::new();
    let mut head: Option<Vec<String>> = None;
    let mut registers = Vec::new();
    let delimiter = delimiter(text);
    // Where semicolons or tabs part the cells, 0,1 is a number.
    let comma = delimiter != ',';
    for (line, cells) in records(text, delimiter, mistakes) {
        if let Some(setting) = cells[0].strip_prefix('#') {
            // A spreadsheet fills the line up to the width of the table.
            device.extend(setting_of(setting.trim_end_matches(delimiter), line, comma));
        } else if cells.iter().all(|cell| cell.trim().is_empty()) {
            // An empty line, or one of commas only, as spreadsheets leave them.
        } else if let Some(head) = &head {
            if cells.len() > head.len() {
                mistakes.push(Mistake::new(line, "", format!("{} cells, but {} keys in the head", cells.len(), head.len())));
            }
            registers.push(row(head, &cells, line, comma));
        } else {
            head = Some(cells.iter().map(|cell| cell.trim().to_ascii_lowercase()).collect());
        }
    }
    if head.is_none() {
        mistakes.push(Mistake::new(1, "at", "no line of keys such as at,name,type,scale,unit".into()));
    }
    let entry = |key: &str, value| Entry { key: key.into(), line: 1, node: Node { line: 1, value } };
    let entries = vec![
        entry("profile", Value::Integer(1)),
        entry("device", Value::Map(device)),
        entry("registers", Value::List(registers)),
    ];
    Node { line: 1, value: Value::Map(entries) }
}

fn setting_of(setting: &str, line: u32, comma: bool) -> Option<Entry> {
    // A line that begins with # and has no = is a comment.
    let (key, value) = setting.split_once('=')?;
    let key = key.trim().to_ascii_lowercase();
    let key = if key == "base" { "address_base".to_owned() } else { key };
    let shape = DEVICE.iter().find(|known| known.key == key).map_or(Shape::Text, |known| known.shape);
    Some(Entry { key, line, node: cell(shape, value.trim(), line, comma) })
}

fn row(head: &[String], cells: &[String], line: u32, comma: bool) -> Node {
    let filled = head.iter().zip(cells).filter(|(_, cell)| !cell.trim().is_empty());
    let entries = filled.map(|(key, text)| {
        let shape = POINT.iter().find(|known| known.key == *key).map_or(Shape::Text, |known| known.shape);
        Entry { key: key.clone(), line, node: cell(shape, text.trim(), line, comma) }
    });
    Node { line, value: Value::Map(entries.collect()) }
}

/// A cell as the value that its key wants; what cannot be one stays a text, which is then refused with its line.
fn cell(shape: Shape, text: &str, line: u32, comma: bool) -> Node {
    let one = |text: &str| Node { line, value: number(text, comma).unwrap_or_else(|| Value::Text(text.to_owned())) };
    let parts = || text.split(';').map(str::trim).filter(|part| !part.is_empty());
    let value = match shape {
        Shape::Number | Shape::Whole | Shape::Base => return one(text),
        Shape::Numbers | Shape::Codes => Value::List(parts().map(one).collect()),
        Shape::Names => Value::List(parts().map(|part| Node { line, value: Value::Text(part.into()) }).collect()),
        Shape::Labels | Shape::Wording => {
            let entry = |part: &str| {
                let (key, label) = part.split_once('=').unwrap_or((part, ""));
                Entry { key: key.trim().into(), line, node: Node { line, value: Value::Text(label.trim().into()) } }
            };
            Value::Map(parts().map(entry).collect())
        }
        _ => Value::Text(text.to_owned()),
    };
    Node { line, value }
}

fn number(text: &str, comma: bool) -> Option<Value> {
    if let Some(digits) = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        return i128::from_str_radix(digits, 16).ok().map(Value::Integer);
    }
    if let Ok(number) = text.parse() {
        return Some(Value::Integer(number));
    }
    let point = if comma { text.replacen(',', ".", 1) } else { text.to_owned() };
    point.parse::<f64>().ok().map(|_| Value::Float(point))
}

fn delimiter(text: &str) -> char {
    let head = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty()).unwrap_or("");
    [',', ';', '\t'].into_iter().max_by_key(|&mark| head.matches(mark).count()).unwrap_or(',')
}

/// Records of RFC 4180 with the line each begins on.
fn records(text: &str, delimiter: char, mistakes: &mut Vec<Mistake>) -> Vec<(u32, Vec<String>)> {
    let mut all = Vec::new();
    let (mut line, mut begun) = (1, 1);
    let (mut cells, mut cell, mut quoted, mut empty) = (Vec::new(), String::new(), false, true);
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if quoted && letters.peek() == Some(&'"') => {
                letters.next();
                cell.push('"');
            }
            '"' if quoted || cell.is_empty() => quoted = !quoted,
            '\n' if !quoted => {
                cells.push(std::mem::take(&mut cell).trim_end_matches('\r').to_owned());
                all.push((begun, std::mem::take(&mut cells)));
                (line, empty) = (line + 1, true);
                begun = line;
                continue;
            }
            // A comment or a setting is one cell, whatever stands in it.
            mark if mark == delimiter && !quoted && !(cells.is_empty() && cell.starts_with('#')) => {
                cells.push(std::mem::take(&mut cell));
            }
            other => {
                line += u32::from(other == '\n');
                cell.push(other);
            }
        }
        empty = false;
    }
    if quoted {
        mistakes.push(Mistake::new(begun, "", "a quotation mark that is never closed".into()));
    }
    if !empty {
        cells.push(cell);
        all.push((begun, cells));
    }
    all
}
