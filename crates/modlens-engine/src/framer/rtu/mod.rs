//! RTU by joint evidence: CRC, layout, the outstanding request, what the line has shown, and pauses, scored in bits.
//!
//! `crc_scan` finds every substring with a valid CRC, `score` says by the table of weights what each is worth as a request or
//! a response, and `search` finds the best path through all of them. Unambiguous traffic takes the fast path past the search.
//! The bytes between frames are handed to `damage`: damaged frames where header or silences show them, noise elsewhere.

pub(crate) mod announced_length;
pub(crate) mod answerable;
pub(crate) mod crc_scan;
pub(crate) mod header_score;
pub(crate) mod learned_lengths;
pub(crate) mod log2;
pub(crate) mod lone_frames;
pub(crate) mod poll_cycle;
pub(crate) mod prefilter;
pub(crate) mod prefix_index;
pub(crate) mod score;
pub(crate) mod score_bounds;
pub(crate) mod search;
pub(crate) mod side;
pub(crate) mod traffic_model;

use crate::confidence::{self, Likeness};
use crate::damage::recovery::{damaged_hypothesis, DamageRecovery, Surroundings};
use crate::fast_path::frame_check::{FrameCheck, FrameLength};
use crate::fast_path::rtu_frame::{check_frame, check_frame_behind_strays};
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::weights::{CERTAIN_DIRECTION_BITS, COARSE_MIN_GAP_NS, FRAME_BREAK_CHARACTERS_FACTOR, FRAME_BREAK_NS};
use modlens_protocol::direction::{infer_direction, Direction};
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::functions::Extent;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use announced_length::announced_lengths;
use answerable::copy_prefix;
use search::{is_held_back, Decision, Search};

/// The framer of an RTU line.
pub struct RtuFramer {
    pub(crate) search: Search,
    /// What the search decided and is not given out yet.
    decision: Option<Decision>,
    /// The stream offset at which the fast path found no frame.
    fast_path_failed_at: Option<u64>,
    /// The stream offset of bytes behind which, taken as stray bytes, the fast path found no frame.
    fast_path_failed_after_strays_at: Option<u64>,
    /// What was found in the unframed bytes before the decision.
    recovery: DamageRecovery,
    /// The last frame given out was damaged.
    pub(crate) last_was_damaged: bool,
    /// The shortest pause between frames.
    frame_gap_ns: Ns,
}

/// Times.
impl RtuFramer {
    /// A framer for a line with these settings.
    pub fn new(line: Option<&LineSettings>) -> Self {
        Self {
            search: Search::default(),
            decision: None,
            fast_path_failed_at: None,
            fast_path_failed_after_strays_at: None,
            recovery: DamageRecovery::default(),
            last_was_damaged: false,
            frame_gap_ns: line.map_or(COARSE_MIN_GAP_NS, LineSettings::t35_ns),
        }
    }

    /// The shortest pause that counts as one between frames: longer where reads have several bytes.
    fn frame_gap_ns(&self, input: &Input) -> Ns {
        if input.has_multibyte_reads {
            self.frame_gap_ns.max(COARSE_MIN_GAP_NS)
        } else {
            self.frame_gap_ns
        }
    }

    /// Learns whether valid frames of this line, like this one of `length` bytes, have pauses inside.
    fn learn_inner_pause(&mut self, input: &Input, length: usize) {
        if input.has_times
            && !input.has_multibyte_reads
            && input.boundary_after(0, length - 1, self.frame_gap_ns(input)).is_some()
        {
            self.search.model.learn_inner_pause();
        }
    }
}

/// The fast path.
impl RtuFramer {
    /// Whether the first bytes are an unambiguous frame.
    ///
    /// Tried at most once per stream offset. A second attempt after more bytes have come could give a different result, and
    /// the output would then depend on how the input was split into blocks.
    #[inline]
    fn try_fast_path(&mut self, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
        let is_idle = !context.is_multi_line || self.search.is_idle();
        let has_failed = self.fast_path_failed_at == Some(input.offset());
        if has_failed || !is_idle || self.search.committed_offset() > input.offset() {
            return FrameCheck::NoFrame;
        }
        match check_frame(&self.search, input, context) {
            FrameCheck::Frame(length) if self.search.allows_fast_path(0, length) => FrameCheck::Frame(length),
            FrameCheck::NeedsMoreBytes => FrameCheck::NeedsMoreBytes,
            _ => {
                self.fast_path_failed_at = Some(input.offset());
                FrameCheck::NoFrame
            }
        }
    }

