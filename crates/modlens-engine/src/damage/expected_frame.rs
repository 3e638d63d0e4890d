//! Frames that the traffic around an unframed region makes likely, as far as their bytes are known.

use std::borrow::Cow;

use crate::damage::region::UnframedRegion;
use crate::rtu_model::announced_length::{ENVELOPE_BYTES, EXCEPTION_RESPONSE_BYTES};
use crate::rtu_model::prefix_index::{may_have_byte, possible_frames, FrameSet, MAX_LOST_BYTES};
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::weights::{self, CRC_MATCH_BITS, DUE_FRAME_BITS, POLL_REQUEST_BITS, RETRY_BITS};
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::{expected_data_bytes, Direction, RequestRef};
use modlens_protocol::functions::{Extent, FunctionRow, EXCEPTION_BIT};

/// A frame of which the first bytes are known, or all of them.
pub struct ExpectedFrame<'a> {
    /// The known bytes, from the unit on.
    pub bytes: Cow<'a, [u8]>,
    /// Length of the whole frame in bytes, where it is known.
    pub length: Option<usize>,
    /// `REQUEST` or `RESPONSE`.
    pub direction: usize,
    /// Bits that it takes to choose this frame among all that may be here.
    pub selection_cost: f32,
}

impl ExpectedFrame<'_> {
    /// The most bits that the CRC can add to those of the known bytes. It adds nothing if it is itself among the known
    /// bytes, or if its place in the frame is unknown.
    pub fn max_crc_bits(&self) -> f32 {
        if self.length.is_some_and(|length| length > self.bytes.len()) {
            CRC_MATCH_BITS
        } else {
            0.0
        }
    }

    /// The most bytes that may be missing in front of this frame, where so many are `available` for the rest of it. If all known
    /// bytes are missing, only the CRC is left to recognise it by: that takes a known length, of which the rest is there.
    pub fn most_missing(&self, available: usize) -> usize {
        let known = self.bytes.len();
        let rest = self.length.and_then(|length| length.checked_sub(known));
        let has_crc = rest.is_some_and(|rest| (ENVELOPE_BYTES..=available).contains(&rest));
        MAX_LOST_BYTES.min(if has_crc { known } else { known - 1 })
    }

    /// Whether the frame may begin with these bytes.
    pub fn may_begin_with(&self, bytes: &[u8]) -> bool {
        let has_byte = |place: usize, byte: u8| FrameSet::from(may_have_byte(&self.bytes, place, byte));
        possible_frames(bytes, self.most_missing(bytes.len()), has_byte) != 0
    }
}

/// Bytes that a write response repeats from its request: the address, and the value or the quantity.
const ECHOED_BYTES: usize = 4;

/// The frames that the traffic around a region makes likely inside it.
///
/// Example: request `11 03 00 6B 00 03` is outstanding, and the same request follows the region. Then the region may hold
/// its response `11 03 06 ...`, its exception response `11 83 ...`, or the request itself as a damaged retry.
pub fn expected_frames<'a>(region: &UnframedRegion<'a, '_>) -> Vec<ExpectedFrame<'a>> {
    let mut frames = Vec::with_capacity(4);
    if let Some(request) = region.context.outstanding_request {
        frames.extend(responses(region, request).into_iter().flatten());
        frames.push(retry(request));
    }
    match region.next_frame {
        Some((frame, Direction::Request)) => frames.push(whole_request(frame, DUE_FRAME_BITS)),
        Some((frame, Direction::Response)) if !answers_outstanding(region, frame) => frames.push(request_of(region, frame)),
        _ => {}
    }
    frames
}

/// A request of the poll cycle.
pub fn poll_request(frame: &[u8]) -> ExpectedFrame<'_> {
    whole_request(frame, POLL_REQUEST_BITS)
}

fn whole_request(frame: &[u8], selection_cost: f32) -> ExpectedFrame<'_> {
    ExpectedFrame { bytes: Cow::Borrowed(frame), length: Some(frame.len()), direction: REQUEST, selection_cost }
}

/// The outstanding request, sent again.
fn retry<'a>(request: RequestRef<'_>) -> ExpectedFrame<'a> {
    let mut bytes = vec![request.unit];
    bytes.extend_from_slice(request.pdu);
    bytes.extend(crc16(&bytes).to_le_bytes());
    ExpectedFrame { length: Some(bytes.len()), bytes: Cow::Owned(bytes), direction: REQUEST, selection_cost: RETRY_BITS }
}

