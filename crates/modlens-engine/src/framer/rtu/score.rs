//! What a substring with a right CRC is worth as a request or as a response.

use crate::framer::rtu::announced_length::announced;
use crate::framer::rtu::bits::log2;
use crate::framer::rtu::costs;
use crate::framer::rtu::model::{Model, Setting};
use crate::framer::rtu::pending::{print, Open, Request};
use crate::framer::Context;
use modlens_protocol::direction::{answers, consistent, expected_block, Direction, Match, Pause};
use modlens_protocol::framing::BROADCAST;
use modlens_protocol::functions::{Extent, FieldLimits, FunctionRow, Layout, Operation, EXCEPTION_BIT};

/// 0 for requests, 1 for responses: the index of learned counts.
pub const REQUEST: usize = 0;
/// See `REQUEST`.
pub const RESPONSE: usize = 1;

/// The direction of an index.
pub fn direction(index: usize) -> Direction {
    if index == REQUEST {
        Direction::Request
    } else {
        Direction::Response
    }
}

/// Whether no frame can look so, whoever sent it: runs of zeros and ones are full of these.
pub fn is_none(frame: &[u8]) -> bool {
    const REFUSAL: usize = 5;
    frame[1] == 0 || (frame[1] & EXCEPTION_BIT != 0 && frame.len() != REFUSAL)
}

/// Bits that the frame itself saves, read in this direction; `None` where no frame can look so.
pub fn frame(model: &Model, context: &Context<'_>, frame: &[u8], direction: usize) -> Option<f32> {
    let (unit, code) = (frame[0], frame[1]);
    let body = &frame[2..frame.len() - 2];
    if is_none(frame) || (code & EXCEPTION_BIT != 0 && direction == REQUEST) {
        return None;
    }
    let header = model.bits(unit) - model.unit(unit) + model.bits(code) - model.function(context.functions, code, direction);
    let mut gain = model.bits_of(&frame[frame.len() - 2..]) + header;
    if direction == RESPONSE && unit == BROADCAST {
        gain -= costs::BROADCAST_READ;
    }
    if code & EXCEPTION_BIT != 0 {
        return Some(gain + exception(model, code, body[0]));
    }
    let Some(row) = context.functions.row(code, body) else { return Some(gain - model.open_length(code, direction, body)) };
    if direction == REQUEST && unit == BROADCAST && row.operation == Operation::Read {
        gain -= costs::BROADCAST_READ;
    }
    Some(gain + layout(model, row, body, direction))
}

fn exception(model: &Model, code: u8, exception: u8) -> f32 {
    // The specification has codes 1 to 11; vendors have their own, but none of them is 0.
    let usual = match exception {
        1..=6 | 8 | 10 | 11 => 3.5,
        0 => 16.0,
        _ => 9.0,
    };
    let function = if code & !EXCEPTION_BIT == 0 { costs::BROKEN_RULE } else { 0.0 };
    model.bits(exception) - usual - function - costs::EXCEPTION
}

fn layout(model: &Model, row: &FunctionRow, body: &[u8], direction: usize) -> f32 {
    let layout = if direction == REQUEST { &row.request } else { &row.response };
    let other = if direction == REQUEST { &row.response } else { &row.request };
    // A frame whose last byte was 00 keeps a right checksum without it: then it was cut short.
    let cut_short = |layout: &Layout| matches!(layout.extent(body), Extent::Exactly(length) if length == body.len() + 1);
    let mut gain = match layout {
        Layout::Silent => -costs::OPEN_LENGTH - costs::BROKEN_RULE,
        Layout::Unknown => -model.open_length(row.code, direction, body),
        Layout::Body(shape) => match shape.extent(body) {
            Extent::Exactly(length) if length == body.len() && shape.groups_fit(body) => 0.0,
            Extent::Exactly(length) if length == body.len() => -costs::BROKEN_RULE,
            Extent::Open(least) if body.len() >= least => -costs::OPEN_LENGTH,
            _ if cut_short(layout) || cut_short(other) => return -costs::CUT_SHORT,
            _ => return -costs::OPEN_LENGTH - costs::BROKEN_RULE,
        },
    };
    gain += row.permits[direction].iter().map(|permit| permitted(model, permit, body)).sum::<f32>();
    if direction == REQUEST {
        if let Some((at, _)) = row.roles.request_block {
            gain += if consistent(row, body) { model.bits(body[at - 1]) } else { -costs::BROKEN_RULE };
        }
    }
    if direction == RESPONSE && row.roles.response_block.is_some_and(|(at, bit)| !bit && (body.len() - at) % 2 == 1) {
        gain -= costs::BROKEN_RULE;
    }
    gain
}

/// A field within its limits is worth its bits less those that choose among the values permitted.
pub fn permitted(model: &Model, permit: &FieldLimits, body: &[u8]) -> f32 {
    let Some(field) = body.get(permit.offset..permit.offset + permit.width) else { return 0.0 };
    if permit.violated_by(body).is_some() {
        return -costs::BROKEN_RULE;
    }
    let choices: u64 = permit.ranges.iter().map(|(low, high)| u64::from(high - low) + 1).sum();
    (model.bits_of(field) - log2(choices as f32)).max(0.0)
}

