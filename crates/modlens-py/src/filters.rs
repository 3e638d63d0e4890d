//! The language of filters.

use modlens_filters::{parse, Changes};
use pyo3::prelude::*;
use serde_json::json;

/// A filter as JSON: its text, tree and notes, or what is wrong with it.
#[pyfunction]
pub fn parse_filter(text: &str, table: &str, local_changes: Bound<'_, PyAny>) -> String {
    let local = || local_changes.call0().and_then(|found| found.extract::<Changes>()).unwrap_or_default();
    let found = match parse(text, table, &local) {
        Ok(filter) => json!({"text": filter.text, "tree": filter.tree, "notes": filter.notes}),
        Err(error) => json!({"error": error.message, "text": error.text, "column": error.column, "hint": error.hint}),
    };
    found.to_string()
}

/// The known name that is most similar to a misspelled one.
#[pyfunction]
pub fn similar_name(text: &str, known: Vec<String>, least: f64) -> Option<String> {
    modlens_filters::similar_name(text, known.iter().map(String::as_str), least).map(ToOwned::to_owned)
}