    /// Whether an unambiguous frame stands behind one to three stray bytes of a recording: then the search commits it, and it
    /// becomes `decision`, which the caller gives out.
    ///
    /// `NoFrame` is remembered, for the reason that `try_fast_path` gives, unless the question does not arise at all
    /// (`may_follow_strays`). After `NeedsMoreBytes` it is tried again when more have come.
    fn try_fast_path_after_strays(&mut self, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
        if !self.may_follow_strays(input, context) {
            return FrameCheck::NoFrame;
        }
        let (stray_bytes, check) = check_frame_behind_strays(&self.search, input, context);
        match check {
            FrameCheck::Frame(length) if self.is_accepted_after_strays(input, context, stray_bytes, length) => {
                self.commit_frame_after_strays(input, context, stray_bytes, length);
                check
            }
            FrameCheck::NeedsMoreBytes => check,
            _ => {
                self.fast_path_failed_after_strays_at = Some(input.offset());
                FrameCheck::NoFrame
            }
        }
    }

    /// Whether a frame behind stray bytes is looked for at the first byte: in a recording of a single line, with nothing that
    /// declares a direction or starts a record there, with all committed bytes given out, with a sound outstanding request or
    /// none, and not where it has failed before.
    fn may_follow_strays(&self, input: &Input, context: &FramerContext<'_>) -> bool {
        let is_single_line = context.line_direction.is_none() && context.connection_side.is_none() && !context.is_multi_line;
        let is_plain_read = input.first_read().is_some_and(|read| read.side.is_none() && !read.starts_record);
        let has_failed = self.fast_path_failed_after_strays_at == Some(input.offset());
        let all_is_given_out = self.search.committed_offset() == input.offset();
        let is_possible = context.may_look_ahead && is_single_line && is_plain_read && !has_failed && all_is_given_out;
        is_possible && self.search.has_sound_outstanding_request()
    }

    /// Whether the unambiguous frame behind these stray bytes needs no search: a request is outstanding or its unit took part
    /// in a paired transaction, and the search has no other frame in mind.
    fn is_accepted_after_strays(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        stray_bytes: usize,
        length: FrameLength,
    ) -> bool {
        let unit = input.bytes()[stray_bytes];
        let is_known = self.search.outstanding_request().is_some() || context.paired_units[usize::from(unit)];
        is_known && self.search.allows_fast_path(stray_bytes, length)
    }

    /// Lets the search commit the unambiguous frame behind these stray bytes, and makes it the decision.
    fn commit_frame_after_strays(&mut self, input: &Input, context: &FramerContext<'_>, stray_bytes: usize, length: FrameLength) {
        let start = input.offset() + stray_bytes as u64;
        let odds = self.fast_path_odds(input, context, stray_bytes, length);
        self.search.commit_fast_path_frame(context, input.bytes(), stray_bytes, length, odds);
        let (end, direction) = (self.search.committed_offset(), self.search.last_direction());
        let confidence = unambiguous_confidence(context, &input.bytes()[stray_bytes..]).min(odds as u8);
        self.decision = Some(Decision::Frame { start, end, direction, confidence, unconfirmed: false });
    }

    /// Log2 of the odds of the direction of a frame that the fast path found behind `stray_bytes` bytes. Only that of a response
    /// which equals its request is in any doubt.
    #[inline]
    fn fast_path_odds(&self, input: &Input, context: &FramerContext<'_>, stray_bytes: usize, length: FrameLength) -> f32 {
        let bytes = &input.bytes()[stray_bytes..stray_bytes + length.bytes()];
        let outstanding = self.search.outstanding_request().filter(|_| !length.is_request());
        if outstanding.is_none_or(|request| request.pdu[..] != bytes[1..bytes.len() - 2]) {
            return CERTAIN_DIRECTION_BITS;
        }
        let silence = if stray_bytes > 0 { input.silence_since(input.offset(), stray_bytes) } else { input.pause_before(0) };
        self.search.mirrored_response_odds(bytes[0], context.pause_evidence(silence), !input.has_times)
    }

    /// The row of the frame that the fast path found at the first byte; `adu` gets its unit and PDU. The search commits the
    /// frame, and model and `recovery` learn from it.
    #[inline]
    fn emit_fast_path_frame(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        length: FrameLength,
        adu: &mut Vec<u8>,
    ) -> FrameResult {
        let bytes = input.bytes();
        self.last_was_damaged = false;
        self.learn_inner_pause(input, length.bytes());
        let odds = self.fast_path_odds(input, context, 0, length);
        self.search.commit_fast_path_frame(context, bytes, 0, length, odds);
        let direction = self.search.last_direction();
        self.recovery.truncation.learn_reaction(&mut self.search.model, context, &bytes[..length.bytes()], direction);
        let confidence = unambiguous_confidence(context, bytes).min(odds as u8);
        if !length.is_exact() {
            return self.emit_frame(input, context, length.bytes(), direction, confidence, adu);
        }
        copy_prefix(adu, bytes, length.bytes() - 2);
        FrameResult { verdict: Verdict::Ok, direction, confidence, ..FrameResult::noise(length.bytes(), DelimitedBy::Length) }
    }
}

