//! Adds frame hypotheses to the lattice: substrings with a valid CRC, and damaged frames of the announced length, each
//! behind every path that ends before it.

use crate::framer::rtu::announced_length::announced_lengths;
use crate::framer::rtu::answerable::Answerable;
use crate::framer::rtu::crc_scan::{MAX_CANDIDATE_BYTES, MAX_CANDIDATE_SPAN};
use crate::framer::rtu::score::{self, Preceding};
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::nested::Contents;
use crate::framer::rtu::search::state::Search;
use crate::framer::rtu::side::{self, REQUEST, RESPONSE};
use crate::framer::{FramerContext, PauseEvidence};
use crate::input::Input;
use crate::weights;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// A substring with a valid CRC.
struct ValidSubstring<'a> {
    /// Index of its first byte in the input.
    start_index: usize,
    bytes: &'a [u8],
    /// What the silence before it says.
    pause: PauseEvidence,
    /// The result of `nested_scores`.
    nested: Vec<f32>,
    /// What those count for.
    contents: Option<Contents>,
}

/// A place in the lattice for a new hypothesis: behind this parent it has these scores, in bits.
#[derive(Clone, Copy)]
struct Placement {
    path_score: f32,
    parent: usize,
    frame_score: f32,
}

/// The kinds of places in the lattice, by number: whether the frame answers the outstanding request, and whether it is a write
/// or its equal response behind a request that was heard twice.
const PLACES: usize = 4;
const ANSWERS: usize = 1;
const FOLLOWS_ECHO: usize = 2;

impl Search {
    /// Adds the hypotheses of a substring with a valid CRC from stream offset `start` to the last byte scanned: as a request and
    /// as a response, and in each direction as one that answers the outstanding request and one that does not, each behind the
    /// path where it scores best. So up to three are added; none if `start` is committed already, or no frame looks like this.
    ///
    /// `frame_gap_ns` is the shortest pause between frames, `floor` the path score in bits at or below which nothing is added.
    pub(super) fn add_valid_hypotheses(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        start: u64,
        frame_gap_ns: Ns,
        floor: f32,
    ) {
        if start < self.committed_offset() {
            return;
        }
        let (start_index, end_index) = ((start - input.offset()) as usize, (self.scanned_to - input.offset()) as usize);
        let frame = &input.bytes()[start_index..end_index];
        if score::is_impossible(frame) {
            return;
        }
        let pause = context.pause_evidence_at(input, start_index);
        let contents = self.contents(context, frame);
        let nested = if contents.is_some() { self.nested_scores(start) } else { Vec::new() };
        let substring = ValidSubstring { start_index, bytes: frame, pause, nested, contents };
        let timing = timing_score(input, start_index, end_index, frame_gap_ns);
        let declared = context.declared_direction_at(input, start_index);
        for direction in [REQUEST, RESPONSE] {
            let Some(own_score) = score::frame_score(&self.model, context, frame, direction) else { continue };
            let contradiction = match declared {
                Some(declared) if declared == side::direction_of(direction) => 0.0,
                Some(_) if context.line_direction.is_some() => weights::WRONG_LINE_BITS,
                Some(_) => weights::BROKEN_RULE_BITS,
                None => 0.0,
            };
            let own_score = own_score + timing - contradiction;
            let placements = self.best_placements(input, context, &substring, direction, own_score, floor);
            for (kind, placement) in placements.into_iter().enumerate() {
                let Some(Placement { path_score, parent, frame_score }) = placement else { continue };
                let answers = kind & ANSWERS != 0;
                self.reserve_request();
                let before = self.lattice[parent].answerable;
                let answerable = self.requests.after(before, frame, direction, answers, true);
                self.push(Hypothesis {
                    direction,
                    path_score,
                    frame_score,
                    parent,
                    answers_outstanding: answers,
                    answerable,
                    ..self.new_hypothesis(start)
                });
            }
        }
    }