/// What the request that waits makes of a frame: bits, and whether it is answered.
///
/// Before the frame stand so many bytes that are no frame, its own unit and function perhaps among them.
pub fn context(
    model: &Model,
    context: &Context<'_>,
    pending: Open<'_>,
    frame: &[u8],
    direction: usize,
    pause: Pause,
    (junk, begun): (u64, bool),
) -> (f32, bool) {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let asked = pending.asked;
    let (unanswered, orphan) = model.turn(Setting { waiting: asked.is_some(), junk });
    if direction == REQUEST {
        let repeated = model.repeated(frame);
        let Some(asked) = asked else { return (repeated - unanswered, false) };
        if asked.unit == unit && asked.pdu == pdu {
            let twice = pending.late.as_ref().is_some_and(|late| late.unit == unit && late.pdu == pdu);
            let unanswered = if twice { unanswered.min(costs::STILL_SILENT) } else { unanswered };
            // A retry comes after a time-out; the echo of the tap's own adapter comes once, at once.
            let retry = unanswered - pause.min(0.0);
            let again = if asked.copied { retry } else { retry.min(model.copied().0) };
            let known = model.unit(unit) + model.function(context.functions, pdu[0], REQUEST) + model.bits_of(&pdu[1..]);
            return (repeated.max(known - 1.0) - again, false);
        }
        // The request before the one that waits, again: another frame was taken for the one between.
        let late = pending.late.is_some_and(|late| late.unit == unit && late.pdu == pdu);
        let known = if late { model.bits_of(&pdu[1..]) - 1.0 } else { 0.0 };
        // No master gives up as soon as answers come; but among the bytes between may be the answer.
        let soon = if junk == 0 { (-pause).clamp(0.0, costs::TOO_SOON) } else { 0.0 };
        return (repeated.max(known) - unanswered - soon, false);
    }
    let matched = asked.map_or(Match::No, |asked| answers(context.functions, asked.asked(), unit, pdu));
    let Some(asked) = asked.filter(|_| matched != Match::No) else {
        let orphan = orphan - if begun && asked.is_none() { costs::BEGUN } else { 0.0 };
        return (again(model, context, pending, frame, pause).max(-orphan), false);
    };
    // Unit and function are known beforehand.
    let mut gain = model.unit(unit) + model.function(context.functions, pdu[0], RESPONSE) - costs::ANSWERED;
    if let Some(row) = context.functions.row(asked.pdu[0], &asked.pdu[1..]).filter(|_| pdu[0] & EXCEPTION_BIT == 0) {
        if row.response == Layout::Silent || asked.damaged {
            // It should not answer; if something comes, it is this all the same.
        } else if matched == Match::Partly {
            gain -= costs::BROKEN_RULE;
        } else if pending.last.as_ref().is_some_and(|(_, answer)| *answer == print(frame)) {
            gain += model.bits_of(&pdu[1..]);
        } else if expected_block(row, &asked.pdu).is_some() {
            gain += model.bits(pdu[1]);
        } else if asked.pdu == pdu {
            gain += model.bits_of(&pdu[1..]);
        } else if !row.echo.is_empty() {
            gain += model.bits_of(&pdu[1..pdu.len().min(5)]);
        }
    }
    if asked.pdu == pdu {
        gain -= pause.max(0.0) + if asked.copied { 0.0 } else { model.copied().1 };
    }
    (gain, true)
}

/// Bits of an answer that nobody waits for any more: the late one, or the last one once more.
fn again(model: &Model, context: &Context<'_>, pending: Open<'_>, frame: &[u8], pause: Pause) -> f32 {
    let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
    let fits = |request: &&Request| answers(context.functions, request.asked(), unit, pdu) == Match::Fully;
    let late = pending.late.filter(fits).map(|request| {
        let retry = if request.pdu == pdu { pause.max(0.0) } else { 0.0 };
        (request, model.late() + retry, false)
    });
    // An echo once more is rather the same request again.
    let last = pending.last.filter(|(request, answer)| *answer == print(frame) && request.pdu != pdu);
    let again = last.map(|(request, _)| request).filter(fits).map(|request| (request, costs::AGAIN, true));
    let bits = late.into_iter().chain(again).map(|(request, cost, same)| {
        let row = context.functions.row(request.pdu[0], &request.pdu[1..]).filter(|_| pdu[0] & EXCEPTION_BIT == 0);
        let body = row.map_or(0.0, |row| {
            if same {
                // Byte for byte: else the two would look like a request and its retry.
                model.bits_of(&pdu[1..])
            } else if expected_block(row, &request.pdu).is_some() {
                model.bits(pdu[1])
            } else if request.pdu == pdu {
                model.bits_of(&pdu[1..])
            } else if row.echo.is_empty() {
                0.0
            } else {
                model.bits_of(&pdu[1..pdu.len().min(5)])
            }
        });
        model.unit(unit) + model.function(context.functions, pdu[0], RESPONSE) + body - cost
    });
    bits.fold(f32::MIN, f32::max)
}

