//! Where in the lattice a frame hypothesis scores best: after which path, for each kind of path that matters.

use crate::framer::rtu::context_score::{context_score, mirrors_request, ContextScore, FrameInPlace, Preceding};
use crate::framer::rtu::search::hypothesis::Hypothesis;
use crate::framer::rtu::search::nested::Contents;
use crate::framer::rtu::search::state::Search;
use crate::framer::{FramerContext, PauseEvidence};
use crate::input::Input;
use crate::rtu_model::answerable::Answerable;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::weights::{DAMAGED_REQUEST_BITS, MAY_HIDE_FRAME_BYTES, ROUNDING_BITS};
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::EXCEPTION_BIT;

/// A substring with a valid CRC, and what is known of it on whatever path and in whichever direction it stands.
pub(super) struct ValidSubstring<'a> {
    /// Stream offset of its first byte.
    pub start: u64,
    /// Index of its first byte in the input.
    pub start_index: usize,
    /// The bytes, CRC included.
    pub frame: FrameBytes<'a>,
    /// What the silence before it says.
    pub pause: PauseEvidence,
    /// Score in bits of pauses and record boundaries before it and inside it.
    pub timing_score: f32,
    /// The direction that the connection, the line or the recording declares for it.
    pub declared: Option<Direction>,
    /// Which frames it may contain.
    pub contents: Option<Contents>,
    /// By index of a hypothesis: what frames inside this one add after that (`nested_scores`); empty if there are none.
    pub nested_scores: Vec<f32>,
}

impl ValidSubstring<'_> {
    /// Score in bits of the frames inside this one, if it follows the hypothesis `parent` (an index of the lattice). Frames
    /// in data that were read count only if this frame answers the outstanding request; in copied data they always do.
    fn nested_score(&self, parent: usize, answers_outstanding: bool) -> f32 {
        let counts = self.contents == Some(Contents::Copied) || answers_outstanding;
        self.nested_scores.get(parent).copied().filter(|_| counts).unwrap_or(0.0)
    }
}

/// A place in the lattice for a new hypothesis, and its scores there, in bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    /// Index of the hypothesis before it.
    pub parent: usize,
    /// Score of the path up to the end of the new frame.
    pub path_score: f32,
    /// Score of the new frame.
    pub frame_score: f32,
    /// It answers the request that is outstanding there.
    pub answers_outstanding: bool,
}

/// The kinds of places, by number (`place_kind`).
pub(super) const PLACE_KINDS: usize = 4;

impl Search {
    /// The best places in the lattice for a frame of this direction, one of each kind (`place_kind`); `None` where no path of the
    /// kind ends at or before the frame's start, or none would have more than `floor` bits with it.
    ///
    /// Only the best path of each kind is kept, although paths may differ in their earlier requests as well. `own_score` is the
    /// frame's score in bits without the frames before it. A path is worth its score less the cost of the unframed bytes
    /// between, plus the frame with its context, plus the frames inside it.
    pub(super) fn best_placements(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        substring: &ValidSubstring<'_>,
        direction: usize,
        own_score: f32,
        floor: f32,
    ) -> [Option<Placement>; PLACE_KINDS] {
        let mut best: [Option<Placement>; PLACE_KINDS] = [None; PLACE_KINDS];
        let mirrors = mirrors_request(context, substring.frame.pdu());
        let mut contexts = ContextScores::new(self, input, context, substring, direction);
        // The latest paths are mostly the best, and the others cannot reach them. Of equal ones the first counts.
        for (parent, before) in self.lattice.iter().enumerate().rev() {
            if before.end > substring.start {
                continue;
            }
            let unframed_cost = self.model.unframed_cost(substring.start - before.end);
            let follows_echo = mirrors && self.requests.look_up(before.answerable).heard_twice();
            let is_concerned = contexts.concerns_frame(before.answerable);
            if !is_concerned {
                let most_bits = own_score + contexts.most_unconcerned_bits() + substring.nested_score(parent, true);
                let bound = before.path_score - unframed_cost + most_bits + ROUNDING_BITS;
                let known = best[place_kind(false, follows_echo)].map_or(floor, |known| known.path_score);
                if bound < known.max(floor) {
                    continue;
                }
            }
            let ContextScore { bits, answers_outstanding } = contexts.behind(before, is_concerned);
            let frame_score = own_score + bits;
            let nested_score = substring.nested_score(parent, answers_outstanding);
            let path_score = before.path_score - unframed_cost + frame_score + nested_score;
            let place = &mut best[place_kind(answers_outstanding, follows_echo)];
            if path_score > floor && place.is_none_or(|known| path_score >= known.path_score) {
                *place = Some(Placement { parent, path_score, frame_score, answers_outstanding });
            }
        }
        best
    }

