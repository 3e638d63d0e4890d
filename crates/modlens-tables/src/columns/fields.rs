//! The decoded fields of a transaction, for functions whose content does not fit into other columns.

use serde_json::Value as Json;

use crate::columns::identification::identification;
use modlens_protocol::hex::push_hex;
use modlens_protocol::pdu::{self, DecodedField};

/// The decoded fields of a transaction. They are converted to text only where it is needed.
#[derive(Clone, Debug, Default)]
pub struct Fields<'a> {
    fields: Vec<DecodedField<'a>>,
    /// The bodies of request and response, if their layout is not known.
    pub(super) bodies: Vec<(&'static str, &'a [u8])>,
}

impl<'a> Fields<'a> {
    /// Adds a field. If the response repeats a field of the request, the value from the response is shown.
    pub(super) fn add(&mut self, field: DecodedField<'a>) {
        match self.fields.iter_mut().find(|known| known.field.name == field.field.name) {
            Some(known) => *known = field,
            None => self.fields.push(field),
        }
    }

    pub(super) fn remove(&mut self, name: &str) {
        if let Some(at) = self.fields.iter().position(|field| field.field.name == name) {
            self.fields.swap_remove(at);
        }
    }

    /// Whether there are no fields.
    pub(super) fn is_empty(&self) -> bool {
        self.fields.is_empty() && self.bodies.is_empty()
    }

    /// Appends the fields as a JSON object. The objects of Read Device Identification are in it twice: also as text,
    /// by name, under `identification`.
    pub fn push_json(&self, out: &mut Vec<u8>) {
        if self.bodies.is_empty() {
            pdu::push_object(&self.fields, out);
            let texts = identification(&self.fields);
            if !texts.is_empty() {
                out.pop();
                out.extend_from_slice(b",\"identification\":");
                out.extend_from_slice(Json::Object(texts).to_string().as_bytes());
                out.push(b'}');
            }
            return;
        }
        for (at, (key, body)) in self.bodies.iter().enumerate() {
            out.extend_from_slice(if at == 0 { b"{\"" } else { b",\"" });
            out.extend_from_slice(key.as_bytes());
            out.extend_from_slice(b"\":\"");
            push_hex(body, out);
            out.push(b'"');
        }
        out.push(b'}');
    }
}
