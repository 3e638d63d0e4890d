//! The objects of Read Device Identification as names and text (application protocol, 6.21).

use std::sync::OnceLock;

use modlens_protocol::functions::VOCABULARY;
use modlens_protocol::pdu::DecodedField;
use serde_json::{Map, Value as Json};

/// The field that lists the objects.
const OBJECTS: &str = "objects";

/// Name and text of the objects among these fields; empty if there are none. An object that is no text is left out.
pub(super) fn identification(fields: &[DecodedField<'_>]) -> Map<String, Json> {
    let objects = fields.iter().filter(|field| field.field.name == OBJECTS).flat_map(|field| field.groups.iter());
    let text = |object: &Vec<DecodedField<'_>>| {
        let bytes_of = |name: &str| object.iter().find(|field| field.field.name == name).map(|field| field.bytes);
        let &[id] = bytes_of("object_id")? else { return None };
        let text = std::str::from_utf8(bytes_of("value")?).ok()?.trim_end_matches('\0');
        (!text.chars().any(char::is_control)).then(|| (object_name(id), Json::from(text)))
    };
    objects.filter_map(text).collect()
}

/// The name of an object, from the embedded vocabulary; its number where the specification gives it none.
fn object_name(id: u8) -> String {
    static NAMES: OnceLock<Vec<(u8, String)>> = OnceLock::new();
    let names = NAMES.get_or_init(|| {
        let file: Json = toml::from_str(VOCABULARY).expect("the embedded vocabulary is tested");
        let rows = file["object_id"].as_array().cloned().unwrap_or_default();
        rows.iter().filter_map(|row| Some((row["id"].as_u64()? as u8, row["name"].as_str()?.to_owned()))).collect()
    });
    names.iter().find(|(known, _)| *known == id).map_or_else(|| format!("object_0x{id:02X}"), |(_, name)| name.clone())
}
