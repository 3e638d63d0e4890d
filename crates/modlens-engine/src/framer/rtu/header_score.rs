//! What the header of an unfinished frame may turn out to be worth: an upper bound for every place where a frame may have
//! begun, so that the search knows which of them to await.

use crate::framer::FramerContext;
use crate::rtu_model::announced_length::announced_lengths;
use crate::rtu_model::answerable::AnswerableRequest;
use crate::rtu_model::log2::log2;
use crate::rtu_model::score::field_score;
use crate::rtu_model::score_bounds::{CachedBound, OBSERVATION_HEADROOM};
use crate::rtu_model::side::{index_of, REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights::{self, usual_bits, OPEN_LENGTH_BITS, UNSOLICITED_BITS};
use modlens_protocol::direction::expected_data_bytes;
use modlens_protocol::functions::{Extent, FieldLimits, FunctionRow, Functions, EXCEPTION_BIT};

/// The most that the header of an unfinished frame may turn out to be worth.
pub struct HeaderBound {
    /// Upper bound of the score, in bits, without the CRC, which has not come yet.
    pub bits: f32,
    /// The bound does not change before this many bytes of the frame are seen.
    pub until_bytes: u64,
}

/// How many bytes of a frame that begins like this its header is judged by: unit, function code, and the bytes of the body with
/// limited fields or a length. Once these are seen, `header_bound` stays as it is while the outstanding request does.
pub fn judged_header_bytes(context: &FramerContext<'_>, frame: &[u8]) -> u64 {
    let &[_, code, ref body @ ..] = frame else { return 2 };
    let function = code & !EXCEPTION_BIT;
    let leading = context.functions.leading_bytes(function);
    let judged = context.functions.row(function, body).map_or(1, |row| row.checked_bytes.max(1));
    2 + leading.max(judged) as u64
}

/// An upper bound of the score in bits of an unfinished frame by its header, in the better direction; `None` if no frame can go
/// on beyond the bytes `seen`, of which there is at least one. `outstanding` is the request that it may answer.
///
/// A direction counts only if the frame may go on in it: if the length that it announces, or the least one, is more than the bytes
/// seen; or if its length is open, on a line where unit and function are familiar, at a cost of `OPEN_LENGTH_BITS`. The bound holds
/// until as many bytes are seen as the shorter of these lengths has, but no longer than until the next byte while the header is not complete
/// (`judged_header_bytes`). While only the unit has come, it is the unit's score and `OPEN_LENGTH_BITS` for what may follow.
pub fn header_bound(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    outstanding: Option<&AnswerableRequest>,
    seen: &[u8],
) -> Option<HeaderBound> {
    if seen.len() < 2 {
        let bits = model.bits(seen[0]) - model.unit_cost(seen[0]) + weights::OPEN_LENGTH_BITS;
        return Some(HeaderBound { bits, until_bytes: 2 });
    }
    let directions = announced_lengths(context, seen).into_iter().flatten();
    let bounds = directions.filter_map(|(direction, extent)| {
        let direction = index_of(direction);
        let until_bytes = longer_until(extent, seen.len(), || model.is_familiar(seen[0], seen[1], direction))?;
        Some(HeaderBound { bits: bits_so_far(model, context, outstanding, seen, direction, extent), until_bytes })
    });
    let bound = bounds.reduce(|a, b| HeaderBound { bits: a.bits.max(b.bits), until_bytes: a.until_bytes.min(b.until_bytes) })?;
    let is_header_complete = seen.len() as u64 >= judged_header_bytes(context, seen);
    let until_bytes = if is_header_complete { bound.until_bytes } else { seen.len() as u64 + 1 };
    Some(HeaderBound { until_bytes, ..bound })
}

/// How many bytes of a frame of this announced length may be seen before it is over, given that `seen` are; `None` if it has no
/// more bytes than these. An open length counts only if unit and function are familiar, and has no end: then it is a number to
/// which a stream offset can still be added.
fn longer_until(extent: Extent, seen: usize, is_familiar: impl Fn() -> bool) -> Option<u64> {
    match extent {
        Extent::Exactly(length) | Extent::AtLeast(length) => (length > seen).then_some(length as u64),
        Extent::Open(_) => is_familiar().then_some(u64::MAX >> 1),
    }
}

/// What the header is worth in this direction, with what the outstanding request adds to a response, less the cost of an open
/// length, in bits. At least two bytes are seen.
fn bits_so_far(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    outstanding: Option<&AnswerableRequest>,
    seen: &[u8],
    direction: usize,
    extent: Extent,
) -> f32 {
    let row = context.functions.row(seen[1] & !EXCEPTION_BIT, &seen[2..]);
    let length_cost = if matches!(extent, Extent::Open(_)) { weights::OPEN_LENGTH_BITS } else { 0.0 };
    let due = if direction == RESPONSE { due_header_score(model, context, row, outstanding, seen) } else { 0.0 };
    header_score(model, context, row, seen, direction) - length_cost + due
}

/// Score in bits of unit, function code and limited fields of a header, in one direction.
fn header_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    row: Option<&FunctionRow>,
    seen: &[u8],
    direction: usize,
) -> f32 {
    let (unit, code, body) = (seen[0], seen[1], &seen[2..]);
    let mut score =
        model.bits(unit) - model.unit_cost(unit) + model.bits(code) - model.function_cost(context.functions, code, direction);
    if let Some(row) = row {
        score += row.field_limits[direction].iter().map(|permit| field_score(model, permit, body)).sum::<f32>();
        if direction == REQUEST && row.offsets.request_block.is_some_and(|(at, _)| body.len() >= at) {
            score += weights::OPEN_LENGTH_BITS;
        }
    }
    score
}

