//! Adds frame hypotheses to the lattice: substrings with a valid CRC, and damaged frames of the announced length, each
//! after every path that ends before it.

use std::ops::Range;

use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::placement::{Placement, ValidSubstring};
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::announced_lengths;
use crate::rtu_model::answerable::Answerable;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_SPAN;
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::score;
use crate::rtu_model::side::{self, REQUEST, RESPONSE};
use crate::weights;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// Frames with a valid CRC.
impl Search {
    /// Adds the hypotheses of a substring with a valid CRC from stream offset `start` (included) to `scanned_to` (excluded): as a
    /// request and as a response, in each direction one for each kind of place (`best_placements`). It begins at the root's end
    /// or after, and may be a frame. `floor` is the path score in bits at or below which nothing is added.
    pub(super) fn add_valid_hypotheses(&mut self, input: &Input, context: &FramerContext<'_>, start: u64, floor: f32) {
        let (start_index, end_index) = ((start - input.offset()) as usize, (self.scanned_to - input.offset()) as usize);
        let frame = &input.bytes()[start_index..end_index];
        let root_end = self.committed_offset();
        let is_in_plain_noise = self.is_in_plain_noise(input, context) && !self.model.has_unit(frame[0]);
        let hypotheses_before = self.lattice.len();
        let substring = self.valid_substring(input, context, start, FrameBytes(frame));
        let mut next_damaged_end_at = None;
        let scores = score::frame_scores(&self.model, context, substring.frame.0);
        for (direction, score) in [REQUEST, RESPONSE].into_iter().zip(scores) {
            let Some(score) = score else { continue };
            let contradiction = contradiction_cost(context, substring.declared, direction);
            let own_score = score + substring.timing_score - contradiction;
            let placements = self.best_placements(input, context, &substring, direction, own_score, floor);
            #[cfg(test)]
            assert_eq!(placements, self.best_of_all_placements(input, context, &substring, direction, own_score, floor));
            for placement in placements.into_iter().flatten() {
                let next_damaged_end_at =
                    *next_damaged_end_at.get_or_insert_with(|| first_damaged_end(input, context, self.scanned_to));
                self.add_valid_hypothesis(&substring, direction, placement, next_damaged_end_at);
            }
        }
        if is_in_plain_noise && self.lattice.len() == hypotheses_before {
            self.rejected.insert(frame, root_end, self.model.unframed_cost(start - root_end), floor);
        }
    }

    /// Whether there is no hypothesis but the root, and neither times, reads nor the line add anything to the score of a
    /// substring: then `RejectedSubstrings` may know it, if its unit is not known.
    pub(super) fn is_in_plain_noise(&self, input: &Input, context: &FramerContext<'_>) -> bool {
        let is_plain_line = context.line_direction.is_none() && context.connection_side.is_none();
        self.lattice.len() == 1 && is_plain_line && input.is_one_untimed_read()
    }

    /// The substring from stream offset `start` (included) to `scanned_to` (excluded), whose CRC is valid and whose bytes are
    /// `frame`, with what is known of it.
    fn valid_substring<'a>(
        &self,
        input: &'a Input,
        context: &FramerContext<'_>,
        start: u64,
        frame: FrameBytes<'a>,
    ) -> ValidSubstring<'a> {
        let start_index = (start - input.offset()) as usize;
        let end_index = start_index + frame.0.len();
        let contents = self.contents(context, frame.0);
        ValidSubstring {
            start,
            start_index,
            frame,
            pause: context.pause_evidence_at(input, start_index),
            timing_score: timing_score(input, start_index..end_index, self.frame_gap_ns),
            declared: context.declared_direction_at(input, start_index),
            contents,
            nested_scores: if contents.is_some() { self.nested_scores(start) } else { Vec::new() },
        }
    }

    /// Adds this substring as a frame of this direction in this place. `next_damaged_end_at` is where a damaged one may end after
    /// it.
    fn add_valid_hypothesis(
        &mut self,
        substring: &ValidSubstring<'_>,
        direction: usize,
        placement: Placement,
        next_damaged_end_at: u64,
    ) {
        let Placement { parent, path_score, frame_score, answers_outstanding } = placement;
        self.reserve_request();
        let before = self.lattice[parent].answerable;
        let answerable = self.requests.after(before, substring.frame.0, direction, answers_outstanding, true);
        self.push(Hypothesis {
            direction,
            path_score,
            frame_score,
            parent,
            answers_outstanding,
            answerable,
            ..self.new_hypothesis(substring.start, next_damaged_end_at)
        });
    }

    /// A frame with a valid CRC from stream offset `start` (included) to `scanned_to` (excluded), of which nothing else is known
    /// yet but where a damaged one may end after it.
    fn new_hypothesis(&self, start: u64, next_damaged_end_at: u64) -> Hypothesis {
        Hypothesis {
            start,
            end: self.scanned_to,
            direction: REQUEST,
            path_score: 0.0,
            frame_score: 0.0,
            parent: ROOT,
            first_on_path: ROOT,
            next_damaged_end_at,
            answers_outstanding: false,
            is_crc_valid: true,
            answerable: Answerable::default(),
        }
    }

    /// Adds a hypothesis, whose parent is in the lattice already. `first_on_path` is set here.
    fn push(&mut self, hypothesis: Hypothesis) {
        let parent = hypothesis.parent;
        let first_on_path = if parent == ROOT { self.lattice.len() } else { self.lattice[parent].first_on_path };
        self.skip.next_damaged_end_at = self.skip.next_damaged_end_at.min(hypothesis.next_damaged_end_at);
        self.lattice.push(Hypothesis { first_on_path, ..hypothesis });
    }
}

