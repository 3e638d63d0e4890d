//! The words of the tables: what the page shows of columns, findings and register types.

use modlens_protocol::finding::Finding;
use modlens_protocol::register_type::Space;
use modlens_tables::columns::definition;
use serde_json::{json, Value as Json};

/// Columns of all tables (`columns.toml`), findings with what they mean and what to check, the short names of register types,
/// and the version of the program.
pub fn words() -> Json {
    let findings = Finding::ALL.iter().map(|finding| {
        let doc = finding.doc();
        let text = json!({"severity": doc.severity.text(), "title": doc.title, "why": doc.why, "advice": doc.advice});
        (doc.code.to_owned(), text)
    });
    let short = Space::ALL.iter().map(|(_, short, long, _)| ((*long).to_owned(), Json::from(*short)));
    json!({
        "register_types": short.collect::<serde_json::Map<String, Json>>(),
        "version": env!("CARGO_PKG_VERSION"), "columns": definition(),
        "findings": findings.collect::<serde_json::Map<String, Json>>(),
    })
}
