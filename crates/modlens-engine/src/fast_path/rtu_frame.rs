//! Single frames that need no search: the response to the outstanding request, or a request of a unit and a function that
//! are familiar on this line, with the length that its header announces and a valid CRC. Nearly all traffic is of this
//! kind, so that the speed of the framer depends on this file.

use crate::fast_path::frame_check::{is_followed_by_copy, FrameCheck, FrameLength};
use crate::framer::rtu::announced_length::EXCEPTION_RESPONSE_BYTES;
use crate::framer::rtu::answerable::HeldRequest;
use crate::framer::rtu::crc_scan::MAX_CANDIDATE_BYTES;
use crate::framer::rtu::search::Search;
use crate::framer::rtu::side::REQUEST;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights::{MAX_POLL_REQUEST_BYTES, MAX_SKIPPED_STRAY_BYTES, RESPONSE_LOG_ODDS_BITS};
use modlens_protocol::checksum::crc_valid_at;
use modlens_protocol::direction::expected_data_bytes;
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::EXCEPTION_BIT;

/// Unit, function code and the first byte of the body.
const HEADER_BYTES: usize = 3;

/// Checks whether the first bytes of the input are a frame beyond doubt.
#[inline]
pub fn check_frame(search: &Search, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
    check_frame_at(search, input, context, 0)
}

/// Checks for a frame behind one to three stray bytes at the head of the input. Returns the number of stray bytes and the
/// result for the frame behind them; 0 and `NoFrame` if there is none. Changes nothing. The framer asks only in a recording,
/// where more bytes may be awaited.
///
/// Line drivers that are switched leave one to three stray bytes, fewer than the shortest frame has. The first place decides
/// at which a frame is found or may be once more bytes are there. It is rejected, and no further place is tried, if it is a
/// request that `is_permitted_request` does not admit, or if a frame may begin with one of the stray bytes and outscore it;
/// `NeedsMoreBytes` if that cannot be told yet.
pub fn check_frame_behind_strays(search: &Search, input: &Input, context: &FramerContext<'_>) -> (usize, FrameCheck) {
    for strays in 1..=MAX_SKIPPED_STRAY_BYTES {
        match check_frame_at(search, input, context, strays) {
            FrameCheck::NoFrame => {}
            FrameCheck::NeedsMoreBytes => return (strays, FrameCheck::NeedsMoreBytes),
            FrameCheck::Frame(length) => {
                let frame = &input.bytes()[strays..strays + length.bytes()];
                if length.is_request() && !is_permitted_request(frame, context) {
                    break;
                }
                return match search.rival_in_stray_bytes(input, context, strays, length.bytes()) {
                    FrameCheck::NoFrame => (strays, FrameCheck::Frame(length)),
                    FrameCheck::NeedsMoreBytes => (strays, FrameCheck::NeedsMoreBytes),
                    FrameCheck::Frame(_) => break,
                };
            }
        }
    }
    (0, FrameCheck::NoFrame)
}

/// Whether a frame with the length of a request keeps the limits of the specification and does not end in 00.
///
/// Otherwise it may be a response whose request is missing, followed by zero bytes: appending zeros to a frame with a
/// valid CRC keeps the CRC valid.
fn is_permitted_request(frame: &[u8], context: &FramerContext<'_>) -> bool {
    let body = &frame[2..frame.len() - 2];
    let row = context.functions.row(frame[1], body);
    let is_permitted = row.is_some_and(|row| row.field_limits[REQUEST].iter().all(|limits| limits.violated_by(body).is_none()));
    is_permitted && frame[frame.len() - 1] != 0
}

/// Checks for a frame that begins at this index of the input: its header must announce a length, its CRC must be valid,
/// and no record boundary or long silence may lie inside.
#[inline]
fn check_frame_at(search: &Search, input: &Input, context: &FramerContext<'_>, at: usize) -> FrameCheck {
    let bytes = input.bytes().get(at..).unwrap_or(&[]);
    if bytes.len() < HEADER_BYTES && !input.is_closed {
        return FrameCheck::NeedsMoreBytes;
    }
    let Some(length) = expected_length(search, input, context, at) else { return FrameCheck::NoFrame };
    let frame_bytes = length.bytes();
    if bytes.len() < frame_bytes {
        return if input.is_closed { FrameCheck::NoFrame } else { FrameCheck::NeedsMoreBytes };
    }
    let is_whole = crc_valid_at(bytes, frame_bytes) && input.boundary_after(0, at + frame_bytes - 1, input.break_ns).is_none();
    if is_whole {
        FrameCheck::Frame(length)
    } else {
        FrameCheck::NoFrame
    }
}

