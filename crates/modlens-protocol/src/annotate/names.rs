//! The names of numbers in a PDU: `vocabulary.toml`.

use std::sync::OnceLock;

use serde_json::Value as Json;

use crate::functions::{parse_toml, VOCABULARY};

/// A number that has a name; `last` is the end of a range of numbers.
pub struct Entry {
    first: u64,
    last: u64,
    /// The name.
    pub name: String,
    /// What it means.
    pub meaning: String,
}

/// The entry of a number in a part of the vocabulary, such as `exception`; `None` where the specification has none.
pub fn entry_of(part: &str, code: u32) -> Option<&'static Entry> {
    static PARTS: OnceLock<Vec<(String, Vec<Entry>)>> = OnceLock::new();
    let parts = PARTS.get_or_init(|| {
        let file = parse_toml(VOCABULARY).expect("the embedded vocabulary is tested");
        let tables = file.as_object().into_iter().flatten();
        tables.filter_map(|(part, rows)| Some((part.clone(), rows.as_array()?.iter().map(entry).collect()))).collect()
    });
    let code = u64::from(code);
    parts.iter().find(|(name, _)| name == part)?.1.iter().find(|entry| (entry.first..=entry.last).contains(&code))
}

/// The name of an exception code in lower case, such as `illegal data address`.
pub fn exception_name(code: u8) -> Option<String> {
    Some(entry_of("exception", u32::from(code))?.name.to_lowercase())
}

fn entry(row: &Json) -> Entry {
    let text = |key: &str| row[key].as_str().unwrap_or_default().to_owned();
    let first = ["code", "sub_function", "id"].iter().find_map(|key| row[key].as_u64()).unwrap_or_default();
    Entry { first, last: row["last"].as_u64().unwrap_or(first), name: text("name"), meaning: text("meaning") }
}
