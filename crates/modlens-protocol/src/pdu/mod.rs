//! Decodes PDU bodies by the field layout of their function. The decoded fields borrow the bytes.

mod encode;

pub use encode::encode;

use serde_json::{json, Map, Value as Json};

use crate::decimal::push_int;
use crate::functions::{Field, FieldType, Functions, Layout, Shape, EXCEPTION_BIT};
use crate::hex::{hex, push_hex};

/// One decoded field.
#[derive(Clone, Debug)]
pub struct DecodedField<'a> {
    /// The field of the table.
    pub field: &'a Field,
    /// Its offset in the body.
    pub offset: usize,
    /// Its bytes.
    pub bytes: &'a [u8],
    /// The decoded groups, if the field is a list of groups; empty otherwise.
    pub groups: Vec<Vec<DecodedField<'a>>>,
}

/// A decoded body.
#[derive(Clone, Debug)]
pub struct Decoded<'a> {
    /// The fields, in wire order.
    pub fields: Vec<DecodedField<'a>>,
    /// Whether the body contained all bytes that its lengths, counts and fixed fields announce.
    pub complete: bool,
    /// The number of body bytes that the layout covers; bytes after these are extra.
    pub covered_bytes: usize,
}

/// Decodes a body by its field layout. It never fails: missing bytes make the result incomplete.
pub fn decode<'a>(shape: &'a Shape, body: &'a [u8]) -> Decoded<'a> {
    let mut complete = true;
    let mut at = 0;
    let nodes = decode_fields(&shape.fields, body, &mut at, body.len(), &mut complete);
    Decoded { fields: nodes, complete, covered_bytes: at }
}

/// Decodes fields from offset `at` on, and moves `at` after them. `end` is the end of the body or of the part that a
/// length field announced. Sets `complete` to false if bytes are missing.
fn decode_fields<'a>(
    fields: &'a [Field],
    body: &'a [u8],
    at: &mut usize,
    mut end: usize,
    complete: &mut bool,
) -> Vec<DecodedField<'a>> {
    let mut nodes = Vec::with_capacity(fields.len());
    let mut count: Option<usize> = None;
    for field in fields {
        let width = field.field_type.width();
        let start = *at;
        if width > 0 {
            if start + width > end {
                *complete = false;
                return nodes;
            }
            let bytes = &body[start..start + width];
            *at += width;
            let value = big_endian(bytes);
            match field.field_type {
                FieldType::Len8 | FieldType::Len16 => {
                    *complete &= *at + value as usize <= end;
                    end = end.min(*at + value as usize);
                }
                FieldType::Count8 | FieldType::Count16 => count = Some(value as usize),
                _ => {}
            }
            nodes.push(DecodedField { field, offset: start, bytes, groups: Vec::new() });
            continue;
        }
        let items = count.take();
        let mut groups = Vec::new();
        if let FieldType::Group(inner) = &field.field_type {
            while *at < end && items.is_none_or(|items| groups.len() < items) {
                let before = *at;
                let group = decode_fields(inner, body, at, end, complete);
                // An incomplete group took no bytes. It is left out and its bytes are shown as extra; going on would
                // never end.
                if *at == before {
                    break;
                }
                groups.push(group);
            }
            *complete &= items.is_none_or(|items| groups.len() == items);
        } else {
            let announced = items.map_or(end - start, |items| list_bytes(&field.field_type, items));
            *complete &= start + announced <= end;
            // An odd byte at the end of a register list belongs to no register. It is left out and shown as extra.
            let taken = if field.field_type == FieldType::U16List {
                (end - start).min(announced) & !1
            } else {
                (end - start).min(announced)
            };
            *at = start + taken;
        }
        nodes.push(DecodedField { field, offset: start, bytes: &body[start..*at], groups });
    }
    nodes
}

/// The number of bytes that a list with this many items takes.
fn list_bytes(word: &FieldType, items: usize) -> usize {
    match word {
        FieldType::U16List => 2 * items,
        FieldType::Bits => items.div_ceil(8),
        _ => items,
    }
}

/// The big-endian number that these one or two bytes represent.
pub fn big_endian(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// The big-endian 16-bit number at an offset of the body; `None` if the body ends before.
#[inline]
pub fn u16_at(body: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]))
}