/// The search, and what it decided.
impl RtuFramer {
    /// The first frame or noise row, by search where the fast path does not find it; `None` if more bytes, a silence or the
    /// end are needed. A record without checksum is a row as it is.
    ///
    /// Each round gives out the next row of `decision`, or else decides (`next_decision`): a decision is a frame and all
    /// unframed bytes before it, and each call gives out one row of these. Apart from `next`, which has to be short: nearly all
    /// frames are unambiguous.
    #[inline(never)]
    fn next_by_search(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        if let Some(row) = self.record_without_checksum(input, context, adu) {
            return Some(row);
        }
        loop {
            // The search has committed these unframed bytes, so its next decision begins behind them and covers them, too.
            if self.decision.as_ref().is_some_and(|decision| is_held_back(decision, input, context)) {
                self.decision = None;
            }
            if let Some(row) = self.emit_decision(input, context, adu) {
                return Some(row);
            }
            // The request may have come on the other line of the tap.
            if context.is_multi_line && self.search.is_idle() {
                self.search.set_outstanding_request(context.outstanding_request);
            }
            match self.try_fast_path(input, context) {
                FrameCheck::Frame(length) => return Some(self.emit_fast_path_frame(input, context, length, adu)),
                FrameCheck::NeedsMoreBytes => return None,
                FrameCheck::NoFrame => self.decision = Some(self.next_decision(input, context)?),
            }
        }
    }

    /// What is decided next, by the fast path behind stray bytes, else by the search; `None` if more bytes, a silence or the end
    /// are needed. Once the input is closed, committed unframed bytes that were held back are a decision, as no frame will
    /// follow them.
    fn next_decision(&mut self, input: &Input, context: &FramerContext<'_>) -> Option<Decision> {
        match self.try_fast_path_after_strays(input, context) {
            FrameCheck::Frame(_) => return self.decision,
            FrameCheck::NeedsMoreBytes => return None,
            FrameCheck::NoFrame => {}
        }
        let committed = self.search.committed_offset();
        let held_back = input.is_closed && committed > input.offset();
        let decision = self.search.advance(input, context, self.frame_gap_ns(input));
        decision.or(held_back.then_some(Decision::UnframedTo(committed)))
    }

    /// The next row of `decision`: one of the unframed bytes before the frame, else the frame. `None` if nothing was decided,
    /// or all of it is given out.
    ///
    /// With the frame, `decision` is cleared; only a damaged one that is shorter than announced leaves the bytes behind it.
    fn emit_decision(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let decision = self.decision?;
        let (Decision::UnframedTo(unframed_to)
        | Decision::Frame { start: unframed_to, .. }
        | Decision::Damaged { start: unframed_to, .. }) = decision;
        if input.offset() < unframed_to {
            return Some(self.next_unframed(input, context, unframed_to, adu));
        }
        self.decision = None;
        match decision {
            Decision::Frame { start, end, direction, confidence, unconfirmed } => {
                let length = (end - start) as usize;
                self.learn_from_valid_frame(input, context, length, direction);
                let row = self.emit_frame(input, context, length, direction, confidence, adu);
                Some(FrameResult { unconfirmed, ..row })
            }
            Decision::Damaged { start, end, direction } => {
                self.last_was_damaged = true;
                Some(self.damaged_hypothesis(input, context, (end - start) as usize, direction, adu))
            }
            Decision::UnframedTo(_) => None,
        }
    }

    /// Notes a committed frame with a valid CRC at the first byte: that no damaged one stands in front of the next bytes, whether
    /// it has a pause inside, and what it says of a truncated response before it.
    fn learn_from_valid_frame(&mut self, input: &Input, context: &FramerContext<'_>, length: usize, direction: Direction) {
        self.last_was_damaged = false;
        self.learn_inner_pause(input, length);
        self.recovery.truncation.learn_reaction(&mut self.search.model, context, &input.bytes()[..length], direction);
    }

    /// The first row of the bytes up to stream offset `to`, which no valid frame claims: a damaged frame, or noise. `recovery`
    /// finds them with the help of the frame behind `to`, which `decision` has.
    fn next_unframed(&mut self, input: &Input, context: &FramerContext<'_>, to: u64, adu: &mut Vec<u8>) -> FrameResult {
        let next_frame = match self.decision {
            Some(Decision::Frame { start, end, direction, .. } | Decision::Damaged { start, end, direction }) => {
                let from = (start - input.offset()) as usize;
                Some((&input.bytes()[from..from + (end - start) as usize], direction))
            }
            _ => None,
        };
        let follows_damaged_frame = self.last_was_damaged;
        let frame_gap_ns = self.frame_gap_ns(input);
        let at = Surroundings { context, input, next_frame, follows_damaged_frame, frame_gap_ns };
        self.recovery.next_frame(&mut self.search.model, &at, to, adu)
    }

