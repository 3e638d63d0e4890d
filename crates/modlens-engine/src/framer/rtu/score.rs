//! The score of a frame hypothesis: what a substring with a valid CRC is worth as a request or as a response, in bits.
//!
//! A score is the number of bits that the hypothesis saves over reading the same bytes as noise. Bytes that layout, limits
//! or the outstanding request predict are worth their information content; what has to be chosen (unit, function, length)
//! costs `-log2` of its learned share.

use crate::framer::rtu::announced_length::EXCEPTION_RESPONSE_BYTES;
use crate::framer::rtu::answerable::{fingerprint, AnswerableRequests, HeldRequest};
use crate::framer::rtu::log2::log2;
use crate::framer::rtu::side::{REQUEST, RESPONSE};
use crate::framer::rtu::traffic_model::{FramePosition, TrafficModel};
use crate::framer::{FramerContext, PauseEvidence};
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::{counts_agree, expected_data_bytes, match_response, ResponseMatch, TimeoutLogOdds};
use modlens_protocol::framing::BROADCAST_UNIT;
use modlens_protocol::functions::{Extent, FieldLimits, FunctionRow, Layout, Operation, EXCEPTION_BIT};

/// The longest pattern that is looked for.
const MAX_PERIOD: usize = 4;

/// Bytes of a response's PDU that repeat its request: function code, address, and value or quantity.
const ECHOED_PDU_BYTES: usize = 5;

/// Whether no frame can look like this, whoever sent it: runs of 00 and FF are full of such substrings.
pub fn is_impossible(frame: &[u8]) -> bool {
    frame[1] == 0 || (frame[1] & EXCEPTION_BIT != 0 && frame.len() != EXCEPTION_RESPONSE_BYTES)
}

/// Score in bits of a frame by itself in this direction, whatever stands before it; `None` where no frame can look like this.
/// `frame` has its CRC, which is valid and so counts with its information content.
pub fn frame_score(model: &TrafficModel, context: &FramerContext<'_>, frame: &[u8], direction: usize) -> Option<f32> {
    let (unit, code) = (frame[0], frame[1]);
    let body = &frame[2..frame.len() - 2];
    if is_impossible(frame) || (code & EXCEPTION_BIT != 0 && direction == REQUEST) {
        return None;
    }
    let header =
        model.bits(unit) - model.unit_cost(unit) + model.bits(code) - model.function_cost(context.functions, code, direction);
    let mut score = crc_score(model, frame) + header;
    if direction == RESPONSE && unit == BROADCAST_UNIT {
        score -= weights::BROADCAST_READ_BITS;
    }
    if code & EXCEPTION_BIT != 0 {
        return Some(score + exception_score(model, code, body[0]));
    }
    let Some(row) = context.functions.row(code, body) else {
        return Some(score - model.open_length_cost(code, direction, body));
    };
    if direction == REQUEST && unit == BROADCAST_UNIT && row.operation == Operation::Read {
        score -= weights::BROADCAST_READ_BITS;
    }
    Some(score + layout_score(model, row, body, direction))
}

/// Score in bits of a valid CRC: the information content of its bytes, of which a pattern that they continue leaves little.
fn crc_score(model: &TrafficModel, frame: &[u8]) -> f32 {
    if continues_pattern(frame) {
        return CRC_BYTES as f32 * weights::PATTERN_BYTE_BITS;
    }
    model.bits_of(&frame[frame.len() - CRC_BYTES..])
}

/// Whether the last bytes of a frame, its CRC among them, repeat one to `MAX_PERIOD` bytes: as many as two periods before the
/// CRC, and at least two bytes. Runs of one byte and slow square waves do.
fn continues_pattern(frame: &[u8]) -> bool {
    (1..=MAX_PERIOD).any(|period| {
        let length = CRC_BYTES + 2 * period;
        frame.len() >= length && frame[frame.len() - length..].windows(period + 1).all(|bytes| bytes[0] == bytes[period])
    })
}

/// Score in bits of an exception response for its exception code (application protocol, 7).
fn exception_score(model: &TrafficModel, code: u8, exception: u8) -> f32 {
    let choice = match exception {
        1..=6 | 8 | 10 | 11 => weights::SPECIFIED_EXCEPTION_CODE_BITS,
        0 => weights::ZERO_EXCEPTION_CODE_BITS,
        _ => weights::VENDOR_EXCEPTION_CODE_BITS,
    };
    let function = if code & !EXCEPTION_BIT == 0 { weights::BROKEN_RULE_BITS } else { 0.0 };
    model.bits(exception) - choice - function - weights::EXCEPTION_BITS
}