/// The numeric values of a list field.
pub fn list_values(word: &FieldType, bytes: &[u8]) -> Vec<u32> {
    match word {
        FieldType::U16List => bytes.chunks_exact(2).map(big_endian).collect(),
        FieldType::Bits => (0..bytes.len() * 8).map(|i| u32::from(bytes[i / 8] >> (i % 8) & 1)).collect(),
        _ => bytes.iter().map(|&b| u32::from(b)).collect(),
    }
}

impl DecodedField<'_> {
    /// The value as JSON: a number, a list of numbers, hex text for bytes, a list of objects for groups.
    pub fn json(&self) -> Json {
        match &self.field.field_type {
            FieldType::Group(_) => self.groups.iter().map(|group| Json::Object(object(group))).collect(),
            FieldType::Bytes => Json::from(hex(self.bytes)),
            FieldType::Bits | FieldType::U8List | FieldType::U16List => {
                Json::from(list_values(&self.field.field_type, self.bytes))
            }
            _ => Json::from(big_endian(self.bytes)),
        }
    }

    /// The field as a JSON object with name, type, place and value, and the fields of its groups as children. `base`
    /// is added to the offset: 1 makes it count from the function code.
    fn tree(&self, base: usize) -> Json {
        let children: Vec<Json> =
            self.groups.iter().map(|group| group.iter().map(|node| node.tree(base)).collect::<Vec<_>>().into()).collect();
        let length = self
            .groups
            .last()
            .and_then(|g| g.last())
            .map_or(self.bytes.len(), |last| last.offset + last.bytes.len() - self.offset);
        json!({
            "name": self.field.name, "word": self.field.field_type.spelling(), "offset": self.offset + base, "length": length,
            "value": self.json(), "children": children,
        })
    }
}

impl DecodedField<'_> {
    /// Appends the value as JSON text, equal to the text of `json`, without building a JSON value first.
    fn push(&self, out: &mut Vec<u8>) {
        match &self.field.field_type {
            FieldType::Group(_) => list(&self.groups, out, |group, out| push_object(group, out)),
            FieldType::Bytes => {
                out.push(b'"');
                push_hex(self.bytes, out);
                out.push(b'"');
            }
            FieldType::Bits | FieldType::U8List | FieldType::U16List => {
                list(&list_values(&self.field.field_type, self.bytes), out, |item, out| push_int(i64::from(*item), out));
            }
            _ => push_int(i64::from(big_endian(self.bytes)), out),
        }
    }
}

/// Appends a JSON list whose items `push` writes.
fn list<T>(items: &[T], out: &mut Vec<u8>, push: impl Fn(&T, &mut Vec<u8>)) {
    out.push(b'[');
    for (at, item) in items.iter().enumerate() {
        if at > 0 {
            out.push(b',');
        }
        push(item, out);
    }
    out.push(b']');
}

