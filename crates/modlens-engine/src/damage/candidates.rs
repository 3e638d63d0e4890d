//! Candidates for damaged frames: alignments with expected frames, and unpredicted frames that only their header supports.

use std::ops::Range;

use crate::damage::alignment::{align, Alignment, DAMAGE_COSTS};
use crate::damage::expected_frame::{poll_request, ExpectedFrame};
use crate::damage::region::UnframedRegion;
use crate::rtu_model::announced_length::{ENVELOPE_BYTES, EXCEPTION_RESPONSE_BYTES};
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::prefilter::Need;
use crate::rtu_model::prefix_index::{FrameSet, MAX_LOST_BYTES};
use crate::rtu_model::score;
use crate::rtu_model::side::{self, REQUEST, RESPONSE};
use crate::weights::{self, FRAME_END_BITS, MAX_STRAY_BITS, MIN_DAMAGED_FRAME_BITS, POLL_REQUEST_BITS, ROUNDING_BITS};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::{Extent, FunctionRow, EXCEPTION_BIT};

/// A damaged frame that a region may hold. Indices count from the first byte of the region.
#[derive(Debug, Default)]
pub(crate) struct Candidate {
    /// Index of its first byte.
    pub(crate) start: usize,
    /// Index after the bytes that agree with it: the next candidate of a chain may begin here.
    pub(crate) core_end: usize,
    /// Index where it should end, if its length is known.
    pub(crate) end: Option<usize>,
    /// Bits in favour of it.
    pub(crate) score: f32,
    /// `REQUEST` or `RESPONSE`.
    pub(crate) direction: usize,
    /// Unit and function code.
    pub(crate) header: [u8; 2],
    /// Cost in bits of its unit and function; 0 where a request in front predicts them.
    pub(crate) header_cost: f32,
    /// Its missing first bytes.
    pub(crate) head: Vec<u8>,
    /// What happened to it.
    pub(crate) damage: Option<DamageKind>,
    /// Its CRC is valid once the damage is corrected.
    pub(crate) is_corrected: bool,
    /// All bytes with a known value agree, but the CRC does not.
    pub(crate) is_exact: bool,
    /// Number of leading bytes that agree, where the expected value of every byte is known.
    pub(crate) agreeing_bytes: Option<usize>,
}

impl UnframedRegion<'_, '_> {
    /// Adds the expected frames that may begin at `start`.
    pub(crate) fn add_expected(&self, expected: &[ExpectedFrame<'_>], start: usize, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        for frame in expected.iter().filter(|frame| frame.may_begin_with(bytes)) {
            candidates.extend(self.aligned_candidate(frame, start));
        }
    }

    /// Adds the requests of the poll cycle that may begin at `start`, and frames with a header that this line has shown. At the
    /// beginning of a recording nothing is known yet, so that any header is tried there.
    ///
    /// `new_function_cost` is what the model says a function costs that was never seen.
    pub(crate) fn add_familiar(&self, start: usize, new_function_cost: f32, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        let polls = &self.model.poll_cycle;
        let mut likely = if polls.is_empty() { 0 } else { polls.possible_frames(bytes) };
        if likely != 0 {
            let more = MIN_DAMAGED_FRAME_BITS + self.start_cost(start) + POLL_REQUEST_BITS;
            let of_these =
                if self.input.has_times { FrameSet::MAX } else { polls.with_length_in(self.lengths_that_end_well(start)) };
            let need = Need { less: more - FRAME_END_BITS, of_these, more };
            likely = polls.likely(likely, bytes, |byte| self.model.bits(byte), need, &DAMAGE_COSTS);
        }
        for request in polls.get_all(likely) {
            candidates.extend(self.aligned_candidate(&poll_request(request), start));
        }
        let may_have_unit = self.context.known_units[usize::from(bytes[0])] || self.input.offset() == 0;
        if may_have_unit && self.may_have_function(start, new_function_cost) {
            for direction in [REQUEST, RESPONSE] {
                candidates.extend(self.unpredicted_candidate(start, direction));
            }
        }
    }

    /// The expected frame as a candidate that begins at `start`, if it can change the result.
    pub(crate) fn aligned_candidate(&self, expected: &ExpectedFrame<'_>, start: usize) -> Option<Candidate> {
        let start_cost = self.start_cost(start);
        let min_score = min_score(expected.direction, 0.0);
        let may_end_well =
            expected.length.is_some_and(|length| self.input.has_times || self.lengths_that_end_well(start).contains(&length));
        let end_bonus = if may_end_well { FRAME_END_BITS } else { 0.0 };
        self.candidate_worth(expected, start, min_score + start_cost - end_bonus - ROUNDING_BITS)
    }

