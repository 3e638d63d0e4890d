//! Two responses after two requests: a unit answers in the order in which it was asked.
//!
//! A bridge or a slow unit may respond after the master has given up and asked for something else. That response fits the next request
//! as well, if it is as long, and only a second one shows that both are on their way. A recording has it in the bytes that follow.

use crate::framer::FrameResult;
use crate::input::Input;
use crate::pairing::Pairing;
use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::direction::{match_response, Direction, ResponseMatch};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;

/// A frame that waits for the bytes after it: the index of its line, and its unit and PDU.
pub(crate) type WaitingFrame = (usize, FrameResult, Vec<u8>);

/// Whether a response, the first frame of this input, belongs to the request before the open one, which had none: it fits both, and right
/// after it comes another one that fits the open request. `None` if more bytes are needed.
pub(super) fn answers_previous(
    functions: &Functions,
    pairing: &Pairing,
    input: &Input,
    (framed, adu): (&FrameResult, &[u8]),
) -> Option<bool> {
    let is_response = framed.verdict == Verdict::Ok && framed.direction == Direction::Response;
    let Some((open, [unit, pdu @ ..])) = pairing.open.back().zip(adu.first_chunk::<2>().map(|_| adu)) else { return Some(false) };
    if !is_response
        || framed.mbap_id.is_some()
        || open.response.is_present()
        || !pairing.history.may_be_late(functions, open, adu)
    {
        return Some(false);
    }
    let fits = |unit: u8, pdu: &[u8]| match_response(functions, open.request_to(unit), unit, pdu) == ResponseMatch::Fully;
    let mirrors = functions.row(open.function, &pdu[1..]).is_none_or(|row| row.has_equal_layouts);
    if mirrors || open.mode != Mode::Rtu || !fits(*unit, pdu) {
        return Some(false);
    }
    let (frame, rest) = input.bytes().split_at(framed.length);
    let Some(next) = rest.get(..frame.len()) else { return input.is_closed.then_some(false) };
    Some(next != frame && crc_valid(next) && fits(next[0], &next[1..next.len() - CRC_BYTES]))
}