/// The length of the frame that begins at index `at` of the input, if its unit and function leave no doubt what it is. The
/// CRC is left to the caller. `None` in all cases but these:
///
/// - It has the unit and the function of the outstanding request, perhaps with the exception bit: `response_length`.
/// - A request to another unit is outstanding, and this is a familiar, short one at the first byte: once all of it is there, it
///   has to be a request of the poll cycle; before that, its announced length counts, so that the caller waits for it.
/// - No request is outstanding, and this is a familiar one: `request_length`.
#[inline]
fn expected_length(search: &Search, input: &Input, context: &FramerContext<'_>, at: usize) -> Option<FrameLength> {
    let bytes = input.bytes().get(at..)?;
    let (&unit, &code) = (bytes.first()?, bytes.get(1)?);
    let may_be_request = code & EXCEPTION_BIT == 0 && search.model.is_familiar(unit, code, REQUEST);
    match search.outstanding_request() {
        Some(request) if request.matches(unit, code & !EXCEPTION_BIT) => match request.expected_response {
            // Nearly always: the byte count is the one that the request determines.
            Some((count, length)) if code == request.pdu[0] && bytes.get(2) == Some(&count) => Some(FrameLength::exactly(length)),
            _ => response_length(request, input, context, at),
        },
        // The outstanding request was not answered, and the master goes on with the poll cycle.
        Some(request) if may_be_request && at == 0 && request.unit != unit => {
            let length = request_length(search, bytes, context).filter(|length| length.bytes() <= MAX_POLL_REQUEST_BYTES)?;
            let is_known_poll = |frame: &[u8]| is_permitted_request(frame, context) && search.model.poll_cycle.contains(frame);
            // While its last bytes are missing, it counts as one.
            Some(length).filter(|length| bytes.get(..length.bytes()).is_none_or(is_known_poll))
        }
        None if may_be_request => request_length(search, bytes, context),
        _ => None,
    }
}

/// The length of the frame at index `at` of the input as the response to the outstanding request, whose unit and function it
/// has; `None` if it is no certain response. There are at least two bytes from `at` on.
///
/// - An exception response: five bytes, once its exception code is there and not 0.
/// - Otherwise the layout has to announce a length, exact or at least, that is no longer than any frame, and the body has to
///   agree with the request: the byte count of a read, or the first four bytes that a write repeats, as far as they are there.
/// - If it repeats its whole request, it may be a retry. It is the response if the request is not in doubt itself and the
///   silence before it fits only a response. Else it counts only without times, at the first byte, and if no third
///   copy follows; while that cannot be told, the result is a length that more bytes have to come for.
fn response_length(request: &HeldRequest, input: &Input, context: &FramerContext<'_>, at: usize) -> Option<FrameLength> {
    let bytes = &input.bytes()[at..];
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        let has_exception_code = bytes.get(2).is_some_and(|&exception| exception != 0);
        return has_exception_code.then(|| FrameLength::exactly(EXCEPTION_RESPONSE_BYTES));
    }
    let row = context.functions.row(code, &request.pdu[1..])?;
    let length = FrameLength::of(row.response.extent(body))?;
    // A response that repeats its request and a retry of that request have the same bytes. Where neither the clock nor the
    // bytes that follow tell which of the two this is, the search weighs them. Without times, a third copy shows that the
    // second one may be a retry.
    let repeats_request = bytes.get(1..=request.pdu.len()) == Some(&request.pdu[..]);
    let equals_request = repeats_request && (row.has_equal_layouts || length.bytes() == request.pdu.len() + 3);
    let pause = || if at > 0 { input.silence_since(input.offset(), at) } else { input.pause_before(at) };
    if equals_request && request.is_unconfirmed {
        return None;
    }
    if equals_request && (context.timeout_log_odds)(pause()) > RESPONSE_LOG_ODDS_BITS {
        if at > 0 {
            return None;
        }
        match is_followed_by_copy(bytes, request.pdu.len() + 3) {
            Some(false) if !input.has_times => {}
            Some(_) => return None,
            None if input.has_times => return None,
            // One byte more than there are, so that the caller waits for what follows.
            None => return Some(FrameLength::at_least(bytes.len() + 1)),
        }
    }
    let agrees = match expected_data_bytes(row, &request.pdu) {
        Some(block) => body.first().is_some_and(|&count| usize::from(count) == block),
        None => !row.echo.is_empty() && (body.len() < 4 || body.get(..4) == request.pdu.get(1..5)),
    };
    Some(length).filter(|length| agrees && length.bytes() <= MAX_CANDIDATE_BYTES)
}

/// The length of these bytes as a request; `None` if they may as well be a response to an earlier request.
#[inline]
fn request_length(search: &Search, bytes: &[u8], context: &FramerContext<'_>) -> Option<FrameLength> {
    let (unit, code, body) = (bytes[0], bytes[1], &bytes[2..]);
    let row = context.functions.row(code, body)?;
    let length = FrameLength::of(row.request.extent(body)).filter(|length| length.bytes() <= MAX_RTU_FRAME_BYTES)?;
    // If a response would have the same length, this may be the last response once more, or a late one.
    if FrameLength::of(row.response.extent(body)).is_some_and(|other| other.bytes() == length.bytes()) {
        let open = search.answerable();
        let may_be_echo = row.has_equal_layouts && open.last_answered.is_some_and(|(request, _)| request.matches(unit, code));
        let may_be_response = may_be_echo
            || open.superseded.is_some_and(|request| request.matches(unit, code))
            || (!row.has_equal_layouts && open.last_answered.is_some_and(|(request, _)| request.matches(unit, code)));
        if may_be_response {
            return None;
        }
    }
    Some(length.as_request())
}
