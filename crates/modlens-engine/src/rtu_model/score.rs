//! The score of a frame hypothesis by its own bytes: what they are worth as a request or as a response, in bits. What the frames
//! before it add is in `context_score`.
//!
//! A score is the number of bits that the hypothesis saves over reading the same bytes as noise. Bytes that layout, limits
//! or the outstanding request predict are worth their information content; what has to be chosen (unit, function, length)
//! costs `-log2` of its learned share. A direction is given as its index, `REQUEST` or `RESPONSE`.

use crate::frame_result::FramerContext;
use crate::rtu_model::announced_length::EXCEPTION_RESPONSE_BYTES;
use crate::rtu_model::answerable::AnswerableRequest;
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::log2::log2;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::{counts_agree, expected_data_bytes};
use modlens_protocol::framing::BROADCAST_UNIT;
use modlens_protocol::functions::{Extent, FieldLimits, FunctionRow, Functions, Layout, Operation, EXCEPTION_BIT};

/// The longest pattern that is looked for.
const MAX_PERIOD_BYTES: usize = 4;

/// Whether no frame has this function code and this many bytes, whoever sent it: the code is 0, or has the exception bit and the
/// length is not that of an exception response. Runs of 00 and FF are full of such substrings with a valid CRC.
#[inline]
pub fn is_impossible(code: u8, length: usize) -> bool {
    code == 0 || (code & EXCEPTION_BIT != 0 && length != EXCEPTION_RESPONSE_BYTES)
}

/// Scores in bits of a frame by itself, as a request and as a response, whatever is before it; `None` where no frame of that
/// direction can look like this. The caller has found the CRC of `frame` to be valid, so its two bytes count with their
/// information content.
pub fn frame_scores(model: &TrafficModel, context: &FramerContext<'_>, frame: &[u8]) -> [Option<f32>; 2] {
    let frame = FrameBytes(frame);
    if is_impossible(frame.code(), frame.0.len()) {
        return [None; 2];
    }
    if frame.is_exception() {
        return [None, Some(exception_response_score(model, context.functions, frame))];
    }
    let row = context.functions.row(frame.code(), frame.body());
    let (crc, header) = (crc_score(model, frame), unchosen_header_score(model, frame));
    [REQUEST, RESPONSE].map(|direction| {
        let header = crc + (header - model.function_cost(context.functions, frame.code(), direction));
        let header = header - broadcast_cost(row, frame, direction);
        Some(match row {
            Some(row) => header + layout_score(model, row, frame.body(), direction),
            None => header - model.open_length_cost(frame.code(), direction, frame.body()),
        })
    })
}

/// Score in bits of unit and function code: the information content of each, less what it costs to choose it on this line.
fn header_score(model: &TrafficModel, functions: &Functions, frame: FrameBytes<'_>, direction: usize) -> f32 {
    unchosen_header_score(model, frame) - model.function_cost(functions, frame.code(), direction)
}

/// The same, but for the choice of the function code, which depends on the direction.
fn unchosen_header_score(model: &TrafficModel, frame: FrameBytes<'_>) -> f32 {
    model.bits(frame.unit()) - model.unit_cost(frame.unit()) + model.bits(frame.code())
}

/// Cost in bits of what never happens to the broadcast unit 0 (serial line specification, 2.1): that it responds, or that it is
/// asked to be read. 0 for all other frames. `row` is the function's.
fn broadcast_cost(row: Option<&FunctionRow>, frame: FrameBytes<'_>, direction: usize) -> f32 {
    let is_read = row.is_some_and(|row| row.operation == Operation::Read);
    if frame.unit() == BROADCAST_UNIT && (direction == RESPONSE || is_read) {
        weights::BROADCAST_READ_BITS
    } else {
        0.0
    }
}

/// Score in bits of a valid CRC: the information content of its bytes, of which a pattern that they continue leaves little.
fn crc_score(model: &TrafficModel, frame: FrameBytes<'_>) -> f32 {
    if continues_pattern(frame.0) {
        return CRC_BYTES as f32 * weights::PATTERN_BYTE_BITS;
    }
    model.bits_of(frame.crc())
}

/// Whether a frame ends in a pattern of one to `MAX_PERIOD_BYTES` bytes that its CRC continues: for one of these periods, the
/// CRC and the two periods before it are equal to what stands one period further in front. Runs of one byte and slow square
/// waves are such patterns. A frame shorter than CRC and two periods does not count for that period.
pub fn continues_pattern(frame: &[u8]) -> bool {
    (1..=MAX_PERIOD_BYTES).any(|period| {
        let length = CRC_BYTES + 2 * period;
        frame.len() >= length && frame[frame.len() - length..].windows(period + 1).all(|bytes| bytes[0] == bytes[period])
    })
}