    /// The same, but for what has less than `need` bits by its alignment alone.
    pub(crate) fn candidate_worth(&self, expected: &ExpectedFrame<'_>, start: usize, need: f32) -> Option<Candidate> {
        let (start_cost, min_score) = (self.start_cost(start), min_score(expected.direction, 0.0));
        let alignment = align(self.model, expected, &self.bytes()[start..], need)?;
        let end = alignment.length.map(|length| start + length);
        let score = alignment.score - start_cost - contradiction_cost(self, start, expected.direction) + self.end_bonus(end);
        (score > 0.0 && score >= min_score).then(|| Candidate::new(expected, &alignment, start, end, score))
    }

    /// A frame at index `start` of the region that no context predicts, if its unit and function are likely on this line and
    /// it would end well. `direction` is `REQUEST` or `RESPONSE`. The CRC is not looked at.
    ///
    /// `None` with fewer than two bytes, where the header is none (`may_be_header`), and if the score is not above 0 or is
    /// below `min_score`. `end` is `None` if the layout does not determine the length, or announces more than a frame may have.
    ///
    /// Example: with unit 17 and function 3 familiar, `11 03 04 00 07 00 09 12 34` scores for the two header bytes and,
    /// if a pause follows byte 9, for ending where the byte count says; no CRC is needed.
    pub(crate) fn unpredicted_candidate(&self, start: usize, direction: usize) -> Option<Candidate> {
        let &[unit, code, ref body @ ..] = &self.bytes()[start..] else { return None };
        if !self.may_be_header(code, direction) {
            return None;
        }
        let header_cost = self.model.unit_cost(unit) + self.model.function_cost(self.context.functions, code, direction);
        let cost = header_cost + self.start_cost(start) + contradiction_cost(self, start, direction);
        let header_score = self.model.bits(unit) + self.model.bits(code) - cost;
        let (fields_score, length) = self.body_score(header_score, code, direction, body);
        let end = length.filter(|&length| length <= MAX_RTU_FRAME_BYTES).map(|length| start + length);
        let score = fields_score + self.end_bonus(end);
        // Unit, function code and one byte of the body: nothing else could begin inside these.
        let core_end = (start + 3).min(self.length);
        let header = [unit, code];
        // No byte was predicted, so none disagrees: `chain` may look for stray bytes and a doubled byte.
        let is_exact = true;
        (score > 0.0 && score >= min_score(direction, header_cost)).then(|| Candidate {
            start,
            core_end,
            end,
            score,
            direction,
            header,
            header_cost,
            is_exact,
            ..Candidate::default()
        })
    }

    /// Whether the function of a frame at `start` that no context predicts is likely enough, whatever else it holds. Nearly all
    /// bytes are function codes that are neither in the table nor were ever seen.
    fn may_have_function(&self, start: usize, new_function_cost: f32) -> bool {
        let &[unit, code, ref body @ ..] = &self.bytes()[start..] else { return false };
        if self.model.has_function(code) || self.context.functions.row(code & !EXCEPTION_BIT, body).is_some() {
            return true;
        }
        self.model.bits(unit) + self.model.bits(code) - self.start_cost(start) + ROUNDING_BITS > new_function_cost
    }

    /// Whether a frame of this direction may have this function code here: not function 0, no exception code in a request,
    /// and not the direction that only the other line carries.
    fn may_be_header(&self, code: u8, direction: usize) -> bool {
        let function = code & !EXCEPTION_BIT;
        let is_other_side = self.context.line_direction.is_some_and(|sender| sender != side::direction_of(direction));
        function != 0 && !is_other_side && (code == function || direction == RESPONSE)
    }

    /// `score` in bits with what the body after a header adds, and the length of the frame in bytes, if the layout of its
    /// function determines it.
    ///
    /// A response costs what an unsolicited one does, since no request in front predicts it, but not where the other line has
    /// its request. An exception response costs extra. Fields within the limits of the specification count for a normal frame,
    /// others against it.
    fn body_score(&self, score: f32, code: u8, direction: usize, body: &[u8]) -> (f32, Option<usize>) {
        let is_unsolicited = direction == RESPONSE && !self.is_framed_independently();
        let score = if is_unsolicited { score - weights::UNSOLICITED_BITS } else { score };
        if code & EXCEPTION_BIT != 0 {
            return (score - weights::EXCEPTION_BITS, Some(EXCEPTION_RESPONSE_BYTES));
        }
        let Some(row) = self.context.functions.row(code, body) else { return (score, None) };
        let limits = row.field_limits[direction].iter();
        let fields = limits.map(|limits| score::field_score(self.model, limits, body)).sum::<f32>();
        (score + fields, frame_bytes(row, direction, body))
    }