    /// The oracle of `best_placements`: all paths are scored, from the first to the last.
    #[cfg(test)]
    pub(super) fn best_of_all_placements(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        substring: &ValidSubstring<'_>,
        direction: usize,
        own_score: f32,
        floor: f32,
    ) -> [Option<Placement>; PLACE_KINDS] {
        let mut best: [Option<Placement>; PLACE_KINDS] = [None; PLACE_KINDS];
        let mirrors = mirrors_request(context, substring.frame.pdu());
        for (parent, before) in self.lattice.iter().enumerate().filter(|(_, before)| before.end <= substring.start) {
            let mut contexts = ContextScores::new(self, input, context, substring, direction);
            let ContextScore { bits, answers_outstanding } = contexts.behind(before, true);
            let frame_score = own_score + bits;
            let unframed_cost = self.model.unframed_cost(substring.start - before.end);
            let nested_score = substring.nested_score(parent, answers_outstanding);
            let path_score = before.path_score - unframed_cost + frame_score + nested_score;
            let follows_echo = mirrors && self.requests.look_up(before.answerable).heard_twice();
            let place = &mut best[place_kind(answers_outstanding, follows_echo)];
            if path_score > floor && place.is_none_or(|known| path_score > known.path_score) {
                *place = Some(Placement { parent, path_score, frame_score, answers_outstanding });
            }
        }
        best
    }
}

/// The kind of a place is two facts: whether the frame answers the outstanding request, which a request never does, and whether
/// a frame whose request and response are equal follows a request that was heard twice.
fn place_kind(answers_outstanding: bool, follows_echo: bool) -> usize {
    usize::from(answers_outstanding) + 2 * usize::from(follows_echo)
}

/// What a context score depends on beside the pause before the frame and the requests that may be answered: how many unframed
/// bytes are before it, as a class, and whether its header stands among them.
type PlaceKey = (usize, bool);

/// The number of the class of unframed bytes before a frame that its context score depends on: none, a few, or so many that they
/// may hide a frame.
fn unframed_class(bytes: u64) -> usize {
    usize::from(bytes > 0) + usize::from(bytes >= MAY_HIDE_FRAME_BYTES)
}

/// The classes of unframed bytes.
const UNFRAMED_CLASSES: usize = 3;

/// Context scores of one frame in one direction, after one hypothesis after the other.
struct ContextScores<'a> {
    search: &'a Search,
    input: &'a Input,
    context: &'a FramerContext<'a>,
    substring: &'a ValidSubstring<'a>,
    direction: usize,
    /// What the frame is worth for being a request that was seen before.
    polled_score: f32,
    /// Stream offset at which the frame's own unit and function last are before it (`last_same_header`).
    same_header_at: Option<u64>,
    /// The last score: on most paths the same request is outstanding, so it is the next one as well.
    last: Option<((Answerable, PlaceKey), ContextScore)>,
    /// The scores after requests that have nothing to do with the frame (`concerns_frame`): only whether one is outstanding
    /// counts there, and the place.
    unconcerned: [[[Option<ContextScore>; 2]; UNFRAMED_CLASSES]; 2],
}

impl<'a> ContextScores<'a> {
    fn new(
        search: &'a Search,
        input: &'a Input,
        context: &'a FramerContext<'a>,
        substring: &'a ValidSubstring<'a>,
        direction: usize,
    ) -> Self {
        // A response to no request may have its own, damaged, among the unframed bytes before it.
        let nothing_outstanding = || search.lattice.iter().any(|before| before.answerable.outstanding.is_none());
        let is_known = || search.model.has_unit_and_function(substring.frame.unit(), substring.frame.code());
        let looks_for_header = direction == RESPONSE && nothing_outstanding() && is_known();
        let same_header_at = if looks_for_header { last_same_header(input, substring) } else { None };
        let polled_score = if direction == REQUEST { search.model.polled_request_score(substring.frame.0) } else { 0.0 };
        let unconcerned = [[[None; 2]; UNFRAMED_CLASSES]; 2];
        Self { search, input, context, substring, direction, polled_score, same_header_at, last: None, unconcerned }
    }

