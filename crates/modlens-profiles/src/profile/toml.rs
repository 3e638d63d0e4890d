//! TOML with lines. The crate's parser goes on behind a mistake of syntax, so that all of them are told at once.

use toml::de::{DeTable, DeValue};
use toml::Spanned;

use crate::profile::node::{Entry, Node, Value};
use crate::profile::Mistake;

/// The tree of a text; what is no TOML goes to `mistakes`.
pub fn parse(text: &str, mistakes: &mut Vec<Mistake>) -> Node {
    let (table, errors) = DeTable::parse_recoverable(text);
    let lines = Lines::new(text);
    for error in errors {
        let line = error.span().map_or(0, |span| lines.at(span.start));
        mistakes.push(Mistake::new(line, "", format!("no TOML: {}", error.message().replace('\n', " "))));
    }
    Node { line: 1, value: map(table.get_ref(), &lines) }
}

struct Lines(Vec<usize>);

impl Lines {
    fn new(text: &str) -> Self {
        Self(memchr::memchr_iter(b'\n', text.as_bytes()).collect())
    }

    fn at(&self, offset: usize) -> u32 {
        self.0.partition_point(|&end| end < offset) as u32 + 1
    }
}

fn map(table: &DeTable<'_>, lines: &Lines) -> Value {
    let mut entries: Vec<Entry> = table
        .iter()
        .map(|(key, value)| Entry { key: key.get_ref().to_string(), line: lines.at(key.span().start), node: node(value, lines) })
        .collect();
    // The crate sorts by name; people expect the order of the file.
    entries.sort_by_key(|entry| entry.line);
    Value::Map(entries)
}

fn node(value: &Spanned<DeValue<'_>>, lines: &Lines) -> Node {
    let line = lines.at(value.span().start);
    let value = match value.get_ref() {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(number) => {
            let parsed = i128::from_str_radix(number.as_str(), number.radix());
            parsed.map_or_else(|_| Value::Float(number.to_string()), Value::Integer)
        }
        DeValue::Float(number) => Value::Float(number.as_str().to_owned()),
        DeValue::Boolean(yes) => Value::Bool(*yes),
        DeValue::Datetime(_) => Value::Other("a date"),
        DeValue::Array(items) => Value::List(items.iter().map(|item| node(item, lines)).collect()),
        DeValue::Table(table) => map(table, lines),
    };
    Node { line, value }
}