/// Score in bits of an exception response with a valid CRC (application protocol, 7). `frame` has the exception bit and the five
/// bytes of an exception response (`is_impossible`), so its body is the exception code.
fn exception_response_score(model: &TrafficModel, functions: &Functions, frame: FrameBytes<'_>) -> f32 {
    let header = crc_score(model, frame) + header_score(model, functions, frame, RESPONSE);
    header - broadcast_cost(None, frame, RESPONSE) + exception_code_score(model, frame.code(), frame.body()[0])
}

/// Score in bits of the exception code after function code `code`: its information content, less the choice among the codes
/// (cheapest where the specification names them), a broken rule if `code` is the exception bit alone, and what an exception
/// costs at all.
fn exception_code_score(model: &TrafficModel, code: u8, exception: u8) -> f32 {
    let choice = match exception {
        0 => weights::ZERO_EXCEPTION_CODE_BITS,
        _ if is_specified_exception(exception) => weights::SPECIFIED_EXCEPTION_CODE_BITS,
        _ => weights::VENDOR_EXCEPTION_CODE_BITS,
    };
    let function = if code & !EXCEPTION_BIT == 0 { weights::BROKEN_RULE_BITS } else { 0.0 };
    model.bits(exception) - choice - function - weights::EXCEPTION_BITS
}

/// Whether the specification names this exception code (application protocol, 7).
fn is_specified_exception(exception: u8) -> bool {
    matches!(exception, 1..=6 | 8 | 10 | 11)
}

/// Whether the length of a body is one that its layout admits, and what that is worth in bits.
enum LengthScore {
    /// It is admitted: 0 if the layout fixes it, less if it leaves it open. Fields and counts are looked at as well.
    Admitted(f32),
    /// It is not admitted. Nothing else counts.
    Refused(f32),
}

/// Score in bits of a body (without function code and CRC) for its agreement with the layout of its function: length, limits
/// and byte counts.
///
/// A length that the layout fixes is worth nothing, one that it leaves open costs bits. Limited fields and a request's byte
/// count add to that; each rule broken costs `BROKEN_RULE_BITS`. Where the length is refused, nothing else counts.
fn layout_score(model: &TrafficModel, row: &FunctionRow, body: &[u8], direction: usize) -> f32 {
    let length = match length_score(model, row, body, direction) {
        LengthScore::Admitted(length) => length,
        LengthScore::Refused(score) => return score,
    };
    let fields = row.field_limits[direction].iter().map(|limits| field_score(model, limits, body)).sum::<f32>();
    let count = if direction == REQUEST { request_count_score(model, row, body) } else { -half_register_cost(row, body) };
    length + fields + count
}

/// What the length of a body says, by the layout of its function in this direction. A body that lacks just one byte, as the
/// layout of either direction announces it, is refused at a price of its own (`CUT_SHORT_BITS`): a frame whose last byte is 00
/// has a valid CRC without that byte as well, and then the hypothesis cuts the frame short. So it does where the length is right in
/// this direction, but the fields break their limits: eight bytes of a response are no request for 6000 registers.
fn length_score(model: &TrafficModel, row: &FunctionRow, body: &[u8], direction: usize) -> LengthScore {
    let (layout, other) = if direction == REQUEST { (&row.request, &row.response) } else { (&row.response, &row.request) };
    let is_cut_short = |layout: &Layout| layout.extent(body) == Extent::Exactly(body.len() + 1);
    if is_cut_short(other) && row.field_limits[direction].iter().any(|limits| limits.violated_by(body).is_some()) {
        return LengthScore::Refused(-weights::CUT_SHORT_BITS);
    }
    let shape = match layout {
        Layout::NoResponse => return LengthScore::Admitted(-weights::OPEN_LENGTH_BITS - weights::BROKEN_RULE_BITS),
        Layout::Unknown => return LengthScore::Admitted(-model.open_length_cost(row.code, direction, body)),
        Layout::Body(shape) => shape,
    };
    match shape.extent(body) {
        Extent::Exactly(length) if length == body.len() && shape.groups_fit(body) => LengthScore::Admitted(0.0),
        Extent::Exactly(length) if length == body.len() => LengthScore::Admitted(-weights::BROKEN_RULE_BITS),
        Extent::Open(least) if body.len() >= least => LengthScore::Admitted(-weights::OPEN_LENGTH_BITS),
        _ if is_cut_short(layout) || is_cut_short(other) => LengthScore::Refused(-weights::CUT_SHORT_BITS),
        _ => LengthScore::Refused(-weights::OPEN_LENGTH_BITS - weights::BROKEN_RULE_BITS),
    }
}

