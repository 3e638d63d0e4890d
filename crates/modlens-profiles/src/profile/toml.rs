//! Parses TOML and keeps the lines. The library's parser goes on after a syntax error, so all mistakes can be reported
//! together.

use toml::de::{DeTable, DeValue};
use toml::Spanned;

use crate::profile::model::Mistake;
use crate::profile::source_tree::{SourceEntry, SourceNode, SourceValue};

/// Parses TOML into a tree. Syntax errors are added to `mistakes`.
pub fn parse(text: &str, mistakes: &mut Vec<Mistake>) -> SourceNode {
    let (table, errors) = DeTable::parse_recoverable(text);
    let lines = LineEnds::new(text);
    for error in errors {
        let line = error.span().map_or(0, |span| lines.at(span.start));
        mistakes.push(Mistake::new(line, "", format!("not TOML: {}", error.message().replace('\n', " "))));
    }
    SourceNode { line: 1, value: map(table.get_ref(), &lines) }
}

/// The offsets of all line ends, to find the line of an offset.
struct LineEnds(Vec<usize>);

impl LineEnds {
    fn new(text: &str) -> Self {
        Self(memchr::memchr_iter(b'\n', text.as_bytes()).collect())
    }

    fn at(&self, offset: usize) -> u32 {
        self.0.partition_point(|&end| end < offset) as u32 + 1
    }
}

/// Converts a table.
fn map(table: &DeTable<'_>, lines: &LineEnds) -> SourceValue {
    let mut entries: Vec<SourceEntry> = table
        .iter()
        .map(|(key, value)| SourceEntry {
            key: key.get_ref().to_string(),
            line: lines.at(key.span().start),
            node: node(value, lines),
        })
        .collect();
    // The library sorts keys by name; users expect the order of the file.
    entries.sort_by_key(|entry| entry.line);
    SourceValue::Map(entries)
}

/// Converts a value with its line.
fn node(value: &Spanned<DeValue<'_>>, lines: &LineEnds) -> SourceNode {
    let line = lines.at(value.span().start);
    let value = match value.get_ref() {
        DeValue::String(text) => SourceValue::Text(text.to_string()),
        DeValue::Integer(number) => {
            let parsed = i128::from_str_radix(number.as_str(), number.radix());
            parsed.map_or_else(|_| SourceValue::Float(number.to_string()), SourceValue::Integer)
        }
        DeValue::Float(number) => SourceValue::Float(number.as_str().to_owned()),
        DeValue::Boolean(yes) => SourceValue::Bool(*yes),
        DeValue::Datetime(_) => SourceValue::Other("a date"),
        DeValue::Array(items) => SourceValue::List(items.iter().map(|item| node(item, lines)).collect()),
        DeValue::Table(table) => map(table, lines),
    };
    SourceNode { line, value }
}
