//! The JSON Schema of a profile, generated from the rows of `keys`, for completion in editors.

use serde_json::{json, Map, Value as Json};

use crate::profile::keys::{ProfileKey, ValueKind, DEVICE, POINT};
use crate::profile::types::{Access, Order, Type};

/// The schema (draft 2020-12). It does not express rules that involve several keys, such as widths and overlaps: only
/// the validator checks those.
pub fn schema() -> Json {
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "modlens device profile",
        "type": "object",
        "required": ["profile"],
        "additionalProperties": false,
        "properties": {
            "profile": {"const": 1},
            "device": table(DEVICE, &[]),
            "registers": {"type": "array", "items": table(POINT, &["at", "name"])},
        },
    })
}

/// The schema of a table with these keys.
fn table(keys: &[ProfileKey], required: &[&str]) -> Json {
    let properties: Map<String, Json> = keys.iter().map(|key| (key.key.to_owned(), property(key))).collect();
    let mut table = json!({"type": "object", "additionalProperties": false, "properties": properties});
    if !required.is_empty() {
        table["required"] = json!(required);
    }
    table
}

/// The schema of one key.
fn property(key: &ProfileKey) -> Json {
    let labels = |pattern: &str| {
        let label = json!({"type": ["string", "number", "boolean"]});
        json!({"type": "object", "additionalProperties": false, "patternProperties": {pattern: label}})
    };
    let mut property = match key.value_kind {
        ValueKind::Text => json!({"type": ["string", "number"]}),
        ValueKind::At => json!({"type": "string", "pattern":
            "^\\s*([hH][rR]|[iI][rR]|[cC][oO]|[dD][iI]|holding_register|input_register|coil|discrete_input)\\s*:\\s*(0[xX][0-9a-fA-F]+|[0-9]+)\\s*(\\.\\s*[0-9]+\\s*(-\\s*[0-9]+\\s*)?)?$"}),
        ValueKind::Type => json!({"enum": Type::ALL.map(|row| row.1)}),
        ValueKind::Order => json!({"enum": Order::ALL.map(|row| row.1)}),
        ValueKind::Access => json!({"enum": Access::ALL.map(|row| row.1)}),
        ValueKind::Whole => json!({"type": "integer", "minimum": 1, "maximum": 65535}),
        ValueKind::Number => json!({"type": "number"}),
        ValueKind::Numbers => json!({"type": ["number", "array"], "items": {"type": "number"}}),
        ValueKind::Labels => labels("^\\s*-?(0[xX][0-9a-fA-F]+|[0-9]+)\\s*$"),
        ValueKind::Wording => labels("^\\s*(0[xX][0-9a-fA-F]+|[0-9]+)\\s*$"),
        ValueKind::Codes => json!({"type": ["integer", "array"], "items": {"type": "integer", "minimum": 1, "maximum": 127}}),
        ValueKind::Names => json!({"type": ["string", "array"], "items": {"type": "string"}}),
        ValueKind::Base => json!({"enum": [0, 1, "modicon"]}),
    };
    if key.key == "scale" {
        property["not"] = json!({"const": 0});
    }
    property["description"] = key.help.into();
    property
}
