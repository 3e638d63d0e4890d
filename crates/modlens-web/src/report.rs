//! A document as a report.

use serde_json::{json, Value as Json};

/// The title of the page of a document, and its body as HTML.
pub fn report(document: &Json) -> Json {
    json!({"title": modlens_report::title(document), "html": modlens_report::body(document)})
}