    /// The best places in the lattice for a frame: where it does not answer the outstanding request, and where it does. `None`
    /// where no path behind which it fits would have more than `floor` bits with it.
    ///
    /// Only the best path of each kind is kept, although paths may differ in their earlier requests as well: a response
    /// leaves the outstanding request or clears it, and that decides most of what follows. A request is the outstanding one
    /// behind itself whatever was before, so it has a place of the first kind only. `own_score` is the frame's score in bits without the
    /// frames before it. A path is worth its score less the unframed bytes between, plus the frame with its context and, where
    /// hypotheses stand inside the frame, what these are worth.
    fn best_placements(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        substring: &ValidSubstring<'_>,
        direction: usize,
        own_score: f32,
        floor: f32,
    ) -> [Option<Placement>; PLACES] {
        let &ValidSubstring { start_index, bytes: frame, pause, ref nested, contents } = substring;
        let start = input.offset() + start_index as u64;
        let mut best = [None; PLACES];
        let mirrors = score::mirrors_request(context, &frame[1..frame.len() - 2]);
        // A response to no request may have its own, damaged, among the unframed bytes before it.
        let nothing_outstanding = self.lattice.iter().any(|before| before.answerable.outstanding.is_none());
        let looks_for_header =
            direction == RESPONSE && nothing_outstanding && self.model.has_unit_and_function(frame[0], frame[1]);
        let same_header = if looks_for_header { last_same_header(input, start_index, frame) } else { None };
        // On most paths the same request is outstanding, so the last context score is kept.
        let mut cached = None;
        for (i, before) in self.lattice.iter().enumerate().filter(|(_, before)| before.end <= start) {
            let unframed_bytes = start - before.end;
            let after_strays = (1..weights::MAY_HIDE_FRAME_BYTES).contains(&unframed_bytes);
            let has_same_header = same_header.is_some_and(|place| place >= before.end);
            let key = (before.answerable, unframed_bytes >= weights::MAY_HIDE_FRAME_BYTES, has_same_header);
            let (context_score, answers) = match cached {
                Some((cached_key, scores)) if cached_key == key && !after_strays => scores,
                _ => {
                    let answerable = self.requests.look_up(before.answerable);
                    // The silence counts from the frame before, stray bytes included: they do not make it shorter.
                    let strays_in_silence = after_strays && before.end >= input.offset();
                    let pause = if strays_in_silence {
                        context.pause_evidence(input.silence_since(before.end, start_index))
                    } else {
                        pause
                    };
                    let preceding = Preceding { unframed_bytes, has_same_header };
                    score::context_score(&self.model, context, answerable, frame, direction, pause, preceding)
                }
            };
            cached = (!after_strays).then_some((key, (context_score, answers)));
            let frame_score = own_score + context_score;
            let contains = contents == Some(Contents::Copied) || answers;
            let nested_score = nested.get(i).copied().filter(|_| contains).unwrap_or(0.0);
            let path_score = before.path_score - self.model.unframed_cost(unframed_bytes) + frame_score + nested_score;
            let follows_echo = mirrors && self.requests.look_up(before.answerable).heard_twice();
            let kind = if answers { ANSWERS } else { 0 } | if follows_echo { FOLLOWS_ECHO } else { 0 };
            let place: &mut Option<Placement> = &mut best[kind];
            if path_score > floor && place.is_none_or(|known| path_score > known.path_score) {
                *place = Some(Placement { path_score, parent: i, frame_score });
            }
        }
        best
    }

    /// A frame from `start` to the last byte scanned, of which nothing else is known yet.
    fn new_hypothesis(&self, start: u64) -> Hypothesis {
        Hypothesis {
            start,
            end: self.scanned_to,
            direction: REQUEST,
            path_score: 0.0,
            frame_score: 0.0,
            parent: ROOT,
            first_on_path: ROOT,
            next_damaged_end_at: self.scanned_to + weights::MIN_DAMAGED_FRAME_BYTES,
            answers_outstanding: false,
            is_crc_valid: true,
            answerable: Answerable::default(),
        }
    }

    fn push(&mut self, hypothesis: Hypothesis) {
        let parent = hypothesis.parent;
        let first_on_path = if parent == ROOT { self.lattice.len() } else { self.lattice[parent].first_on_path };
        self.skip.next_damaged_end_at = self.skip.next_damaged_end_at.min(hypothesis.next_damaged_end_at);
        self.lattice.push(Hypothesis { first_on_path, ..hypothesis });
    }

    /// Adds frames with an invalid CRC that begin right behind another frame and have exactly the length they announce.
    ///
    /// Nothing is added where a frame with a valid CRC ends (`no_valid_end` is false).
    pub(super) fn add_damaged_hypotheses(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        frame_gap_ns: Ns,
        no_valid_end: bool,
    ) {
        self.skip.next_damaged_end_at = u64::MAX;
        for parent in 0..self.lattice.len() {
            if self.lattice[parent].next_damaged_end_at <= self.scanned_to {
                let next = self.add_damaged_hypotheses_behind(input, context, parent, frame_gap_ns, no_valid_end);
                self.lattice[parent].next_damaged_end_at = next;
            }
            self.skip.next_damaged_end_at = self.skip.next_damaged_end_at.min(self.lattice[parent].next_damaged_end_at);
        }
    }

