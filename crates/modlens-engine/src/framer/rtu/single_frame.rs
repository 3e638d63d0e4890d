//! Single frames that need no search: the response to the outstanding request, or a request of a unit and a function that
//! are familiar on this line, with the length that its header announces and a valid CRC. Nearly all traffic is of this
//! kind, so that the speed of the framer depends on this file.

use crate::framer::rtu::frame_check::{is_followed_by_copy, FrameCheck, FrameLength};
use crate::framer::rtu::search::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::EXCEPTION_RESPONSE_BYTES;
use crate::rtu_model::answerable::{may_answer, AnswerableRequest};
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use crate::rtu_model::side::REQUEST;
use crate::weights::{MAX_POLL_REQUEST_BYTES, MAX_SKIPPED_STRAY_BYTES, RESPONSE_LOG_ODDS_BITS};
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::direction::expected_data_bytes;
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::{FunctionRow, Functions, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// Unit, function code and the first byte of the body.
const HEADER_BYTES: usize = 3;

/// Checks whether the first bytes of the input are a frame beyond doubt.
#[inline]
pub fn check_frame(search: &Search, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
    check_frame_at(search, input, context, 0)
}

/// Checks for a frame after one to three stray bytes at the head of the input. Returns the number of stray bytes and the
/// result for the frame after them; 0 and `NoFrame` if there is none. Changes nothing. The framer asks only in a recording,
/// where more bytes may be awaited.
///
/// Line drivers that are switched leave one to three stray bytes, fewer than the shortest frame has. The first place decides
/// at which a frame is found or may be again bytes are there. It is rejected, and no further place is tried, if it is a
/// request that `is_permitted_request` does not admit, or if a frame may begin with one of the stray bytes and outscore it;
/// `NeedsMoreBytes` if that cannot be distinguished yet.
pub fn check_frame_behind_strays(search: &Search, input: &Input, context: &FramerContext<'_>) -> (usize, FrameCheck) {
    for strays in 1..=MAX_SKIPPED_STRAY_BYTES {
        let check = match check_frame_at(search, input, context, strays) {
            FrameCheck::NoFrame => continue,
            FrameCheck::NeedsMoreBytes => FrameCheck::NeedsMoreBytes,
            FrameCheck::Frame(length) => check_against_strays(search, input, context, strays, length),
        };
        let is_rejected = matches!(check, FrameCheck::NoFrame);
        return if is_rejected { (0, check) } else { (strays, check) };
    }
    (0, FrameCheck::NoFrame)
}

/// Returns the frame of this length after `strays` stray bytes, unless it is a request that `is_permitted_request` does not admit,
/// or a frame may begin with one of the stray bytes and outscore it; `NeedsMoreBytes` if that cannot be distinguished yet.
fn check_against_strays(
    search: &Search,
    input: &Input,
    context: &FramerContext<'_>,
    strays: usize,
    length: FrameLength,
) -> FrameCheck {
    let frame = &input.bytes()[strays..strays + length.bytes()];
    if length.is_request() && !is_permitted_request(frame, context) {
        return FrameCheck::NoFrame;
    }
    match search.rival_in_stray_bytes(input, context, strays, length.bytes()) {
        FrameCheck::NoFrame => FrameCheck::Frame(length),
        FrameCheck::NeedsMoreBytes => FrameCheck::NeedsMoreBytes,
        FrameCheck::Frame(_) => FrameCheck::NoFrame,
    }
}

/// Returns whether a frame with the length of a request keeps the limits of the specification and does not end in 00.
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
    // In a recording, a sender that pauses inside a frame is waited for.
    let break_ns = if context.may_look_ahead { Ns::MAX } else { input.break_ns };
    let is_whole = crc_valid_at(bytes, frame_bytes) && input.boundary_after(0, at + frame_bytes - 1, break_ns).is_none();
    if is_whole {
        FrameCheck::Frame(length)
    } else {
        FrameCheck::NoFrame
    }
}