/// Frames with an invalid CRC. Each begins right after another frame and has exactly the length that it announces.
impl Search {
    /// Adds the damaged frames that end with the last byte scanned, after every hypothesis after which one may end there
    /// (`next_damaged_end_at`), and notes for each where one may end next. `ends_valid_frame`: a substring with a valid CRC
    /// ends there; then none is added.
    pub(super) fn add_damaged_hypotheses(&mut self, input: &Input, context: &FramerContext<'_>, ends_valid_frame: bool) {
        self.skip.next_damaged_end_at = u64::MAX;
        for parent in 0..self.lattice.len() {
            if self.lattice[parent].next_damaged_end_at <= self.scanned_to {
                let next = self.add_damaged_hypotheses_behind(input, context, parent, ends_valid_frame);
                self.lattice[parent].next_damaged_end_at = next;
            }
            self.skip.next_damaged_end_at = self.skip.next_damaged_end_at.min(self.lattice[parent].next_damaged_end_at);
        }
    }

    /// Adds the damaged frames from the end of the hypothesis `parent` to the last byte scanned, one for each direction that
    /// announces exactly this length; returns the stream offset at which one may end next, `u64::MAX` if none can.
    ///
    /// None is added for an exception response, nor where `ends_valid_frame` or `crosses_known_pause` says so.
    fn add_damaged_hypotheses_behind(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        parent: usize,
        ends_valid_frame: bool,
    ) -> u64 {
        let start = self.lattice[parent].end;
        let length = self.scanned_to - start;
        if start < input.offset() || length > MAX_CANDIDATE_SPAN {
            return u64::MAX;
        }
        if length < weights::MIN_DAMAGED_FRAME_BYTES {
            return start + weights::MIN_DAMAGED_FRAME_BYTES;
        }
        let range = (start - input.offset()) as usize..(self.scanned_to - input.offset()) as usize;
        let frame = &input.bytes()[range.clone()];
        let mut next_length: Option<u64> = None;
        for (direction, extent) in announced_lengths(context, frame).into_iter().flatten() {
            if is_announced(extent, frame) && !ends_valid_frame && !crosses_known_pause(input, range.clone(), self.frame_gap_ns) {
                self.add_damaged_hypothesis(input, context, parent, frame, side::index_of(direction));
            }
            let next = next_possible_length(extent, frame.len()).map(|length| length as u64);
            next_length = next.into_iter().chain(next_length).min();
        }
        next_length.map_or(u64::MAX, |length| start + length)
    }