    /// Adds damaged frames right behind the hypothesis `parent` that end at the last byte scanned with exactly the length that
    /// they announce; returns the stream offset at which one may end next, `u64::MAX` if none can.
    ///
    /// None is added for an exception response, where a valid frame ends (`no_valid_end` is false), or, unless timed reads of
    /// several bytes are in the input, across a pause of `frame_gap_ns`, the start of a record or a loss.
    fn add_damaged_hypotheses_behind(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        parent: usize,
        frame_gap_ns: Ns,
        no_valid_end: bool,
    ) -> u64 {
        let start = self.lattice[parent].end;
        let length = self.scanned_to - start;
        if start < input.offset() || length > MAX_CANDIDATE_SPAN {
            return u64::MAX;
        }
        if length < weights::MIN_DAMAGED_FRAME_BYTES {
            return start + weights::MIN_DAMAGED_FRAME_BYTES;
        }
        let from = (start - input.offset()) as usize;
        let frame = &input.bytes()[from..from + length as usize];
        let mut next_end_at = u64::MAX;
        for (direction, extent) in announced_lengths(context, frame).into_iter().flatten() {
            match extent {
                Extent::Exactly(announced) if announced == frame.len() => {
                    // Unless a timed read has several bytes, a pause is known to be one, and a frame that lost bytes ends at a
                    // pause, before it has its length.
                    let is_paused =
                        !input.has_multibyte_reads && input.boundary_after(from, from + frame.len() - 1, frame_gap_ns).is_some();
                    if no_valid_end && !is_paused && frame[1] & EXCEPTION_BIT == 0 {
                        self.add_damaged_hypothesis(context, parent, start, frame, side::index_of(direction));
                    }
                }
                Extent::Exactly(announced) | Extent::AtLeast(announced) if announced > frame.len() => {
                    next_end_at = next_end_at.min(start + announced as u64);
                }
                Extent::AtLeast(_) => next_end_at = next_end_at.min(self.scanned_to + 1),
                Extent::Exactly(_) | Extent::Open(_) => {}
            }
        }
        next_end_at
    }

    /// Adds one frame with an invalid CRC behind a hypothesis, if it is expected there.
    fn add_damaged_hypothesis(&mut self, context: &FramerContext<'_>, parent: usize, start: u64, frame: &[u8], direction: usize) {
        let outstanding = self.lattice[parent].answerable.outstanding.map(|id| self.requests.get(id));
        let score = score::damaged_frame_score(&self.model, context, outstanding, frame, direction);
        let Some(frame_score) = score else { return };
        let path_score = self.lattice[parent].path_score + frame_score;
        let answers = direction == RESPONSE;
        self.reserve_request();
        let answerable = self.requests.after(self.lattice[parent].answerable, frame, direction, answers, false);
        self.push(Hypothesis {
            direction,
            path_score,
            frame_score,
            parent,
            answers_outstanding: answers,
            is_crc_valid: false,
            answerable,
            ..self.new_hypothesis(start)
        });
    }
}

/// The stream offset at which unit and function of a frame last stand among the unframed bytes of the input before index `from`,
/// where it begins, at most `MAX_CANDIDATE_BYTES` back: perhaps those are its request, damaged.
fn last_same_header(input: &Input, from: usize, frame: &[u8]) -> Option<u64> {
    let function = frame[1] & !EXCEPTION_BIT;
    let search_from = from.saturating_sub(MAX_CANDIDATE_BYTES);
    let before = &input.bytes()[search_from..from];
    let mut units = memchr::memrchr_iter(frame[0], before);
    let place = units.find(|&place| before.get(place + 1) == Some(&function))?;
    Some(input.offset() + (search_from + place) as u64)
}

/// Score in bits of pauses and record boundaries before a frame and inside it; the frame has the indices `from..to` of the input.
fn timing_score(input: &Input, from: usize, to: usize, frame_gap_ns: Ns) -> f32 {
    let follows_pause = input.pause_before(from).is_some_and(|pause| pause >= frame_gap_ns);
    let starts_record = || input.read(from).is_some_and(|read| read.starts_record && input.starts_read(from));
    let before = if follows_pause || starts_record() { weights::PAUSE_BEFORE_BITS } else { 0.0 };
    let inside = if input.boundary_after(from, to - 1, frame_gap_ns).is_some() { weights::PAUSE_INSIDE_BITS } else { 0.0 };
    before - inside
}