/// Score in bits of a body (without function code and CRC) for its agreement with the layout of its function: length, limits
/// and byte counts.
///
/// A length that the layout fixes is worth nothing, one that it leaves open costs bits. Limited fields and a request's byte
/// count add to that; each rule broken costs `BROKEN_RULE_BITS`. Where the length does not fit, nothing else counts.
fn layout_score(model: &TrafficModel, row: &FunctionRow, body: &[u8], direction: usize) -> f32 {
    let (layout, other) = if direction == REQUEST { (&row.request, &row.response) } else { (&row.response, &row.request) };
    // A frame whose last byte is 00 has a valid CRC without that byte, too: then the hypothesis cuts the frame short.
    let is_cut_short = |layout: &Layout| matches!(layout.extent(body), Extent::Exactly(length) if length == body.len() + 1);
    let mut score = match layout {
        Layout::NoResponse => -weights::OPEN_LENGTH_BITS - weights::BROKEN_RULE_BITS,
        Layout::Unknown => -model.open_length_cost(row.code, direction, body),
        Layout::Body(shape) => match shape.extent(body) {
            Extent::Exactly(length) if length == body.len() && shape.groups_fit(body) => 0.0,
            Extent::Exactly(length) if length == body.len() => -weights::BROKEN_RULE_BITS,
            Extent::Open(least) if body.len() >= least => -weights::OPEN_LENGTH_BITS,
            _ if is_cut_short(layout) || is_cut_short(other) => return -weights::CUT_SHORT_BITS,
            _ => return -weights::OPEN_LENGTH_BITS - weights::BROKEN_RULE_BITS,
        },
    };
    score += row.field_limits[direction].iter().map(|permit| field_score(model, permit, body)).sum::<f32>();
    if direction == REQUEST {
        if let Some((at, _)) = row.offsets.request_block {
            score += if counts_agree(row, body) { model.bits(body[at - 1]) } else { -weights::BROKEN_RULE_BITS };
        }
    }
    // A block of registers with an odd number of bytes.
    let half_a_register = |&(at, is_bits): &(usize, bool)| !is_bits && (body.len() - at) % 2 == 1;
    if direction == RESPONSE && row.offsets.response_block.as_ref().is_some_and(half_a_register) {
        score -= weights::BROKEN_RULE_BITS;
    }
    score
}

/// Whether the specification explains a frame with a valid CRC completely: its length, its counts and all of its limited fields.
/// Where any length would do, unit and function have to be familiar.
pub fn is_understood(model: &TrafficModel, context: &FramerContext<'_>, frame: &[u8], direction: usize) -> bool {
    let (unit, code, body) = (frame[0], frame[1], &frame[2..frame.len() - CRC_BYTES]);
    if code & EXCEPTION_BIT != 0 {
        return matches!(body[0], 1..=6 | 8 | 10 | 11);
    }
    let is_familiar = || model.is_familiar(unit, code, direction);
    let Some(row) = context.functions.row(code, body) else { return is_familiar() };
    let has_length = match if direction == REQUEST { &row.request } else { &row.response } {
        Layout::NoResponse => false,
        Layout::Unknown => is_familiar(),
        Layout::Body(shape) => match shape.extent(body) {
            Extent::Exactly(length) => length == body.len() && shape.groups_fit(body),
            Extent::Open(least) => body.len() >= least && is_familiar(),
            Extent::AtLeast(_) => false,
        },
    };
    let counts_agree = direction == RESPONSE || row.offsets.request_block.is_none() || counts_agree(row, body);
    has_length && counts_agree && row.field_limits[direction].iter().all(|permit| permit.violated_by(body).is_none())
}

/// Score in bits of a field with limited values: its information content, less the bits that choose among the values
/// permitted.
///
/// A field of FC 5 may be 0000 or FF00: two of 65536 values, so it is worth nearly all of its bits.
pub fn field_score(model: &TrafficModel, permit: &FieldLimits, body: &[u8]) -> f32 {
    let Some(field) = body.get(permit.offset..permit.offset + permit.width) else { return 0.0 };
    if permit.violated_by(body).is_some() {
        return -weights::BROKEN_RULE_BITS;
    }
    let choices: u64 = permit.ranges.iter().map(|(low, high)| u64::from(high - low) + 1).sum();
    (model.bits_of(field) - log2(choices as f32)).max(0.0)
}

/// What stands before a frame hypothesis on its path.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Preceding {
    /// Bytes between the frame before and this one.
    pub unframed_bytes: u64,
    /// The frame's own unit and function stand among them: perhaps its request, damaged.
    pub has_same_header: bool,
}

