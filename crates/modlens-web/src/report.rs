//! A document as a report.

use serde_json::{json, Value as Json};

/// A document with the title and the body of its page as HTML.
pub fn report(document: Json) -> Json {
    let (title, body) = (modlens_report::title(&document), modlens_report::body(&document));
    let mut report = json!({"document": null, "title": title, "body": null});
    // Both are large: the macro would copy them.
    report["document"] = document;
    report["body"] = body.into();
    report
}
