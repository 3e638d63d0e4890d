//! The content of a profile file, independent of its notation: values with their lines. TOML, CSV, YAML and JSON are
//! all converted to this.

use serde_json::Value as Json;

/// A value with its line, counted from 1; 0 if lines are unknown.
#[derive(Clone, Debug)]
pub struct SourceNode {
    /// Its line.
    pub line: u32,
    /// The value.
    pub value: SourceValue,
}

/// One key of a table.
#[derive(Clone, Debug)]
pub struct SourceEntry {
    /// The key.
    pub key: String,
    /// The line of the key.
    pub line: u32,
    /// Its value.
    pub node: SourceNode,
}

/// A value of any kind.
#[derive(Clone, Debug)]
pub enum SourceValue {
    /// Text.
    Text(String),
    /// A whole number.
    Integer(i128),
    /// A number with a fraction or an exponent, as it was written.
    Float(String),
    /// A truth value.
    Bool(bool),
    /// A list.
    List(Vec<SourceNode>),
    /// A table.
    Map(Vec<SourceEntry>),
    /// A kind of value that profiles do not use, such as a date, by its name for messages.
    Other(&'static str),
}

impl SourceNode {
    /// The kind of the value, for messages.
    pub fn kind(&self) -> &'static str {
        match &self.value {
            SourceValue::Text(_) => "a text",
            SourceValue::Integer(_) | SourceValue::Float(_) => "a number",
            SourceValue::Bool(_) => "true or false",
            SourceValue::List(_) => "a list",
            SourceValue::Map(_) => "a table",
            SourceValue::Other(name) => name,
        }
    }

    /// The value as messages quote it.
    pub fn shown(&self) -> String {
        match &self.value {
            SourceValue::Text(text) => format!("{text:?}"),
            SourceValue::Integer(number) => number.to_string(),
            SourceValue::Float(text) => text.clone(),
            SourceValue::Bool(yes) => yes.to_string(),
            _ => self.kind().to_owned(),
        }
    }

    /// The entries of a table.
    pub fn entries(&self) -> &[SourceEntry] {
        match &self.value {
            SourceValue::Map(entries) => entries,
            _ => &[],
        }
    }

    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<&Self> {
        self.entries().iter().find(|entry| entry.key == key).map(|entry| &entry.node)
    }
}

/// Converts plain JSON, which has no lines. Programs pass it.
pub fn from_json(json: &Json) -> SourceNode {
    let value = match json {
        Json::Array(items) => SourceValue::List(items.iter().map(from_json).collect()),
        Json::Object(map) => {
            let entry = |(key, value): (&String, &Json)| SourceEntry { key: key.clone(), line: 0, node: from_json(value) };
            SourceValue::Map(map.iter().map(entry).collect())
        }
        scalar => leaf(scalar),
    };
    SourceNode { line: 0, value }
}

/// Converts a scalar JSON value.
fn leaf(scalar: &Json) -> SourceValue {
    match scalar {
        Json::String(text) => SourceValue::Text(text.clone()),
        Json::Bool(yes) => SourceValue::Bool(*yes),
        Json::Number(number) => {
            let text = number.to_string();
            text.parse().map_or(SourceValue::Float(text), SourceValue::Integer)
        }
        _ => SourceValue::Other("nothing"),
    }
}