/// Score in bits that the frames before it add to a frame hypothesis, and whether it answers the outstanding request.
///
/// `pause` is what the silence before the frame says. A request never answers.
pub fn context_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    answerable: AnswerableRequests<'_>,
    frame: &[u8],
    direction: usize,
    pause: PauseEvidence,
    preceding: Preceding,
) -> (f32, bool) {
    // Between two frames stand other bytes, so the second one does not come at once.
    let too_soon_bits = if preceding.unframed_bytes == 0 { pause.too_soon_bits } else { [0.0; 2] };
    let pause = PauseEvidence { too_soon_bits, ..pause };
    if direction == REQUEST {
        (request_context_score(model, context, answerable, frame, pause, preceding), false)
    } else {
        response_context_score(model, context, answerable, frame, pause, preceding)
    }
}

fn position(answerable: AnswerableRequests<'_>, preceding: Preceding) -> FramePosition {
    FramePosition { request_outstanding: answerable.outstanding.is_some(), unframed_bytes: preceding.unframed_bytes }
}

/// Costs in bits of a request and of an unsolicited response at this place.
fn turn_costs(model: &TrafficModel, answerable: AnswerableRequests<'_>, preceding: Preceding) -> (f32, f32) {
    model.turn_costs(position(answerable, preceding))
}

/// Whether the response to this request repeats it byte by byte, as that to function 6 does.
pub fn mirrors_request(context: &FramerContext<'_>, pdu: &[u8]) -> bool {
    context.functions.row(pdu[0], &pdu[1..]).is_some_and(|row| row.has_equal_layouts)
}

/// Whether the request that was answered last was heard twice before its response.
fn last_was_echoed(answerable: AnswerableRequests<'_>) -> bool {
    answerable.last_answered.is_some_and(|(request, _)| request.is_repeated)
}

/// Score in bits of a request while none is outstanding, for being one that stood there before: the last one, whose response
/// was equal to it, or one that got no response. Its body is known then. Where responses have a line of their own, no response
/// looks like a request, and nothing is gained.
fn request_again_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    answerable: AnswerableRequests<'_>,
    frame: &[u8],
    pause: PauseEvidence,
    preceding: Preceding,
) -> f32 {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let is_same = |request: &HeldRequest| request.unit == unit && request.pdu == pdu;
    let is_answered = answerable.last_answered.is_some_and(|(request, last)| is_same(request) && last == fingerprint(frame));
    let choice = match answerable.superseded.is_some_and(is_same) {
        _ if context.is_multi_line || recurs_in_noise(model, unit, preceding) => return 0.0,
        _ if is_answered => model.same_again_cost() - pause.poll.min(0.0) + pause.too_soon_bits[1],
        true => weights::RETRY_CHOICE_BITS,
        false => return 0.0,
    };
    model.unit_cost(unit) + model.function_cost(context.functions, pdu[0], REQUEST) + model.bits_of(&pdu[1..]) - choice
}

/// The part of `context_score` for requests: is it polled, a retry, an echo, or another master's? In each case it gains what
/// the dictionary or the same request before predicts of its bytes, whichever is more, and costs the turn that it takes:
/// - nothing outstanding: the cost of a request there;
/// - the outstanding request once more: a retry, which a silence as long as a response time makes dearer, or an echo;
/// - another request: the cost of leaving one unanswered, and more if it comes as early as responses do.
fn request_context_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    answerable: AnswerableRequests<'_>,
    frame: &[u8],
    pause: PauseEvidence,
    preceding: Preceding,
) -> f32 {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let (unanswered, _) = turn_costs(model, answerable, preceding);
    let polled = model.polled_request_score(frame);
    let is_same = |request: &HeldRequest| request.unit == unit && request.pdu == pdu;
    let Some(outstanding) = answerable.outstanding else {
        return polled.max(request_again_score(model, context, answerable, frame, pause, preceding)) - unanswered;
    };
    let too_soon_for_retry = pause.too_soon_bits.iter().sum::<f32>();
    let pause = pause.timeout;
    if is_same(outstanding) {
        let mirrors = mirrors_request(context, pdu);
        // The same request stands before the outstanding one, too.
        let third_time = answerable.superseded.is_some_and(is_same);
        let unanswered = if mirrors { model.silence_costs(unit, position(answerable, preceding)).0 } else { unanswered };
        let unanswered = if third_time { unanswered.min(weights::STILL_SILENT_BITS) } else { unanswered };
        // A retry comes after a timeout; the echo of the tap's own adapter comes once, at once.
        let retry = unanswered - pause.min(0.0) + if mirrors { too_soon_for_retry } else { 0.0 };
        let was_echoed = mirrors && last_was_echoed(answerable);
        let echo = model.echo_costs().0.min(if was_echoed { weights::ECHO_AGAIN_BITS } else { f32::MAX });
        let late = if mirrors { (-pause).clamp(0.0, weights::LATE_ECHO_BITS) } else { 0.0 };
        let again = if outstanding.is_repeated { retry } else { retry.min(echo + late) };
        if recurs_in_noise(model, unit, preceding) {
            return polled - again;
        }
        let known = model.unit_cost(unit) + model.function_cost(context.functions, pdu[0], REQUEST) + model.bits_of(&pdu[1..]);
        return polled.max(known - weights::RETRY_CHOICE_BITS) - again;
    }
    // The request before the outstanding one, repeated: then the outstanding one was rather another frame.
    let is_superseded = answerable.superseded.is_some_and(is_same);
    let known = if is_superseded { model.bits_of(&pdu[1..]) - weights::RETRY_CHOICE_BITS } else { 0.0 };
    // No master gives up as soon as responses come. With unframed bytes in between, the response may be among those.
    let too_soon = if preceding.unframed_bytes == 0 { (-pause).clamp(0.0, weights::TOO_SOON_BITS) } else { 0.0 };
    polled.max(known) - unanswered - too_soon
}