    /// The row of a frame with an invalid CRC that the search found by its announced length of `length` bytes. Where its last
    /// bytes are but a glitch in the place of bytes lost, the row ends before them, and they become the decision as unframed.
    fn damaged_hypothesis(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        length: usize,
        direction: Direction,
        adu: &mut Vec<u8>,
    ) -> FrameResult {
        let frame_gap_ns = self.frame_gap_ns(input);
        let at = Surroundings { context, input, next_frame: None, follows_damaged_frame: true, frame_gap_ns };
        let row = damaged_hypothesis(&mut self.search.model, &at, length, direction, adu);
        if row.length < length {
            self.decision = Some(Decision::UnframedTo(input.offset() + length as u64));
        }
        row
    }

    /// The row of a frame with a valid CRC at the first byte; `adu` gets its unit and PDU.
    fn emit_frame(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        length: usize,
        direction: Direction,
        confidence: u8,
        adu: &mut Vec<u8>,
    ) -> FrameResult {
        let frame = &input.bytes()[..length];
        adu.clear();
        adu.extend_from_slice(&frame[..length - 2]);
        let delimited_by = self.delimited_by(input, context, length);
        FrameResult { verdict: Verdict::Ok, direction, confidence, ..FrameResult::noise(length, delimited_by) }
    }

    /// What ends a frame with a valid CRC that has `length` bytes: its length if its header announces exactly that in either
    /// direction; else silence if a pause follows or the input is closed; else its CRC.
    fn delimited_by(&self, input: &Input, context: &FramerContext<'_>, length: usize) -> DelimitedBy {
        let announced = announced_lengths(context, &input.bytes()[..length]);
        let follows_pause = || input.pause_before(length).is_some_and(|pause| pause >= self.frame_gap_ns(input));
        match announced.iter().flatten().any(|(_, extent)| *extent == Extent::Exactly(length)) {
            true => DelimitedBy::Length,
            false if input.is_closed || follows_pause() => DelimitedBy::Silence,
            false => DelimitedBy::Checksum,
        }
    }

    /// The row of the first record, if it comes without checksum: then it is one frame, or noise if it has less than two bytes.
    /// `None` for any other read. `adu` gets all of its bytes.
    ///
    /// The search moves its root behind the record, but learns nothing: `context` knows the outstanding request.
    fn record_without_checksum(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let read = input.first_read().filter(|read| read.lacks_checksum)?;
        let length = (read.end - input.offset()) as usize;
        let bytes = &input.bytes()[..length];
        adu.clear();
        adu.extend_from_slice(bytes);
        self.search.skip_to(input.offset() + length as u64);
        if length < 2 {
            return Some(FrameResult::noise(length, DelimitedBy::Record));
        }
        let pause = (context.timeout_log_odds)(input.pause_before(0));
        let (functions, outstanding) = (context.functions, context.outstanding_request);
        let declared = context.declared_direction_at(input, 0);
        let direction = infer_direction(functions, outstanding, bytes[0], &bytes[1..], declared, pause);
        Some(FrameResult { verdict: Verdict::NoChecksum, direction, ..FrameResult::noise(length, DelimitedBy::Record) })
    }
}

/// The confidence of the unambiguous frame that begins like this.
#[inline]
fn unambiguous_confidence(context: &FramerContext<'_>, frame: &[u8]) -> u8 {
    confidence::of_unambiguous(Likeness::of_frame(context.functions, frame))
}

impl Framer for RtuFramer {
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let has_checksum = || input.first_read().is_some_and(|read| !read.lacks_checksum);
        if self.decision.is_none() && !context.is_multi_line && has_checksum() {
            match self.try_fast_path(input, context) {
                FrameCheck::Frame(length) => return Some(self.emit_fast_path_frame(input, context, length, adu)),
                FrameCheck::NeedsMoreBytes => return None,
                FrameCheck::NoFrame => {}
            }
        }
        self.next_by_search(input, context, adu)
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn skip_to(&mut self, offset: u64) {
        self.decision = None;
        self.search.skip_to(offset);
    }

    fn is_settled_at(&self, offset: u64) -> bool {
        self.decision.is_none() && self.fast_path_failed_at != Some(offset) && self.search.is_settled_at(offset)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        line.map_or(FRAME_BREAK_NS, |line| FRAME_BREAK_NS.max(FRAME_BREAK_CHARACTERS_FACTOR * line.char_ns()))
    }
}