/// Returns the length of the frame that begins at index `at` of the input, if its unit and function leave no doubt what it is. The
/// CRC is left to the caller. `None` in all cases but these:
///
/// - It has the unit and the function of the outstanding request, perhaps with the exception bit: `response_length`.
/// - A request to another unit is outstanding, and this is a familiar one at the first byte: `next_poll_length`.
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
        Some(request) if may_be_request && at == 0 && request.unit != unit => next_poll_length(search, bytes, context),
        None if may_be_request => request_length(search, bytes, context),
        _ => None,
    }
}

/// Returns the length of these bytes as the next request of the poll cycle, with which the master goes on where the outstanding
/// request was not answered; `None` if it has more than `MAX_POLL_REQUEST_BYTES`. Once all of it is there, it has to be a permitted
/// request of the cycle; before that, it counts as one, so that the caller waits for it.
#[inline]
fn next_poll_length(search: &Search, bytes: &[u8], context: &FramerContext<'_>) -> Option<FrameLength> {
    let length = request_length(search, bytes, context).filter(|length| length.bytes() <= MAX_POLL_REQUEST_BYTES)?;
    let is_known_poll = |frame: &[u8]| is_permitted_request(frame, context) && search.model.poll_cycle.contains(frame);
    Some(length).filter(|length| bytes.get(..length.bytes()).is_none_or(is_known_poll))
}

/// Returns the length of the frame at index `at` of the input as the response to the outstanding request, whose unit and function
/// it has; `None` if it is no certain response. There are at least two bytes from `at` on.
///
/// - An exception response: five bytes, once its exception code is there and not 0.
/// - Otherwise the layout has to announce a length, exact or at least, that is no longer than any frame, and the body has to
///   agree with the request (`agrees_with_request`).
/// - If it repeats its whole request, it may be a retry: see `mirrored_frame`. While that cannot be distinguished, the result is a length
///   of one byte more than there are, so that the caller waits for what follows.
fn response_length(request: &AnswerableRequest, input: &Input, context: &FramerContext<'_>, at: usize) -> Option<FrameLength> {
    let bytes = &input.bytes()[at..];
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        let has_exception_code = body.first().is_some_and(|&exception| exception != 0);
        return has_exception_code.then(|| FrameLength::exactly(EXCEPTION_RESPONSE_BYTES));
    }
    let row = context.functions.row(code, &request.pdu[1..])?;
    let length = FrameLength::of(row.response.extent(body))?;
    let repeats_request = bytes.get(1..=request.pdu.len()) == Some(&request.pdu[..]);
    if repeats_request && (row.has_equal_layouts || length.bytes() == rtu_frame_bytes(&request.pdu)) {
        match mirrored_frame(request, input, context, at) {
            MirroredFrame::Response => {}
            MirroredFrame::Doubtful => return None,
            MirroredFrame::NeedsMoreBytes => return Some(FrameLength::at_least(bytes.len() + 1)),
        }
    }
    let is_certain = agrees_with_request(row, request, body) && length.bytes() <= MAX_CANDIDATE_BYTES;
    is_certain.then_some(length)
}

/// Returns the length in bytes of the frame around a PDU: unit and CRC are added.
fn rtu_frame_bytes(pdu: &[u8]) -> usize {
    1 + pdu.len() + CRC_BYTES
}

/// Returns whether the body of a response agrees with its request, as far as its first bytes are there: its byte count is the one
/// that the request determines; or, where the request determines none, the response repeats fields of the request and so its first
/// four bytes. `row` is the request's.
fn agrees_with_request(row: &FunctionRow, request: &AnswerableRequest, body: &[u8]) -> bool {
    match expected_data_bytes(row, &request.pdu) {
        Some(block) => body.first().is_some_and(|&count| usize::from(count) == block),
        None => !row.echo.is_empty() && (body.len() < 4 || body.get(..4) == request.pdu.get(1..5)),
    }
}