/// Whether the same bytes once more, as a retry or as a response that equals its request, prove nothing: noise that repeats
/// itself was to be expected to do so, and no frame that teaches has named this unit.
fn recurs_in_noise(model: &TrafficModel, unit: u8, preceding: Preceding) -> bool {
    preceding.unframed_bytes >= weights::MAY_HIDE_FRAME_BYTES && !model.has_unit(unit)
}

/// The part of `context_score` for responses: does it answer the outstanding request, and how much of it was predicted?
///
/// One that does not answer costs an unsolicited response, unless it scores better as a late or repeated one. One that answers
/// gains unit, function and the body bytes that its request predicts; no body bytes if that request is damaged or its function
/// specifies no response, or for an exception response. A count that disagrees breaks a rule. Where it equals its request, it may
/// be an echo or a retry instead, so a silence as long as a timeout costs bits.
fn response_context_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    answerable: AnswerableRequests<'_>,
    frame: &[u8],
    pause: PauseEvidence,
    preceding: Preceding,
) -> (f32, bool) {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let outstanding = answerable.outstanding;
    let (_, unsolicited) = turn_costs(model, answerable, preceding);
    let matched =
        outstanding.map_or(ResponseMatch::No, |request| match_response(context.functions, request.as_request_ref(), unit, pdu));
    let Some(request) = outstanding.filter(|_| matched != ResponseMatch::No) else {
        let after_damage = preceding.has_same_header && outstanding.is_none();
        let unsolicited = unsolicited - if after_damage { weights::DAMAGED_REQUEST_BITS } else { 0.0 };
        return (belated_response_score(model, context, answerable, frame, pause.timeout).max(-unsolicited), false);
    };
    // Unit and function are predicted by the request.
    let mut score = model.unit_cost(unit) + model.function_cost(context.functions, pdu[0], RESPONSE) - weights::ANSWERED_BITS;
    if let Some(row) = context.functions.row(request.pdu[0], &request.pdu[1..]).filter(|_| pdu[0] & EXCEPTION_BIT == 0) {
        let is_last_response = |(_, last): (&HeldRequest, _)| last == fingerprint(frame);
        if row.response == Layout::NoResponse || request.is_damaged {
            // No response is predicted, or not its fields; if one comes, it is this one all the same.
        } else if matched == ResponseMatch::Partly {
            score -= weights::BROKEN_RULE_BITS;
        } else if answerable.last_answered.is_some_and(is_last_response) {
            // The same bytes as the response to the same request before: all of them are predicted.
            score += model.bits_of(&pdu[1..]);
        } else {
            let recurs = request.pdu == pdu && recurs_in_noise(model, unit, preceding);
            score += if recurs { 0.0 } else { predicted_body_score(model, row, request, pdu) };
        }
    }
    if request.pdu == pdu {
        let missing_echo = if last_was_echoed(answerable) { weights::ECHO_MISSING_BITS } else { 0.0 };
        score += weights::ANSWERED_BITS - model.silence_costs(unit, position(answerable, preceding)).1;
        score -= pause.timeout.max(0.0)
            + pause.too_soon_bits[0]
            + if request.is_repeated { 0.0 } else { model.echo_costs().1.max(missing_echo) };
    }
    (score, true)
}

