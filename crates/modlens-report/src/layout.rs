//! The table of sections.

use std::sync::OnceLock;

use serde_json::Value as Json;

const LAYOUT: &str = include_str!("../../../analyzer/report/layout.toml");

/// The table of sections (`layout.toml`).
pub fn layout() -> &'static Json {
    static FOUND: OnceLock<Json> = OnceLock::new();
    FOUND.get_or_init(|| toml::from_str(LAYOUT).expect("the embedded layout is tested"))
}

/// The sections in their order.
pub(crate) fn sections() -> &'static [Json] {
    list(&layout()["section"])
}

/// The items of a list; none where the value is something else.
pub(crate) fn list(value: &Json) -> &[Json] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The text; empty where the value is something else.
pub(crate) fn text(value: &Json) -> &str {
    value.as_str().unwrap_or_default()
}