/// Score in bits of the byte count of a request that carries data: its information content if it agrees with quantity and
/// length, a broken rule if not. 0 for requests without data.
fn request_count_score(model: &TrafficModel, row: &FunctionRow, body: &[u8]) -> f32 {
    match row.offsets.request_block {
        Some((data_at, _)) if counts_agree(row, body) => model.bits(body[data_at - 1]),
        Some(_) => -weights::BROKEN_RULE_BITS,
        None => 0.0,
    }
}

/// Cost in bits of a response whose registers have an odd number of bytes: a broken rule. 0 for all others.
fn half_register_cost(row: &FunctionRow, body: &[u8]) -> f32 {
    match row.offsets.response_block {
        Some((data_at, is_bits)) if !is_bits && (body.len() - data_at) % 2 == 1 => weights::BROKEN_RULE_BITS,
        _ => 0.0,
    }
}

/// Whether the specification explains a frame with a valid CRC completely: its length, its counts and all of its limited fields.
/// Where any length would do, unit and function have to be familiar. An exception response is explained by a specified code.
pub fn is_understood(model: &TrafficModel, context: &FramerContext<'_>, frame: &[u8], direction: usize) -> bool {
    let frame = FrameBytes(frame);
    let body = frame.body();
    if frame.is_exception() {
        return is_specified_exception(body[0]);
    }
    let is_familiar = model.is_familiar(frame.unit(), frame.code(), direction);
    let Some(row) = context.functions.row(frame.code(), body) else { return is_familiar };
    let layout = if direction == REQUEST { &row.request } else { &row.response };
    let counts_agree = direction == RESPONSE || row.offsets.request_block.is_none() || counts_agree(row, body);
    let keeps_limits = || row.field_limits[direction].iter().all(|limits| limits.violated_by(body).is_none());
    explains_length(layout, body, is_familiar) && counts_agree && keeps_limits()
}

/// Whether a layout explains the length of a body: it fixes exactly this one, or leaves it open (this one included) and unit and
/// function are familiar.
fn explains_length(layout: &Layout, body: &[u8], is_familiar: bool) -> bool {
    match layout {
        Layout::NoResponse => false,
        Layout::Unknown => is_familiar,
        Layout::Body(shape) => match shape.extent(body) {
            Extent::Exactly(length) => length == body.len() && shape.groups_fit(body),
            Extent::Open(least) => body.len() >= least && is_familiar,
            Extent::AtLeast(_) => false,
        },
    }
}

/// Score in bits of a field with limited values: its information content, less the bits that choose among the values
/// permitted, at least 0; a broken rule if its value is not permitted. 0 where the body ends before the field does.
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

/// Score in bits of a frame with an invalid CRC, with what the outstanding request reports about it; `None` unless it is expected here
/// (see the two below). Function codes without a row, those of exception responses among them, never are. The caller guarantees
/// that the header announces exactly this length in this direction.
pub fn damaged_frame_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    outstanding: Option<&AnswerableRequest>,
    frame: &[u8],
    direction: usize,
) -> Option<f32> {
    let frame = FrameBytes(frame);
    let row = context.functions.row(frame.code(), frame.body())?;
    if direction == REQUEST {
        damaged_request_score(model, context.functions, row, frame, outstanding.is_some())
    } else {
        damaged_response_score(model, row, frame, outstanding?)
    }
}

/// Score in bits of a request with an invalid CRC; `None` unless unit and function are familiar and its byte count, if it has
/// one, agrees. `leaves_unanswered`: another request is outstanding.
fn damaged_request_score(
    model: &TrafficModel,
    functions: &Functions,
    row: &FunctionRow,
    frame: FrameBytes<'_>,
    leaves_unanswered: bool,
) -> Option<f32> {
    if !model.is_familiar(frame.unit(), frame.code(), REQUEST) || !counts_agree(row, frame.body()) {
        return None;
    }
    let header = header_score(model, functions, frame, REQUEST);
    let unanswered = if leaves_unanswered { weights::UNANSWERED_BITS } else { 0.0 };
    Some(header + layout_score(model, row, frame.body(), REQUEST) - weights::DAMAGED_BITS - unanswered)
}

/// Score in bits of a frame with an invalid CRC as the response to this outstanding request; `None` unless it has the request's
/// unit and function code, and the byte count that the request determines, if it determines one. Unit and function cost
/// nothing, because the request predicts them.
fn damaged_response_score(
    model: &TrafficModel,
    row: &FunctionRow,
    frame: FrameBytes<'_>,
    request: &AnswerableRequest,
) -> Option<f32> {
    let (unit, code) = (frame.unit(), frame.code());
    if !request.matches(unit, code) {
        return None;
    }
    let count = match expected_data_bytes(row, &request.pdu) {
        Some(expected) => model.bits(*frame.body().first().filter(|&&count| usize::from(count) == expected)?),
        None => 0.0,
    };
    Some(model.bits(unit) + model.bits(code) + count - weights::ANSWERED_BITS - weights::DAMAGED_BITS)
}
