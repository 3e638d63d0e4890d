//! The content of a profile file, independent of its notation: values with their lines. TOML, CSV, YAML and JSON are
//! all converted to this.

use serde_json::Value as Json;

/// A value with its line, counted from 1; 0 if lines are unknown.
#[derive(Clone, Debug)]
pub struct Node {
    /// Its line.
    pub line: u32,
    /// The value.
    pub value: Value,
}

/// One key of a table.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// The line of the key.
    pub line: u32,
    /// Its value.
    pub node: Node,
}

/// A value of any kind.
#[derive(Clone, Debug)]
pub enum Value {
    /// Text.
    Text(String),
    /// A whole number.
    Integer(i128),
    /// A number with a fraction or an exponent, as it was written.
    Float(String),
    /// A truth value.
    Bool(bool),
    /// A list.
    List(Vec<Node>),
    /// A table.
    Map(Vec<Entry>),
    /// A kind of value that profiles do not use, such as a date, by its name for messages.
    Other(&'static str),
}

impl Node {
    /// The kind of the value, for messages.
    pub fn kind(&self) -> &'static str {
        match &self.value {
            Value::Text(_) => "a text",
            Value::Integer(_) | Value::Float(_) => "a number",
            Value::Bool(_) => "true or false",
            Value::List(_) => "a list",
            Value::Map(_) => "a table",
            Value::Other(name) => name,
        }
    }

    /// The value as messages quote it.
    pub fn shown(&self) -> String {
        match &self.value {
            Value::Text(text) => format!("{text:?}"),
            Value::Integer(number) => number.to_string(),
            Value::Float(text) => text.clone(),
            Value::Bool(yes) => yes.to_string(),
            _ => self.kind().to_owned(),
        }
    }

    /// The entries of a table.
    pub fn entries(&self) -> &[Entry] {
        match &self.value {
            Value::Map(entries) => entries,
            _ => &[],
        }
    }

    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<&Self> {
        self.entries().iter().find(|entry| entry.key == key).map(|entry| &entry.node)
    }
}

/// Converts the tree that Python makes of YAML: every value is `[line, value]`, and every entry of a table is `[line of
/// the key, [line, value]]`.
pub fn from_tree(tree: &Json) -> Option<Node> {
    let pair = tree.as_array().filter(|pair| pair.len() == 2)?;
    let line = pair[0].as_u64()? as u32;
    let value = match &pair[1] {
        Json::Array(items) => Value::List(items.iter().map(from_tree).collect::<Option<_>>()?),
        Json::Object(map) => Value::Map(map.iter().map(|(key, pair)| entry(key, pair)).collect::<Option<_>>()?),
        scalar => leaf(scalar),
    };
    Some(Node { line, value })
}

fn entry(key: &str, pair: &Json) -> Option<Entry> {
    let pair = pair.as_array().filter(|pair| pair.len() == 2)?;
    Some(Entry { key: key.to_owned(), line: pair[0].as_u64()? as u32, node: from_tree(&pair[1])? })
}

/// Converts plain JSON, which has no lines. Programs pass it.
pub fn from_json(json: &Json) -> Node {
    let value = match json {
        Json::Array(items) => Value::List(items.iter().map(from_json).collect()),
        Json::Object(map) => {
            let entry = |(key, value): (&String, &Json)| Entry { key: key.clone(), line: 0, node: from_json(value) };
            Value::Map(map.iter().map(entry).collect())
        }
        scalar => leaf(scalar),
    };
    Node { line: 0, value }
}

/// Converts a scalar JSON value.
fn leaf(scalar: &Json) -> Value {
    match scalar {
        Json::String(text) => Value::Text(text.clone()),
        Json::Bool(yes) => Value::Bool(*yes),
        Json::Number(number) => {
            let text = number.to_string();
            text.parse().map_or(Value::Float(text), Value::Integer)
        }
        _ => Value::Other("nothing"),
    }
}