/// Appends the fields as JSON text, equal to the text of `object`. Field names need no escaping.
pub fn push_object(nodes: &[DecodedField<'_>], out: &mut Vec<u8>) {
    out.push(b'{');
    for (at, node) in nodes.iter().enumerate() {
        out.extend_from_slice(if at == 0 { b"\"" } else { b",\"" });
        out.extend_from_slice(node.field.name.as_bytes());
        out.extend_from_slice(b"\":");
        node.push(out);
    }
    out.push(b'}');
}

/// The fields as a JSON object: name -> value.
pub fn object(nodes: &[DecodedField<'_>]) -> Map<String, Json> {
    nodes.iter().map(|node| (node.field.name.clone(), node.json())).collect()
}

/// A whole PDU as a JSON tree of its fields; offsets count from the function code. Bytes that the layout does not cover
/// are listed as the field `extra`.
pub fn describe(functions: &Functions, pdu: &[u8], response: bool) -> Json {
    let Some((&code, body)) = pdu.split_first() else {
        return json!({"function": null, "name": null, "exception": null, "complete": false, "fields": []});
    };
    let function = code & !EXCEPTION_BIT;
    let name = functions.name(function);
    if code & EXCEPTION_BIT != 0 {
        let mut fields = Vec::new();
        if let Some(exception) = body.first() {
            fields.push(
                json!({"name": "exception_code", "word": "u8", "offset": 1, "length": 1, "value": exception, "children": []}),
            );
        }
        push_extra(&mut fields, body, 1);
        return json!({"function": function, "name": name, "exception": body.first(), "complete": !body.is_empty(), "fields": fields});
    }
    let row = functions.row(function, body);
    let layout = row.map(|row| if response { &row.response } else { &row.request });
    let mut fields = Vec::new();
    let (mut complete, mut used) = (true, 0);
    if let Some(shape) = layout.and_then(Layout::shape) {
        let decoded = decode(shape, body);
        (complete, used) = (decoded.complete, decoded.covered_bytes);
        fields = decoded.fields.iter().map(|node| node.tree(1)).collect();
    }
    push_extra(&mut fields, body, used);
    json!({"function": function, "name": name, "exception": null, "complete": complete, "fields": fields})
}

/// Lists the body bytes from `used` on as a field `extra`.
fn push_extra(fields: &mut Vec<Json>, body: &[u8], used: usize) {
    if let Some(uncovered) = body.get(used..).filter(|uncovered| !uncovered.is_empty()) {
        let value = hex(uncovered);
        fields.push(
            json!({"name": "extra", "word": "bytes", "offset": used + 1, "length": uncovered.len(), "value": value, "children": []}),
        );
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::functions::FunctionRow;
    use crate::hex::parse_hex;

    #[test]
    fn examples_decode_completely_and_encode_to_the_same_bytes() {
        let functions = Functions::embedded();
        for row in functions.rows() {
            for (key, response) in [("request", false), ("response", true)] {
                let Some(text) = row.source["example"].get(key).and_then(Json::as_str) else { continue };
                let pdu = parse_hex(text).unwrap();
                let tree = describe(functions, &pdu, response);
                let layout = if response { &row.response } else { &row.request };
                let Some(shape) = layout.shape() else { continue };
                assert_eq!(tree["complete"], true, "{text}");
                let decoded = decode(shape, &pdu[1..]);
                assert_eq!(decoded.covered_bytes, pdu.len() - 1, "{text}");
                assert!(shape.fits(&pdu[1..]), "{text}");
                assert_eq!(encode(functions, row.code, response, &object(&decoded.fields)).unwrap(), pdu, "{text}");
            }
        }
    }

    #[test]
    fn an_incomplete_group_does_not_stall_the_decoder() {
        let mut functions = Functions::default();
        let row = r#"
            format = 1
            [[function]]
            code = 0x47
            name = "Pairs"
            section = "vendor"
            summary = "pairs of words"
            request = ["pairs:group{first:u16 second:u16}"]
            response = ["lists:group{items:u16[]}"]
            example = { request = "47 0001 0002", response = "47 0001" }
        "#;
        functions.load(row, "pairs.toml", None).unwrap();
        for response in [false, true] {
            let tree = describe(&functions, &[0x47, 0, 1, 0, 2, 3], response);
            assert_eq!(tree["fields"][1]["name"], "extra", "{tree}");
        }
    }

    proptest! {
        #[test]
        fn pushed_text_equals_json_text(at in 0..64_usize, response: bool, body in proptest::collection::vec(any::<u8>(), 0..60)) {
            let rows: Vec<&FunctionRow> = Functions::embedded().rows().collect();
            let row = rows[at % rows.len()];
            let layout = if response { &row.response } else { &row.request };
            if let Some(shape) = layout.shape() {
                let decoded = decode(shape, &body);
                let mut text = Vec::new();
                push_object(&decoded.fields, &mut text);
                prop_assert_eq!(String::from_utf8(text).unwrap(), Json::Object(object(&decoded.fields)).to_string());
            }
        }

        #[test]
        fn any_body_can_be_decoded(code in 0u8..=255, body in proptest::collection::vec(any::<u8>(), 0..260), response: bool) {
            let mut pdu = vec![code];
            pdu.extend(&body);
            let tree = describe(Functions::embedded(), &pdu, response);
            let covered: usize = tree["fields"].as_array().unwrap().iter().map(|f| f["length"].as_u64().unwrap() as usize).sum();
            prop_assert!(covered <= body.len());
        }
    }
}
