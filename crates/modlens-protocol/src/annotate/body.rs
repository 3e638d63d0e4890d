//! The blocks of a PDU.

use super::context::Context;
use super::field_meaning::{field_meaning, item_meaning};
use super::part::{guess_direction, Part, Pdu};
use super::piece::{spaced_hex, Layer, Meaning, Piece};
use crate::framing::Direction;
use crate::functions::{FieldType, Functions, EXCEPTION_BIT};
use crate::pdu::big_endian;

/// The name of the block that says that bytes are missing.
pub const MISSING: &str = "missing";

/// What is known of a PDU before it is decoded.
#[derive(Clone, Copy)]
pub struct Body<'a> {
    /// The table of functions.
    pub functions: &'a Functions,
    /// `Unknown` is settled by layout where that can be done, and taken for a request where both fit.
    pub direction: Direction,
    /// The PDU (without unit and checksum) that a response answers: with it registers and bits get their numbers.
    pub request: Option<&'a [u8]>,
}

impl Body<'_> {
    /// The blocks of a PDU that starts at the offset `start` of the frame.
    pub fn pieces(&self, pdu: &[u8], start: usize) -> Vec<Piece> {
        let Some(&code) = pdu.first() else {
            let missing = Meaning::wrong("no function code: the frame is truncated");
            return vec![Piece::new(Layer::Pdu, start, &[], "function", String::new(), missing)];
        };
        let direction = match self.direction {
            Direction::Unknown => guess_direction(self.functions, pdu),
            known => known,
        };
        let is_response = direction == Direction::Response;
        let request = self.request.filter(|_| is_response).map(|pdu| Pdu::decode(self.functions, pdu, false));
        let context = Context::new(Pdu::decode(self.functions, pdu, is_response), pdu.len(), is_response, request);
        let value = if code & EXCEPTION_BIT == 0 { code.to_string() } else { format!("0x{code:02X}") };
        let title = context.title(self.direction == Direction::Unknown);
        let mut pieces = vec![Piece::new(Layer::Pdu, start, &pdu[..1], "function", value, title)];
        for part in &context.pdu.parts {
            push_field(part, &context, start, &mut pieces);
        }
        if !context.pdu.is_complete {
            let missing = Meaning::wrong("bytes are missing from here on");
            pieces.push(Piece::new(Layer::Pdu, start + pdu.len(), &[], MISSING, String::new(), missing));
        }
        pieces
    }
}

/// Appends the block of a field; a list of numbers has a block per item, bits one per byte.
fn push_field(part: &Part<'_>, context: &Context<'_>, start: usize, pieces: &mut Vec<Piece>) {
    let offset = start + part.offset;
    let Some(item_bytes) = part.item_bytes() else {
        let value = part.number().map_or_else(|| spaced_hex(part.bytes), |number| number.to_string());
        pieces.push(Piece::new(Layer::Pdu, offset, part.bytes, &part.path, value, field_meaning(part, context)));
        return;
    };
    for (index, bytes) in part.bytes.chunks(item_bytes).enumerate() {
        let number = big_endian(bytes);
        let value = if *part.field_type == FieldType::Bits { format!("{number:08b}") } else { number.to_string() };
        let name = format!("{}[{index}]", part.path);
        let meaning = item_meaning(part, context, index as u32, number);
        pieces.push(Piece::new(Layer::Pdu, offset + index * item_bytes, bytes, &name, value, meaning));
    }
}