    /// Adds a hypothesis: `frame`, which has an invalid CRC and goes from the end of the hypothesis `parent` (its index) to the
    /// last byte scanned. None is added if no such frame is expected there (`damaged_frame_score`). A response always answers
    /// the outstanding request, as no other response is expected.
    fn add_damaged_hypothesis(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        parent: usize,
        frame: &[u8],
        direction: usize,
    ) {
        let before = &self.lattice[parent];
        let outstanding = before.answerable.outstanding.map(|id| self.requests.get(id));
        let score = score::damaged_frame_score(&self.model, context, outstanding, frame, direction);
        let Some(frame_score) = score else { return };
        let (start, path_score, answerable) = (before.end, before.path_score + frame_score, before.answerable);
        let answers_outstanding = direction == RESPONSE;
        self.reserve_request();
        let answerable = self.requests.after(answerable, frame, direction, answers_outstanding, false);
        self.push(Hypothesis {
            direction,
            path_score,
            frame_score,
            parent,
            answers_outstanding,
            is_crc_valid: false,
            answerable,
            ..self.new_hypothesis(start, first_damaged_end(input, context, self.scanned_to))
        });
    }
}

/// The stream offset at which a damaged frame may end first that begins at `start`; `u64::MAX` if none can. Where its first bytes
/// have not come yet, they have to be looked at when they have.
pub(super) fn first_damaged_end(input: &Input, context: &FramerContext<'_>, start: u64) -> u64 {
    const SHORTEST: usize = weights::MIN_DAMAGED_FRAME_BYTES as usize;
    let at = start.checked_sub(input.offset()).map_or(usize::MAX, |at| at as usize);
    let shortest = input.bytes().get(at..).and_then(|bytes| bytes.first_chunk::<SHORTEST>());
    let Some(shortest) = shortest else { return start + weights::MIN_DAMAGED_FRAME_BYTES };
    let lengths = announced_lengths(context, shortest).into_iter().flatten().map(|(_, extent)| match extent {
        _ if is_announced(extent, shortest) => Some(SHORTEST),
        _ => next_possible_length(extent, SHORTEST),
    });
    lengths.flatten().min().map_or(u64::MAX, |length| start + length as u64)
}

/// Whether a damaged frame may have just these bytes, given what its header announces in one direction: never an exception
/// response.
fn is_announced(extent: Extent, frame: &[u8]) -> bool {
    extent == Extent::Exactly(frame.len()) && frame[1] & EXCEPTION_BIT == 0
}

/// The next length above `length`, both in bytes, that a frame of this announced length can have; `None` if it can have none, or
/// if its length is open: no damaged frame is added then.
fn next_possible_length(extent: Extent, length: usize) -> Option<usize> {
    match extent {
        Extent::Exactly(announced) | Extent::AtLeast(announced) if announced > length => Some(announced),
        Extent::AtLeast(_) => Some(length + 1),
        Extent::Exactly(_) | Extent::Open(_) => None,
    }
}

/// Whether a pause of `frame_gap_ns`, the start of a record or a loss is inside these bytes of the input (indices, the end
/// excluded), so that they are not one frame: a frame that lost bytes ends at the pause, before it has its length. False where
/// a timed read has several bytes, because there a pause is not known to be one.
fn crosses_known_pause(input: &Input, range: Range<usize>, frame_gap_ns: Ns) -> bool {
    !input.has_multibyte_reads && input.boundary_after(range.start, range.end - 1, frame_gap_ns).is_some()
}

/// Cost in bits of a direction that is not the one declared: more where the line itself carries the other one only. 0 where
/// nothing is declared.
fn contradiction_cost(context: &FramerContext<'_>, declared: Option<Direction>, direction: usize) -> f32 {
    match declared {
        Some(declared) if declared == side::direction_of(direction) => 0.0,
        Some(_) if context.line_direction.is_some() => weights::WRONG_LINE_BITS,
        Some(_) => weights::BROKEN_RULE_BITS,
        None => 0.0,
    }
}

/// Score in bits of pauses and record boundaries before a frame and inside it; the frame has these indices of the input, the end
/// excluded. A pause lasts at least `frame_gap_ns`.
fn timing_score(input: &Input, frame: Range<usize>, frame_gap_ns: Ns) -> f32 {
    let follows_pause = input.pause_before(frame.start).is_some_and(|pause| pause >= frame_gap_ns);
    let starts_record = || input.read(frame.start).is_some_and(|read| read.starts_record && input.starts_read(frame.start));
    let is_split = input.boundary_after(frame.start, frame.end - 1, frame_gap_ns).is_some();
    let before = if follows_pause || starts_record() { weights::PAUSE_BEFORE_BITS } else { 0.0 };
    let inside = if is_split { weights::PAUSE_INSIDE_BITS } else { 0.0 };
    before - inside
}