/// Score in bits that the outstanding request adds to the header of a response: the cost of an unsolicited one where it does not
/// answer it or none is outstanding; else what unit and function cost, as they are predicted, and the byte count if it agrees.
fn due_header_score(
    model: &TrafficModel,
    context: &FramerContext<'_>,
    row: Option<&FunctionRow>,
    outstanding: Option<&AnswerableRequest>,
    seen: &[u8],
) -> f32 {
    let (unit, code, body) = (seen[0], seen[1], &seen[2..]);
    let answered = outstanding.filter(|request| request.matches(unit, code & !EXCEPTION_BIT));
    let Some(request) = answered else { return -weights::UNSOLICITED_BITS };
    let expected = row.and_then(|row| expected_data_bytes(row, &request.pdu));
    let agrees = expected.is_none_or(|expected| body.first().is_none_or(|&count| usize::from(count) == expected));
    let known = model.unit_cost(unit) + model.function_cost(context.functions, code, RESPONSE);
    known + if agrees { body.first().map_or(0.0, |&count| model.bits(count)) } else { -weights::BROKEN_RULE_BITS }
}

impl TrafficModel {
    /// An upper bound of the score, in bits, of any header with this unit and function code that responds to no request, whatever
    /// its fields hold. It is the sum of a bound of the unit and one of the function code. Both come from `score_bounds`, and are
    /// computed again, for somewhat more frames, again frames were seen than they hold for.
    pub fn max_header_score(&mut self, functions: &Functions, unit: u8, code: u8) -> f32 {
        self.cached_unit_bound(unit) + self.cached_code_bound(functions, code)
    }

    /// The bound of a unit: what its byte is worth less its cost, if it had been seen as often as the bound holds for.
    #[inline]
    fn cached_unit_bound(&mut self, unit: u8) -> f32 {
        let count = self.unit_count(unit);
        let bound = &self.score_bounds.units[usize::from(unit)];
        if count <= bound.observations[0] {
            return bound.bits;
        }
        let count = OBSERVATION_HEADROOM * count;
        let bits = usual_bits(unit) - self.unit_cost_if_seen(unit, count);
        self.score_bounds.units[usize::from(unit)] = CachedBound { bits, observations: [count; 2] };
        bits
    }

    /// The bound of a function code and the fields after it (`max_code_score`).
    #[inline]
    fn cached_code_bound(&mut self, functions: &Functions, code: u8) -> f32 {
        let counts = [REQUEST, RESPONSE].map(|direction| self.function_count(code, direction));
        let bound = &self.score_bounds.codes[usize::from(code)];
        if counts[0] <= bound.observations[0] && counts[1] <= bound.observations[1] {
            return bound.bits;
        }
        let observations = counts.map(|count| OBSERVATION_HEADROOM * count);
        let bits = self.max_code_score(functions, code, observations);
        self.score_bounds.codes[usize::from(code)] = CachedBound { bits, observations };
        bits
    }

