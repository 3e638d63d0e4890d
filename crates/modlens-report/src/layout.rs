//! The table of sections.

use std::sync::OnceLock;

use serde_json::Value as Json;

const LAYOUT: &str = include_str!("../../../analyzer/report/layout.toml");

/// The sections of what was learnt; the page of the browser, which learns nothing, does without.
const LEARNED: &str = if cfg!(target_family = "wasm") { "" } else { include_str!("../../../analyzer/report/learned.toml") };

/// The table of sections (`layout.toml`), with those of what was learnt in front of the timeline.
pub fn layout() -> &'static Json {
    static FOUND: OnceLock<Json> = OnceLock::new();
    FOUND.get_or_init(|| {
        let [mut all, learned]: [Json; 2] =
            [LAYOUT, LEARNED].map(|text| toml::from_str(text).expect("the embedded layout is tested"));
        if let (Some(sections), Some(more)) = (all["section"].as_array_mut(), learned["section"].as_array()) {
            let at = sections.iter().position(|one| one["id"] == "timeline").unwrap_or(0);
            sections.splice(at..at, more.iter().cloned());
        }
        all
    })
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
