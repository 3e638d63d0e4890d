//! A look at the RTU frame at the head of a line before the framer decides: enough to tell whether it is a response to some
//! request.
//!
//! Only frames count whose layout gives their length, and whose checksum is valid.

use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::direction::{match_response, Direction, RequestRef, ResponseMatch};
use modlens_protocol::functions::{Extent, Functions, EXCEPTION_BIT};

/// A frame is found after fewer stray bytes than this.
const MAX_FRAME_START: usize = 4;

/// Bytes of an RTU frame beside the body of its PDU: unit, function code and checksum.
pub(super) const FRAME_OVERHEAD_BYTES: usize = 4;

/// How well the first bytes of a line fit as the response to a request, from the worst to the best.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Fit {
    /// Another unit or function.
    No,
    /// A whole frame of this unit and function that is the response to another request.
    Partly,
    /// Unit and function of a frame that is damaged or not complete yet.
    Header,
    /// A whole response to the request.
    Fully,
}

/// Compares the first bytes of a line with the response that a request must have. If no whole frame stands within the first
/// few bytes, it is looked there for the request's unit and function. `No` for a request without PDU, or if nothing is found.
pub(super) fn response_fit(functions: &Functions, bytes: &[u8], request: RequestRef<'_>) -> Fit {
    let Some(&function) = request.pdu.first() else { return Fit::No };
    if let Some((frame, _)) = first_frame(functions, bytes, Direction::Response) {
        return match match_response(functions, request, frame[0], &frame[1..]) {
            ResponseMatch::No => Fit::No,
            ResponseMatch::Partly => Fit::Partly,
            ResponseMatch::Fully => Fit::Fully,
        };
    }
    let is_header = |pair: &[u8]| pair[0] == request.unit && pair[1] & !EXCEPTION_BIT == function;
    if bytes.windows(2).take(MAX_FRAME_START).any(is_header) {
        Fit::Header
    } else {
        Fit::No
    }
}

/// Unit and PDU of the frame that a line's bytes begin with, at most three stray bytes in front of it, and the bytes after
/// it. `None` if it is not whole, or damaged.
pub(super) fn first_frame<'a>(functions: &Functions, bytes: &'a [u8], direction: Direction) -> Option<(&'a [u8], &'a [u8])> {
    let (at, frame) = (0..MAX_FRAME_START).find_map(|at| Some((at, frame_here(functions, bytes.get(at..)?, direction)?)))?;
    Some((frame, &bytes[at + frame.len() + CRC_BYTES..]))
}

/// Unit and PDU of the RTU frame that these bytes begin with, if the layout of its function in this direction gives its length
/// and the checksum is valid; bytes may follow it. `None` otherwise. An exception is never a request.
pub(super) fn frame_here<'a>(functions: &Functions, bytes: &'a [u8], direction: Direction) -> Option<&'a [u8]> {
    let (&code, body) = bytes.get(1..)?.split_first()?;
    let row = functions.row(code & !EXCEPTION_BIT, body)?;
    let length = match (code & EXCEPTION_BIT != 0, direction) {
        (true, Direction::Request) => return None,
        (true, _) => 1,
        (false, direction) => match if direction == Direction::Request { &row.request } else { &row.response }.extent(body) {
            Extent::Exactly(length) => length,
            _ => return None,
        },
    };
    let frame = bytes.get(..length + FRAME_OVERHEAD_BYTES).filter(|frame| crc_valid(frame))?;
    Some(&frame[..frame.len() - CRC_BYTES])
}