/// Bits that a frame with a wrong checksum saves, where its header announces just its length and is no stranger here.
pub fn damaged(model: &Model, context: &Context<'_>, asked: Option<&Request>, frame: &[u8], direction: usize) -> Option<f32> {
    let (unit, code, body) = (frame[0], frame[1], &frame[2..frame.len() - 2]);
    let row = context.functions.row(code, body)?;
    if direction == REQUEST {
        if !model.familiar(unit, code, REQUEST) || !consistent(row, body) {
            return None;
        }
        let header = model.bits(unit) - model.unit(unit) + model.bits(code) - model.function(context.functions, code, REQUEST);
        let waiting = if asked.is_some() { costs::UNANSWERED } else { 0.0 };
        return Some(header + layout(model, row, body, REQUEST) - costs::DAMAGED - waiting);
    }
    let asked = asked.filter(|asked| asked.unit == unit && asked.pdu.first() == Some(&code))?;
    let expected = expected_block(row, &asked.pdu);
    if expected.is_some_and(|expected| body.first().map(|&count| usize::from(count)) != Some(expected)) {
        return None;
    }
    let count = if expected.is_some() { model.bits(body[0]) } else { 0.0 };
    Some(model.bits(unit) + model.bits(code) + count - costs::ANSWERED - costs::DAMAGED)
}

/// What an unfinished frame may claim by its header.
pub struct Header {
    /// Bits.
    pub gain: f32,
    /// It claims as much until so many bytes of it are seen.
    pub until: u64,
}

/// The bytes of a frame that its header is judged by, one that begins like this.
pub fn most_of_a_header(context: &Context<'_>, frame: &[u8]) -> u64 {
    let &[_, code, ref body @ ..] = frame else { return 2 };
    let function = code & !EXCEPTION_BIT;
    let leading = context.functions.leading_bytes(function);
    let judged = context.functions.row(function, body).map_or(1, |row| row.judged.max(1));
    2 + leading.max(judged) as u64
}

/// What the header of an unfinished frame may claim, if the frame can still go on beyond `seen` bytes.
pub fn header(model: &Model, context: &Context<'_>, asked: Option<&Request>, seen: &[u8]) -> Option<Header> {
    if seen.len() < 2 {
        return Some(Header { gain: model.bits(seen[0]) - model.unit(seen[0]) + costs::OPEN_LENGTH, until: 2 });
    }
    let (unit, code, body) = (seen[0], seen[1], &seen[2..]);
    let row = context.functions.row(code & !EXCEPTION_BIT, body);
    let mut best: Option<f32> = None;
    let mut until = u64::MAX >> 1;
    for (way, extent) in announced(context, seen).into_iter().flatten() {
        let index = if way == Direction::Response { RESPONSE } else { REQUEST };
        let open = match extent {
            Extent::Exactly(length) | Extent::AtLeast(length) if length <= seen.len() => continue,
            Extent::Exactly(length) | Extent::AtLeast(length) => {
                until = until.min(length as u64);
                0.0
            }
            Extent::Open(_) if !model.familiar(unit, code, index) => continue,
            Extent::Open(_) => costs::OPEN_LENGTH,
        };
        let gain = claim(model, context, row, seen, index) - open
            + if index == RESPONSE { due(model, context, row, asked, seen) } else { 0.0 };
        best = Some(best.map_or(gain, |best| best.max(gain)));
    }
    if (seen.len() as u64) < most_of_a_header(context, seen) {
        until = seen.len() as u64 + 1;
    }
    best.map(|gain| Header { gain, until })
}

/// What unit, function and limits are worth in a direction.
fn claim(model: &Model, context: &Context<'_>, row: Option<&FunctionRow>, seen: &[u8], direction: usize) -> f32 {
    let (unit, code, body) = (seen[0], seen[1], &seen[2..]);
    let mut gain = model.bits(unit) - model.unit(unit) + model.bits(code) - model.function(context.functions, code, direction);
    if let Some(row) = row {
        gain += row.permits[direction].iter().map(|permit| permitted(model, permit, body)).sum::<f32>();
        if direction == REQUEST && row.roles.request_block.is_some_and(|(at, _)| body.len() >= at) {
            gain += costs::OPEN_LENGTH;
        }
    }
    gain
}

/// What the request that waits makes of the header of a response.
fn due(model: &Model, context: &Context<'_>, row: Option<&FunctionRow>, asked: Option<&Request>, seen: &[u8]) -> f32 {
    let (unit, code, body) = (seen[0], seen[1], &seen[2..]);
    let Some(asked) = asked.filter(|asked| asked.is_of(unit, code & !EXCEPTION_BIT)) else { return -costs::ORPHAN };
    let expected = row.and_then(|row| expected_block(row, &asked.pdu));
    let agrees = expected.is_none_or(|expected| body.first().is_none_or(|&count| usize::from(count) == expected));
    let known = model.unit(unit) + model.function(context.functions, code, RESPONSE);
    known + if agrees { body.first().map_or(0.0, |&count| model.bits(count)) } else { -costs::BROKEN_RULE }
}