/// The request that this response answers, as far as the response repeats it. A damaged response may have fewer bytes than its
/// unit, function and CRC, but has unit and function; what it has besides those is not known to be its body.
pub(super) fn request_of<'a>(region: &UnframedRegion<'a, '_>, response: &[u8]) -> ExpectedFrame<'a> {
    let (unit, code, body) = (response[0], response[1], response.get(2..response.len() - 2).unwrap_or(&[]));
    let mut bytes = vec![unit, code & !EXCEPTION_BIT];
    let mut length = None;
    if let Some(row) = region.context.functions.row(bytes[1], body) {
        if code & EXCEPTION_BIT == 0 && !row.echo.is_empty() {
            let echoed = if row.has_equal_layouts { body.len() } else { body.len().min(ECHOED_BYTES) };
            bytes.extend_from_slice(&body[..echoed]);
        }
        if let Extent::Exactly(body) = row.request.extent(&bytes[2..]) {
            length = Some(body + ENVELOPE_BYTES);
        }
        append_crc_if_complete(&mut bytes, length);
    }
    ExpectedFrame { bytes: Cow::Owned(bytes), length, direction: REQUEST, selection_cost: DUE_FRAME_BITS }
}

/// Appends the CRC if only the CRC is missing from a frame of this length.
fn append_crc_if_complete(bytes: &mut Vec<u8>, length: Option<usize>) {
    if length == Some(bytes.len() + 2) {
        let crc = crc16(bytes);
        bytes.extend(crc.to_le_bytes());
    }
}

/// Whether a response has the unit and the function of the outstanding request.
fn answers_outstanding(region: &UnframedRegion<'_, '_>, frame: &[u8]) -> bool {
    let outstanding = region.context.outstanding_request;
    outstanding.is_some_and(|request| request.unit == frame[0] && request.pdu.first() == Some(&(frame[1] & !EXCEPTION_BIT)))
}

/// Length in bytes of the normal response to this request, where the request determines it.
pub fn response_length(region: &UnframedRegion<'_, '_>, request: RequestRef<'_>) -> Option<usize> {
    responses(region, request)?[0].length
}

/// The normal response and the exception response to a request, as far as the request determines their bytes; `None` if the
/// request has no function code. Of `region` only the table of functions is used.
fn responses<'a>(region: &UnframedRegion<'a, '_>, request: RequestRef<'_>) -> Option<[ExpectedFrame<'a>; 2]> {
    let (&code, body) = request.pdu.split_first()?;
    Some([normal_response(region, request, code, body), exception_response(request.unit, code)])
}

/// The normal response to a request with this function code and body. Of a function that the table does not have, only unit
/// and function are known. If the layout determines the length and only the CRC is missing, the CRC is appended, and all
/// bytes are known.
fn normal_response<'a>(region: &UnframedRegion<'_, '_>, request: RequestRef<'_>, code: u8, body: &[u8]) -> ExpectedFrame<'a> {
    let mut bytes = vec![request.unit, code];
    let mut length = None;
    if let Some(row) = region.context.functions.row(code, body) {
        append_known_body(&mut bytes, row, request, body);
        if let Extent::Exactly(body) = row.response.extent(&bytes[2..]) {
            length = Some(body + ENVELOPE_BYTES);
        }
        append_crc_if_complete(&mut bytes, length);
    }
    ExpectedFrame { bytes: Cow::Owned(bytes), length, direction: RESPONSE, selection_cost: DUE_FRAME_BITS }
}

/// Appends to `bytes`, which are unit and function, what the body of a request reports about the body of its normal response: all
/// of it where the function sends it back; else the byte count of a read, if it fits in a byte; else the first
/// `ECHOED_BYTES` of a write. Nothing for other functions, and for a write with a shorter body.
fn append_known_body(bytes: &mut Vec<u8>, row: &FunctionRow, request: RequestRef<'_>, body: &[u8]) {
    if row.has_equal_layouts && !row.echo.is_empty() {
        bytes.extend_from_slice(body);
    } else if let Some(count) = expected_data_bytes(row, request.pdu).and_then(|count| u8::try_from(count).ok()) {
        bytes.push(count);
    } else if !row.echo.is_empty() && body.len() >= ECHOED_BYTES {
        bytes.extend_from_slice(&body[..ECHOED_BYTES]);
    }
}

/// The exception response to a request with this function code: its first two bytes and its length are known.
fn exception_response<'a>(unit: u8, code: u8) -> ExpectedFrame<'a> {
    ExpectedFrame {
        bytes: Cow::Owned(vec![unit, code | EXCEPTION_BIT]),
        length: Some(EXCEPTION_RESPONSE_BYTES),
        direction: RESPONSE,
        selection_cost: weights::EXCEPTION_BITS,
    }
}
