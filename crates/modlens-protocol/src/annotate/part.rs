//! A decoded PDU as a flat list: the fields, those of groups with their path.

use crate::framing::Direction;
use crate::functions::{FieldType, FunctionRow, Functions, Layout, EXCEPTION_BIT};
use crate::pdu::{big_endian, decode, DecodedField};

static ONE_BYTE: FieldType = FieldType::U8;
static ANY_BYTES: FieldType = FieldType::Bytes;

/// The name of bytes that no layout covers.
pub const EXTRA: &str = "extra";

/// A decoded field.
pub struct Part<'a> {
    /// The name in the table.
    pub name: &'a str,
    /// The name with its place in a group: `objects[0].value`.
    pub path: String,
    /// The type in the table.
    pub field_type: &'a FieldType,
    /// The offset, counted from the function code.
    pub offset: usize,
    /// The bytes.
    pub bytes: &'a [u8],
}

impl Part<'_> {
    /// The value of a single number.
    pub fn number(&self) -> Option<u32> {
        (self.field_type.width() > 0).then(|| big_endian(self.bytes))
    }

    /// Size in bytes of an item of a list of numbers; packed bits are shown byte by byte.
    pub fn item_bytes(&self) -> Option<usize> {
        match self.field_type {
            FieldType::U8List | FieldType::Bits => Some(1),
            FieldType::U16List => Some(2),
            _ => None,
        }
    }

    /// Whether it is a field of a group.
    pub fn is_in_group(&self) -> bool {
        self.path != self.name
    }
}

/// A decoded PDU.
pub struct Pdu<'a> {
    /// The function code, without the exception bit.
    pub function: u8,
    /// The row of the table; `None` for a code that it does not have.
    pub row: Option<&'a FunctionRow>,
    /// The code of an exception response.
    pub exception: Option<u8>,
    /// Whether all bytes are there.
    pub is_complete: bool,
    /// The fields, in wire order.
    pub parts: Vec<Part<'a>>,
}

impl<'a> Pdu<'a> {
    /// Decodes a PDU; of an incomplete one the fields that are there are given.
    pub fn decode(functions: &'a Functions, pdu: &'a [u8], is_response: bool) -> Self {
        let Some((&code, body)) = pdu.split_first() else {
            return Self { function: 0, row: None, exception: None, is_complete: false, parts: Vec::new() };
        };
        let function = code & !EXCEPTION_BIT;
        let mut parts = Vec::new();
        let (row, used, is_complete);
        if code & EXCEPTION_BIT == 0 {
            row = functions.row(function, body);
            let layout = row.map(|row| if is_response { &row.response } else { &row.request });
            let decoded = layout.and_then(Layout::shape).map(|shape| decode(shape, body));
            used = decoded.as_ref().map_or(0, |decoded| decoded.covered_bytes);
            is_complete = decoded.as_ref().is_none_or(|decoded| decoded.complete);
            flatten(decoded.map(|decoded| decoded.fields).unwrap_or_default(), "", &mut parts);
        } else {
            // An exception response has no leading field.
            row = functions.row(function, &[]);
            used = body.len().min(1);
            is_complete = used == 1;
            if is_complete {
                let path = "exception_code".to_owned();
                parts.push(Part { name: "exception_code", path, field_type: &ONE_BYTE, offset: 1, bytes: &body[..1] });
            }
        }
        if used < body.len() {
            let bytes = &body[used..];
            parts.push(Part { name: EXTRA, path: EXTRA.to_owned(), field_type: &ANY_BYTES, offset: used + 1, bytes });
        }
        let exception = body.first().copied().filter(|_| code & EXCEPTION_BIT != 0);
        Self { function, row, exception, is_complete, parts }
    }

    /// The number in the field with this path.
    pub fn number(&self, path: &str) -> Option<u32> {
        self.parts.iter().rev().find(|part| part.path == path)?.number()
    }

    /// Whether the layout covers the bytes exactly and the table permits all values.
    fn is_valid(&self) -> bool {
        let is_permitted = |part: &Part<'_>| {
            let Some((value, row)) = part.number().zip(self.row) else { return true };
            row.limits(part.name).is_none_or(|(low, high)| (low..=high).contains(&value))
                && row.allowed(part.name).is_none_or(|allowed| allowed.contains(&value))
        };
        self.is_complete && self.parts.iter().all(|part| part.name != EXTRA && is_permitted(part))
    }
}

/// Appends fields with their path, and those of their groups in place of them.
fn flatten<'a>(nodes: Vec<DecodedField<'a>>, prefix: &str, parts: &mut Vec<Part<'a>>) {
    for DecodedField { field, offset, bytes, groups } in nodes {
        let path = format!("{prefix}{}", field.name);
        if matches!(field.field_type, FieldType::Group(_)) {
            for (index, group) in groups.into_iter().enumerate() {
                flatten(group, &format!("{path}[{index}]."), parts);
            }
        } else {
            parts.push(Part { name: &field.name, path, field_type: &field.field_type, offset: offset + 1, bytes });
        }
    }
}

/// The direction whose layout fits a PDU; `Unknown` where both or none fit.
///
/// Only the frames around it can tell for certain: an echo (functions 5, 6 ...) has the same layout in both directions.
pub fn guess_direction(functions: &Functions, pdu: &[u8]) -> Direction {
    if pdu.first().is_some_and(|code| code & EXCEPTION_BIT != 0) {
        return Direction::Response;
    }
    match [false, true].map(|is_response| Pdu::decode(functions, pdu, is_response).is_valid()) {
        [true, false] => Direction::Request,
        [false, true] => Direction::Response,
        _ => Direction::Unknown,
    }
}
