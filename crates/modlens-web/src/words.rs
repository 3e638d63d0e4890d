//! The words of the tables: what the page shows of columns, findings and functions.

use modlens_protocol::finding::Finding;
use modlens_tables::columns::definition;
use serde_json::{json, Value as Json};

/// Columns of all tables (`columns.toml`), findings with what they mean and what to check, and the version of the program.
pub fn words() -> Json {
    let findings = Finding::ALL.iter().map(|finding| {
        let doc = finding.doc();
        let text = json!({"severity": doc.severity.text(), "title": doc.title, "why": doc.why, "advice": doc.advice});
        (doc.code.to_owned(), text)
    });
    json!({
        "version": env!("CARGO_PKG_VERSION"), "columns": definition(),
        "findings": findings.collect::<serde_json::Map<String, Json>>(),
    })
}
