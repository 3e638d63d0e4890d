//! The JSON Schema of a profile, for completion in editors; made from the rows of `keys`.

use serde_json::{json, Map, Value as Json};

use crate::profile::keys::{Key, Shape, DEVICE, POINT};
use crate::profile::kinds::{Access, Order, Type};

/// The schema (draft 2020-12). What it cannot say (widths, overlaps) only the validator knows.
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

fn table(keys: &[Key], required: &[&str]) -> Json {
    let properties: Map<String, Json> = keys.iter().map(|key| (key.key.to_owned(), property(key))).collect();
    let mut table = json!({"type": "object", "additionalProperties": false, "properties": properties});
    if !required.is_empty() {
        table["required"] = json!(required);
    }
    table
}

fn property(key: &Key) -> Json {
    let labels = |pattern: &str| {
        let texts = json!({"type": ["string", "number", "boolean"]});
        json!({"type": "object", "additionalProperties": false, "patternProperties": {pattern: texts}})
    };
    let mut found = match key.shape {
        Shape::Text => json!({"type": ["string", "number"]}),
        Shape::At => json!({"type": "string", "pattern":
            "^\\s*([hH][rR]|[iI][rR]|[cC][oO]|[dD][iI]|holding_register|input_register|coil|discrete_input)\\s*:\\s*(0[xX][0-9a-fA-F]+|[0-9]+)\\s*(\\.\\s*[0-9]+\\s*(-\\s*[0-9]+\\s*)?)?$"}),
        Shape::Type => json!({"enum": Type::ALL.map(|row| row.1)}),
        Shape::Order => json!({"enum": Order::ALL.map(|row| row.1)}),
        Shape::Access => json!({"enum": Access::ALL.map(|row| row.1)}),
        Shape::Whole => json!({"type": "integer", "minimum": 1, "maximum": 65535}),
        Shape::Number => json!({"type": "number"}),
        Shape::Numbers => json!({"type": ["number", "array"], "items": {"type": "number"}}),
        Shape::Labels => labels("^\\s*-?(0[xX][0-9a-fA-F]+|[0-9]+)\\s*$"),
        Shape::Wording => labels("^\\s*(0[xX][0-9a-fA-F]+|[0-9]+)\\s*$"),
        Shape::Codes => json!({"type": ["integer", "array"], "items": {"type": "integer", "minimum": 1, "maximum": 127}}),
        Shape::Names => json!({"type": ["string", "array"], "items": {"type": "string"}}),
        Shape::Base => json!({"enum": [0, 1, "modicon"]}),
    };
    if key.key == "scale" {
        found["not"] = json!({"const": 0});
    }
    found["description"] = key.help.into();
    found
}