    /// The most bits that the context may be worth after requests that have nothing to do with the frame: a request may be one
    /// that was seen before, and a response may have its own, damaged, before it. All other terms are at most 0.
    fn most_unconcerned_bits(&self) -> f32 {
        if self.direction == REQUEST {
            self.polled_score
        } else {
            DAMAGED_REQUEST_BITS
        }
    }

    /// The context score of the frame after this hypothesis, which ends at or before the frame's start; `is_concerned` is what
    /// `concerns_frame` reports about its requests.
    fn behind(&mut self, before: &Hypothesis, is_concerned: bool) -> ContextScore {
        let unframed_bytes = self.substring.start - before.end;
        let has_same_header = self.same_header_at.is_some_and(|at| at >= before.end);
        let preceding = Preceding { unframed_bytes, has_same_header };
        let follows_strays = (1..MAY_HIDE_FRAME_BYTES).contains(&unframed_bytes);
        // Without times, silences say nothing, however long the strays are.
        if follows_strays && self.input.has_times {
            self.last = None;
            return self.compute(before.answerable, preceding, self.pause_behind_strays(before.end));
        }
        let (class, answerable) = (unframed_class(unframed_bytes), before.answerable);
        if !is_concerned {
            let has_outstanding = usize::from(answerable.outstanding.is_some());
            if let Some(score) = self.unconcerned[has_outstanding][class][usize::from(has_same_header)] {
                return score;
            }
            let score = self.compute(answerable, preceding, self.substring.pause);
            self.unconcerned[has_outstanding][class][usize::from(has_same_header)] = Some(score);
            return score;
        }
        let key = (answerable, (class, has_same_header));
        match self.last {
            Some((last_key, score)) if last_key == key => score,
            _ => {
                let score = self.compute(answerable, preceding, self.substring.pause);
                self.last = Some((key, score));
                score
            }
        }
    }

    /// Whether any of these requests has the frame's unit and function. No other one is asked or answered again by the frame, or
    /// predicts anything of it.
    fn concerns_frame(&self, answerable: Answerable) -> bool {
        let (unit, function) = (self.substring.frame.unit(), self.substring.frame.code() & !EXCEPTION_BIT);
        let last_answered = answerable.last_answered.map(|(request, _)| request);
        let requests = [answerable.outstanding, answerable.superseded, last_answered];
        requests.into_iter().flatten().any(|id| self.search.requests.get(id).matches(unit, function))
    }

    fn compute(&self, answerable: Answerable, preceding: Preceding, pause: PauseEvidence) -> ContextScore {
        let answerable = self.search.requests.look_up(answerable);
        let (model, context, frame) = (&self.search.model, self.context, self.substring.frame);
        let polled_score = self.polled_score;
        context_score(&FrameInPlace { model, context, answerable, frame, polled_score, pause, preceding }, self.direction)
    }

    /// What the silence between the frame that ends at stream offset `end` and this one says. It counts from that frame, stray
    /// bytes included: they do not make it shorter. Where that frame is no longer in the input, the silence right before this
    /// one counts.
    fn pause_behind_strays(&self, end: u64) -> PauseEvidence {
        if end < self.input.offset() {
            return self.substring.pause;
        }
        self.context.pause_evidence(self.input.silence_since(end, self.substring.start_index))
    }
}

/// The stream offset at which unit and function of a frame last stand among the bytes of the input before it, at most
/// `MAX_CANDIDATE_BYTES` before its start: perhaps those are its request, damaged. The exception bit of the frame does not
/// count. `None` if they stand nowhere.
fn last_same_header(input: &Input, substring: &ValidSubstring<'_>) -> Option<u64> {
    let (unit, function) = (substring.frame.unit(), substring.frame.code() & !EXCEPTION_BIT);
    let search_from = substring.start_index.saturating_sub(MAX_CANDIDATE_BYTES);
    let before = &input.bytes()[search_from..substring.start_index];
    let mut units = memchr::memrchr_iter(unit, before);
    let place = units.find(|&place| before.get(place + 1) == Some(&function))?;
    Some(input.offset() + (search_from + place) as u64)
}