/// Score in bits of the bytes of a response that its request predicts: the byte count; or all of them if it equals its request;
/// or the two fields in front where it repeats any (`row.echo`). `pdu` is the response's, which answers in full.
fn predicted_body_score(model: &TrafficModel, row: &FunctionRow, request: &HeldRequest, pdu: &[u8]) -> f32 {
    if expected_data_bytes(row, &request.pdu).is_some() {
        model.bits(pdu[1])
    } else if request.pdu == pdu {
        model.bits_of(&pdu[1..])
    } else if row.echo.is_empty() {
        0.0
    } else {
        model.bits_of(&pdu[1..pdu.len().min(ECHOED_PDU_BYTES)])
    }
}

/// Score in bits of a response that does not answer the outstanding request: as the late response to the superseded request, or
/// as a copy of the last response; the better of the two, and `f32::MIN` where it fits neither. Both need a request that it
/// answers in full, and gain unit, function and the body bytes predicted.
fn belated_response_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    answerable: AnswerableRequests<'_>,
    frame: &[u8],
    pause: TimeoutLogOdds,
) -> f32 {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let fits =
        |request: &&HeldRequest| match_response(context.functions, request.as_request_ref(), unit, pdu) == ResponseMatch::Fully;
    let late = answerable.superseded.filter(fits).map(|request| {
        // After a timeout, what equals the request is rather its retry.
        let may_be_request = if request.pdu == pdu { pause.max(0.0) + spanning_cost(answerable, request) } else { 0.0 };
        (request, model.late_response_cost() + may_be_request, false)
    });
    // A response that equals its request, once more, is rather the same request again.
    let last = answerable.last_answered.filter(|(request, last)| *last == fingerprint(frame) && request.pdu != pdu);
    let repeated = last.map(|(request, _)| request).filter(fits).map(|request| (request, weights::REPEATED_RESPONSE_BITS, true));
    let scores = late.into_iter().chain(repeated).map(|(request, cost, is_copy)| {
        let row = context.functions.row(request.pdu[0], &request.pdu[1..]).filter(|_| pdu[0] & EXCEPTION_BIT == 0);
        let body = row.map_or(0.0, |row| {
            if is_copy {
                // A copy has to agree in every byte. If less were enough, the two would look like a request and its retry.
                model.bits_of(&pdu[1..])
            } else {
                predicted_body_score(model, row, request, pdu)
            }
        });
        model.unit_cost(unit) + model.function_cost(context.functions, pdu[0], RESPONSE) + body - cost
    });
    scores.fold(f32::MIN, f32::max)
}

/// Cost in bits of a late response that equals its request, for what stands between the two: nothing if that is the retry of
/// this request, else a whole exchange of another unit.
fn spanning_cost(answerable: AnswerableRequests<'_>, request: &HeldRequest) -> f32 {
    let is_retry = |other: &HeldRequest| other.unit == request.unit && other.pdu == request.pdu;
    let between = answerable.outstanding.or(answerable.last_answered.map(|(answered, _)| answered));
    if answerable.outstanding.is_some() || between.is_some_and(is_retry) {
        0.0
    } else {
        weights::SPANS_EXCHANGE_BITS
    }
}

/// Score in bits of a frame with an invalid CRC; `None` unless it is expected here: a request of a familiar unit and function
/// whose byte count agrees, or the response to the outstanding request, with the byte count that this determines. Exception
/// responses are `None`. The caller has seen to it that the header announces exactly this length.
pub fn damaged_frame_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    outstanding: Option<&HeldRequest>,
    frame: &[u8],
    direction: usize,
) -> Option<f32> {
    let (unit, code, body) = (frame[0], frame[1], &frame[2..frame.len() - 2]);
    let row = context.functions.row(code, body)?;
    if direction == REQUEST {
        if !model.is_familiar(unit, code, REQUEST) || !counts_agree(row, body) {
            return None;
        }
        let header =
            model.bits(unit) - model.unit_cost(unit) + model.bits(code) - model.function_cost(context.functions, code, REQUEST);
        let unanswered = if outstanding.is_some() { weights::UNANSWERED_BITS } else { 0.0 };
        return Some(header + layout_score(model, row, body, REQUEST) - weights::DAMAGED_BITS - unanswered);
    }
    let request = outstanding.filter(|request| request.matches(unit, code))?;
    let expected = expected_data_bytes(row, &request.pdu);
    if expected.is_some_and(|expected| body.first().map(|&count| usize::from(count)) != Some(expected)) {
        return None;
    }
    let count = if expected.is_some() { model.bits(body[0]) } else { 0.0 };
    Some(model.bits(unit) + model.bits(code) + count - weights::ANSWERED_BITS - weights::DAMAGED_BITS)
}
