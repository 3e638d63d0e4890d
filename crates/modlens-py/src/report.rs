//! The HTML of reports.

use modlens_report::Parts;
use pyo3::prelude::*;
use serde_json::Value as Json;

use crate::arguments::value_error;
use crate::functions::Functions;

/// The title and the body of the page of a document.
#[pyfunction]
pub fn report_html(document: &str) -> PyResult<(String, String)> {
    let document = parsed(document)?;
    Ok((modlens_report::title(&document), modlens_report::body(&document)))
}

/// The document of what has been counted, as JSON.
#[pyfunction]
#[pyo3(signature = (core, statuses, functions, title=None))]
pub fn report_document(core: &str, statuses: &str, functions: &Functions, title: Option<&str>) -> PyResult<String> {
    let statuses = parsed(statuses)?;
    let statuses = statuses.as_array().map_or(&[][..], Vec::as_slice);
    let parts = Parts { core: parsed(core)?, statuses, functions: &functions.core, title };
    Ok(modlens_report::document(parts).to_string())
}

fn parsed(text: &str) -> PyResult<Json> {
    serde_json::from_str(text).map_err(|error| value_error(error.to_string()))
}

/// The table of the sections of a report, as JSON.
#[pyfunction]
pub fn report_layout() -> String {
    modlens_report::layout().to_string()
}