    /// Cost in bits of a frame that begins at `start`: stray bytes in front of it cost, a pause in front of it pays.
    pub(crate) fn start_cost(&self, start: usize) -> f32 {
        if start == 0 {
            // On a line that one side has to itself, the pause at the beginning of the region separates two of its frames.
            let follows_pause = self.context.line_direction.is_some() && self.has_frame_gap(0);
            return if follows_pause { -weights::PAUSE_BEFORE_BITS } else { 0.0 };
        }
        let strays = (weights::STRAY_BYTE_BITS * start as f32).min(MAX_STRAY_BITS);
        let follows_pause = self.input.pause_before(start).is_some_and(|pause| pause >= self.frame_gap_ns);
        if follows_pause {
            strays - weights::PAUSE_BEFORE_BITS
        } else {
            strays
        }
    }

    /// The lengths of expected frames that begin at `start` and, however damaged, may end with the region without a pause there:
    /// up to `MAX_LOST_BYTES` are missing, or one is there twice.
    fn lengths_that_end_well(&self, start: usize) -> Range<usize> {
        let left = self.length - start;
        if self.ends_as_announced {
            0..0
        } else {
            left - 1..left + MAX_LOST_BYTES + 1
        }
    }

    /// Bits for a frame that should end at this index, where a pause or the end of the region really is.
    pub(crate) fn end_bonus(&self, end: Option<usize>) -> f32 {
        let ends_well = end.is_some_and(|end| {
            (end == self.length && !self.ends_as_announced)
                || (end <= self.length && self.input.pause_before(end).is_some_and(|pause| pause >= self.frame_gap_ns))
        });
        if ends_well {
            FRAME_END_BITS
        } else {
            0.0
        }
    }
}

/// Cost in bits of a frame at `start` that is not of the direction which the recording declares, or is a request in the place and at
/// the time of a response; what a line of one direction may carry is for `may_be_header`.
fn contradiction_cost(region: &UnframedRegion<'_, '_>, start: usize, direction: usize) -> f32 {
    let context = region.context;
    let too_soon = if direction == REQUEST && start == 0 { request_too_soon_cost(region) } else { 0.0 };
    too_soon
        + match context.declared_direction_at(region.input, start).filter(|_| context.line_direction.is_none()) {
            Some(declared) if declared != side::direction_of(direction) => weights::WRONG_LINE_BITS,
            _ => 0.0,
        }
}

/// Cost in bits of a request that begins the region, for coming as soon after the outstanding one as responses do, where another
/// request follows. 0 without a clock, and where the line carries one direction only.
fn request_too_soon_cost(region: &UnframedRegion<'_, '_>) -> f32 {
    let is_between_requests = region.next_frame.is_some_and(|(_, direction)| direction == Direction::Request);
    if !is_between_requests || region.context.outstanding_request.is_none() || region.context.line_direction.is_some() {
        return 0.0;
    }
    let most = weights::TOO_SOON_BITS + weights::UNANSWERED_BITS;
    (-(region.context.timeout_log_odds)(region.input.pause_before(0))).clamp(0.0, most)
}

/// The lowest score in bits at which a candidate can change the result.
///
/// A response may still gain what its header costs, and what a response without request costs, if a chain puts its
/// damaged request in front of it; so less is enough for it here.
fn min_score(direction: usize, header_cost: f32) -> f32 {
    if direction == RESPONSE {
        MIN_DAMAGED_FRAME_BITS - header_cost - weights::UNSOLICITED_BITS - ROUNDING_BITS
    } else {
        MIN_DAMAGED_FRAME_BITS
    }
}

/// Length of the frame with this body, if the layout of its function determines it.
fn frame_bytes(row: &FunctionRow, direction: usize, body: &[u8]) -> Option<usize> {
    let layout = if direction == REQUEST { &row.request } else { &row.response };
    match layout.extent(body) {
        Extent::Exactly(length) => Some(length + ENVELOPE_BYTES),
        _ => None,
    }
}

impl Candidate {
    fn new(expected: &ExpectedFrame<'_>, alignment: &Alignment, start: usize, end: Option<usize>, score: f32) -> Self {
        // Known byte for byte: nothing is missing in front, and the known bytes are the whole frame.
        let is_known = |&length: &usize| alignment.missing_head_bytes == 0 && length == expected.bytes.len();
        Self {
            start,
            core_end: start + alignment.core_bytes,
            end,
            score,
            direction: expected.direction,
            header: [expected.bytes[0], expected.bytes[1]],
            header_cost: 0.0,
            head: expected.bytes[..alignment.missing_head_bytes].to_vec(),
            damage: alignment.damage,
            is_corrected: alignment.is_corrected,
            is_exact: alignment.is_exact,
            agreeing_bytes: alignment.length.filter(is_known).map(|_| alignment.agreeing_bytes),
        }
    }
}