/// What a frame is that repeats the whole outstanding request: its response, or a retry of it with the same bytes.
enum MirroredFrame {
    /// The response.
    Response,
    /// Neither the clock nor the bytes that follow tell: the search weighs them.
    Doubtful,
    /// The bytes that follow may tell, once they are there.
    NeedsMoreBytes,
}

/// What the frame at index `at` of the input is, which repeats the whole outstanding request: the response, if the silence before
/// it fits only a response (`RESPONSE_LOG_ODDS_BITS`). Without times, and at the first byte, it is the response if no third
/// copy follows: that would show that the second one may be a retry. Doubtful in any case if the request is unconfirmed, and
/// where the frame comes sooner than any response, with nothing between: it may be an echo.
fn mirrored_frame(request: &AnswerableRequest, input: &Input, context: &FramerContext<'_>, at: usize) -> MirroredFrame {
    if request.is_unconfirmed || (at == 0 && context.comes_at_once(input, at)) {
        return MirroredFrame::Doubtful;
    }
    let silence = if at > 0 { input.silence_since(input.offset(), at) } else { input.pause_before(at) };
    if (context.timeout_log_odds)(silence) <= RESPONSE_LOG_ODDS_BITS {
        return MirroredFrame::Response;
    }
    if at > 0 || input.has_times {
        return MirroredFrame::Doubtful;
    }
    match is_followed_by_copy(input.bytes(), rtu_frame_bytes(&request.pdu)) {
        Some(true) => MirroredFrame::Doubtful,
        Some(false) => MirroredFrame::Response,
        None => MirroredFrame::NeedsMoreBytes,
    }
}

/// Returns the length of these bytes as a request; `None` if they may as well be a response to an earlier request, or are longer
/// than the specification permits. They begin with a unit and a function code without exception bit, and may go on after the
/// request.
#[inline]
fn request_length(search: &Search, bytes: &[u8], context: &FramerContext<'_>) -> Option<FrameLength> {
    let (code, body) = (bytes[1], &bytes[2..]);
    let row = context.functions.row(code, body)?;
    let length = FrameLength::of(row.request.extent(body)).filter(|length| length.bytes() <= MAX_RTU_FRAME_BYTES)?;
    let other = FrameLength::of(row.response.extent(body)).map_or(0, FrameLength::bytes);
    // A response one byte longer, whose CRC ends in 00, has a valid CRC without that byte, too; and one a byte shorter has one
    // with a stray 00 after it.
    let differs_by_zero = other.abs_diff(length.bytes()) == 1;
    if differs_by_zero && bytes.get(..length.bytes()).is_some_and(|frame| !is_permitted_request(frame, context)) {
        return None;
    }
    // If a response would have the same length, this may be the last response again, or a late one.
    let may_be_response =
        other == length.bytes() && !has_odd_registers(row, body) && may_answer_earlier_request(search, context.functions, bytes);
    (!may_be_response).then(|| length.as_request())
}

/// Returns whether the body of a response with a block of registers gives that an odd number of bytes, which no response has:
/// registers have two bytes each. So a request for registers from an address 0x03xx on is no response, though it has the length of
/// one.
fn has_odd_registers(row: &FunctionRow, body: &[u8]) -> bool {
    let is_odd = |at: usize| at.checked_sub(1).and_then(|at| body.get(at)).is_some_and(|count| count % 2 == 1);
    matches!(row.offsets.response_block, Some((at, false)) if is_odd(at))
}

/// Returns whether these bytes may answer the request that was answered last, again, or the superseded one, late.
fn may_answer_earlier_request(search: &Search, functions: &Functions, bytes: &[u8]) -> bool {
    let requests = search.answerable();
    requests.last_answered.is_some_and(|(request, _)| may_answer(functions, request.head(), bytes))
        || requests.superseded.is_some_and(|request| request.matches(bytes[0], bytes[1]))
}
