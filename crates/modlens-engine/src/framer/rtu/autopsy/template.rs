//! What may have stood here: frames that the traffic around a gap lets one expect, as far as their bytes are known.

use std::borrow::Cow;

use crate::framer::rtu::autopsy::align::CHECKSUM;
use crate::framer::rtu::autopsy::Scene;
use crate::framer::rtu::gain::{REQUEST, RESPONSE};
use crate::framer::rtu::AROUND;
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::{expected_block, Asked, Direction};
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

/// A frame of which the first bytes are known, or all of them.
pub struct Template<'a> {
    /// The bytes known: the first ones.
    pub bytes: Cow<'a, [u8]>,
    /// How long the frame is, where that is known.
    pub length: Option<usize>,
    /// 0 for requests, 1 for responses.
    pub direction: usize,
    /// Bits that choose this template among those that may stand here.
    pub cost: f32,
}

impl Template<'_> {
    /// What the checksum may add to the bytes known: nothing, where it is one of them, or where it is unknown where it stands.
    pub fn checksum_at_most(&self) -> f32 {
        if self.length.is_some_and(|length| length > self.bytes.len()) {
            CHECKSUM
        } else {
            0.0
        }
    }
}

/// The answer that is due, or a retry of the request behind the gap.
const DUE: f32 = 1.0;

/// The request that waits, once more.
const RETRY: f32 = 4.0;

/// One of the requests of the poll cycle.
pub const POLL: f32 = 5.0;

/// An exception is one answer in twenty.
const EXCEPTION: f32 = 4.0;

/// Bytes that a response repeats from its request: address, and value or quantity.
const REPEATED: usize = 4;

/// What the frames around a gap let one expect in it.
pub fn around<'a>(scene: &Scene<'a, '_>) -> Vec<Template<'a>> {
    let mut templates = Vec::with_capacity(4);
    if let Some(asked) = scene.context.asked {
        templates.extend(answers(scene, asked).into_iter().flatten());
        templates.push(again(asked));
    }
    match scene.after {
        Some((frame, Direction::Request)) => templates.push(whole(frame, DUE)),
        Some((frame, Direction::Response)) if !answers_asked(scene, frame) => templates.push(request_of(scene, frame)),
        _ => {}
    }
    templates
}

/// A request of the poll cycle.
pub fn poll(frame: &[u8]) -> Template<'_> {
    whole(frame, POLL)
}

fn whole(frame: &[u8], cost: f32) -> Template<'_> {
    Template { bytes: Cow::Borrowed(frame), length: Some(frame.len()), direction: REQUEST, cost }
}

/// The request that waits, once more.
fn again<'a>(asked: Asked<'_>) -> Template<'a> {
    let mut bytes = vec![asked.unit];
    bytes.extend_from_slice(asked.pdu);
    bytes.extend(crc16(&bytes).to_le_bytes());
    Template { length: Some(bytes.len()), bytes: Cow::Owned(bytes), direction: REQUEST, cost: RETRY }
}

/// The request that a response answers, as far as it repeats it.
fn request_of<'a>(scene: &Scene<'a, '_>, response: &[u8]) -> Template<'a> {
    let (unit, code, body) = (response[0], response[1], &response[2..response.len() - 2]);
    let mut bytes = vec![unit, code & !EXCEPTION_BIT];
    let mut length = None;
    if let Some(row) = scene.context.functions.row(bytes[1], body) {
        if code & EXCEPTION_BIT == 0 && !row.echo.is_empty() {
            let repeated = if row.mirrored { body.len() } else { body.len().min(REPEATED) };
            bytes.extend_from_slice(&body[..repeated]);
        }
        if let Extent::Exactly(body) = row.request.extent(&bytes[2..]) {
            length = Some(body + AROUND);
        }
        if length == Some(bytes.len() + 2) {
            bytes.extend(crc16(&bytes).to_le_bytes());
        }
    }
    Template { bytes: Cow::Owned(bytes), length, direction: REQUEST, cost: DUE }
}

fn answers_asked(scene: &Scene<'_, '_>, frame: &[u8]) -> bool {
    let asked = scene.context.asked;
    asked.is_some_and(|asked| asked.unit == frame[0] && asked.pdu.first() == Some(&(frame[1] & !EXCEPTION_BIT)))
}

/// How long the answer to this request is, where the request says it.
pub fn answer_length(scene: &Scene<'_, '_>, asked: Asked<'_>) -> Option<usize> {
    answers(scene, asked)?[0].length
}

/// The answer to a request, and its refusal; a request without function has none.
fn answers<'a>(scene: &Scene<'a, '_>, asked: Asked<'_>) -> Option<[Template<'a>; 2]> {
    let (&code, body) = asked.pdu.split_first()?;
    let mut bytes = vec![asked.unit, code];
    let mut length = None;
    if let Some(row) = scene.context.functions.row(code, body) {
        if row.mirrored && !row.echo.is_empty() {
            bytes.extend_from_slice(body);
        } else if let Some(block) = expected_block(row, asked.pdu).and_then(|block| u8::try_from(block).ok()) {
            bytes.push(block);
        } else if !row.echo.is_empty() && body.len() >= REPEATED {
            bytes.extend_from_slice(&body[..REPEATED]);
        }
        if let Extent::Exactly(body) = row.response.extent(&bytes[2..]) {
            length = Some(body + AROUND);
        }
        if length == Some(bytes.len() + 2) {
            bytes.extend(crc16(&bytes).to_le_bytes());
        }
    }
    let refusal = vec![asked.unit, code | EXCEPTION_BIT];
    Some([
        Template { bytes: Cow::Owned(bytes), length, direction: RESPONSE, cost: DUE },
        Template { bytes: Cow::Owned(refusal), length: Some(5), direction: RESPONSE, cost: EXCEPTION },
    ])
}
