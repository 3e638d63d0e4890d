//! A document as a report.

use serde_json::{json, Value as Json};

/// A document with the title and the body of its page as HTML.
pub fn report(document: Json) -> Json {
    let (title, body) = (modlens_report::title(&document), modlens_report::body(&document));
    json!({"document": document, "title": title, "body": body})
}
