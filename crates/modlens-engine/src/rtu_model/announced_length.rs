//! The frame lengths that a header announces, by the table of functions.

use crate::frame_result::FramerContext;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, Layout, EXCEPTION_BIT};

/// Unit, function code and CRC: the bytes of a frame around its body.
pub const ENVELOPE_BYTES: usize = 4;

/// Unit, function code, exception code and CRC.
pub const EXCEPTION_RESPONSE_BYTES: usize = 5;

/// The whole-frame lengths that a header announces, with CRC, the likelier direction first: the response where the header
/// answers the context's outstanding request, else the request.
///
/// `frame` begins with unit and function code, and may have any number of bytes after them. An exception response has one
/// length, a function without row one of open length and unknown direction, and function code 0 none.
#[inline]
pub fn announced_lengths(context: &FramerContext<'_>, frame: &[u8]) -> [Option<(Direction, Extent)>; 2] {
    let (code, body) = (frame[1], &frame[2..]);
    let row = match context.functions.row(code, body) {
        Some(row) if code & EXCEPTION_BIT == 0 => row,
        _ => return [length_without_row(code), None],
    };
    let whole_frame = |layout: &Layout| with_envelope(layout.extent(body));
    let request = Some((Direction::Request, whole_frame(&row.request)));
    let response = (row.response != Layout::NoResponse).then(|| (Direction::Response, whole_frame(&row.response)));
    if context.outstanding_request.is_some_and(|request| request.unit == frame[0] && request.pdu.first() == Some(&code)) {
        [response, request]
    } else {
        [request, response]
    }
}

/// What a header announces whose function code has the exception bit, or no row in the table: `None` for function code 0, which
/// the specification does not have, so that a run of zeros is no frame.
#[inline]
fn length_without_row(code: u8) -> Option<(Direction, Extent)> {
    if code & !EXCEPTION_BIT == 0 {
        None
    } else if code & EXCEPTION_BIT != 0 {
        Some((Direction::Response, Extent::Exactly(EXCEPTION_RESPONSE_BYTES)))
    } else {
        Some((Direction::Unknown, Extent::Open(ENVELOPE_BYTES)))
    }
}

/// The length of a whole frame, given that of its body.
#[inline]
fn with_envelope(body: Extent) -> Extent {
    match body {
        Extent::Exactly(length) => Extent::Exactly(length + ENVELOPE_BYTES),
        Extent::AtLeast(length) => Extent::AtLeast(length + ENVELOPE_BYTES),
        Extent::Open(length) => Extent::Open(length + ENVELOPE_BYTES),
    }
}
