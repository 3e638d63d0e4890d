//! The HTML of reports.

use pyo3::prelude::*;
use serde_json::Value as Json;

use crate::arguments::value_error;

/// The title and the body of the page of a document.
#[pyfunction]
pub fn report_html(document: &str) -> PyResult<(String, String)> {
    let document: Json = serde_json::from_str(document).map_err(|error| value_error(error.to_string()))?;
    Ok((modlens_report::title(&document), modlens_report::body(&document)))
}

/// The table of the sections of a report, as JSON.
#[pyfunction]
pub fn report_layout() -> String {
    modlens_report::layout().to_string()
}