    /// An upper bound of what a function code and the fields after it are worth, in bits, in the better direction, if the
    /// function had been seen this often as a request and as a response. `code` may have the exception bit. Function 0 gives
    /// `f32::MIN`: no frame has it.
    fn max_code_score(&self, functions: &Functions, code: u8, observations: [f32; 2]) -> f32 {
        let function = code & !EXCEPTION_BIT;
        if function == 0 {
            return f32::MIN;
        }
        let [mut request, mut response] = max_layout_scores(functions, function);
        if code != function {
            (request, response) = (f32::MIN, response.max(0.0));
        }
        let cost = |direction: usize| self.function_cost_if_seen(functions, code, direction, observations[direction]);
        usual_bits(code) + (request - cost(REQUEST)).max(response - cost(RESPONSE) - UNSOLICITED_BITS)
    }
}

/// The most that the fields after a function code without exception bit are worth in bits, as a request and as a response, in
/// whichever of its layouts. A function without a row is a request of any length and no response.
fn max_layout_scores(functions: &Functions, function: u8) -> [f32; 2] {
    let fields = |permits: &[FieldLimits]| permits.iter().map(max_field_score).sum::<f32>();
    let mut request = -OPEN_LENGTH_BITS;
    let mut response = f32::MIN;
    for row in functions.variants(function) {
        let byte_count = if row.offsets.request_block.is_some() { OPEN_LENGTH_BITS } else { 0.0 };
        request = request.max(fields(&row.field_limits[REQUEST]) + byte_count);
        response = response.max(fields(&row.field_limits[RESPONSE]));
    }
    [request, response]
}

/// The most that a field with limited values is worth, in bits, whichever permitted value it has.
fn max_field_score(permit: &FieldLimits) -> f32 {
    let choices: u64 = permit.ranges.iter().map(|(low, high)| u64::from(high - low) + 1).sum();
    let usual = |low: u32, high: u32| {
        let places = (0..permit.width as u32).map(|place| 8 * place);
        // A byte has the same value all over a range where none of its bits and none above them differ. Elsewhere it may
        // have any value; 1 is one of those that are worth most.
        places.map(|place| usual_bits(if (low ^ high) >> place == 0 { (high >> place) as u8 } else { 1 })).sum::<f32>()
    };
    let most = permit.ranges.iter().map(|&(low, high)| usual(low, high)).fold(0.0, f32::max);
    (most - log2(choices as f32)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framer::FramerContext;
    use crate::rtu_model::traffic_model::{FramePosition, RequestCopy};
    use proptest::prelude::*;

    #[test]
    fn no_field_is_worth_more_than_its_bound() {
        let model = TrafficModel::default();
        let permits = Functions::embedded().rows().flat_map(|row| row.field_limits.iter().flatten());
        let mut tried = 0;
        for permit in permits {
            for value in 0..=u16::MAX {
                let bytes = u32::from(value).to_be_bytes();
                let body = [&vec![0; permit.offset][..], &bytes[4 - permit.width..]].concat();
                assert!(field_score(&model, permit, &body) <= max_field_score(permit) + 0.01, "{permit:?} {value}");
                tried += 1;
            }
        }
        assert!(tried > 1_000_000);
    }

    proptest! {
        #[test]
        fn no_header_scores_more_than_its_bound(
            parts in proptest::collection::vec((0u8..4, 0u8..20, 0usize..2, proptest::collection::vec(0u8..4, 4..12)), 1..200),
        ) {
            let mut model = TrafficModel::default();
            let units = [false; 256];
            let context = FramerContext::without_clock(Functions::embedded(), &units);
            for (unit, code, direction, body) in parts {
                let seen = [&[unit, if code > 16 { code | EXCEPTION_BIT } else { code }][..], &body].concat();
                let bound = model.max_header_score(context.functions, seen[0], seen[1]);
                if let Some(header) = header_bound(&model, &context, None, &seen) {
                    prop_assert!(header.bits <= bound + 0.01, "{seen:02x?}: {} above {bound}", header.bits);
                }
                model.learn(&seen, direction, FramePosition { request_outstanding: false, unframed_bytes: 0 }, RequestCopy::Unclear);
                model.learn_noise(&body);
                model.update_costs();
            }
        }
    }
}
