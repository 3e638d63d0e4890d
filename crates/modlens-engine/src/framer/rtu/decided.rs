//! What the search decided, and the rows that it becomes: frames, and the damaged frames and noise before them.

use crate::damage::recovery::{damaged_hypothesis, Surroundings};
use crate::framer::rtu::frame_check::FrameCheck;
use crate::framer::rtu::search::{is_held_back, Decision};
use crate::framer::rtu::RtuFramer;
use crate::framer::{FrameResult, FramerContext};
use crate::input::Input;
use crate::rtu_model::announced_length::announced_lengths;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::{infer_direction, Direction};
use modlens_protocol::framing::{DelimitedBy, Verdict};
use modlens_protocol::functions::Extent;

impl RtuFramer {
    /// The first frame or noise row, by search where the fast path does not find it; `None` if more bytes, a silence or the
    /// end are needed. A record without checksum is a row as it is.
    ///
    /// Each round returns the next row of `decision`, or else decides (`next_decision`): a decision is a frame and all
    /// unframed bytes before it, and each call returns one row of these. It is a function of its own, so that `next`, which takes
    /// nearly all frames on the fast path, stays short.
    #[inline(never)]
    pub(super) fn next_by_search(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        adu: &mut Vec<u8>,
    ) -> Option<FrameResult> {
        if let Some(row) = self.record_without_checksum(input, context, adu) {
            return Some(row);
        }
        loop {
            // The search goes on after these unframed bytes, but their rows are not returned yet: they will be part of the
            // unframed bytes before the frame that it decides on next.
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
                FrameCheck::Frame(length) => return Some(self.commit_unambiguous_frame(input, context, length, adu)),
                FrameCheck::NeedsMoreBytes => return None,
                FrameCheck::NoFrame => self.decision = Some(self.next_decision(input, context)?),
            }
        }
    }

    /// What is decided next, by the fast path after stray bytes, else by the search; `None` if more bytes, a silence or the end
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

    /// Returns the next row of `decision`: first the rows of the unframed bytes before the frame, then that of the frame. `None`
    /// if nothing is decided, or if all rows of the decision were returned.
    ///
    /// The row of the frame clears `decision`. If a damaged frame turns out to be shorter than announced, the bytes between its
    /// end and the announced end become the next decision, as unframed bytes (`damaged_hypothesis`).
    fn emit_decision(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let decision = self.decision?;
        if input.offset() < decision.unframed_to() {
            return Some(self.next_unframed(input, context, decision, adu));
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
                let row = self.damaged_hypothesis(input, context, (end - start) as usize, direction, adu)?;
                self.last_was_damaged = true;
                Some(row)
            }
            Decision::UnframedTo(_) => None,
        }
    }

    /// Notes a committed frame with a valid CRC at the first byte: that no damaged one is in front of the next bytes, whether
    /// it has a pause inside, and what it reports about a truncated response before it.
    fn learn_from_valid_frame(&mut self, input: &Input, context: &FramerContext<'_>, length: usize, direction: Direction) {
        self.last_was_damaged = false;
        self.learn_inner_pause(input, length);
        self.recovery.truncation.learn_reaction(&mut self.search.model, context, &input.bytes()[..length], direction);
    }

    /// The first row of the unframed bytes before this decision, of which there is at least one: a damaged frame, or noise.
    /// `recovery` finds it with the help of the frame after them, if one was decided.
    fn next_unframed(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        decision: Decision,
        adu: &mut Vec<u8>,
    ) -> FrameResult {
        let next_frame = match decision {
            Decision::Frame { start, end, direction, .. } | Decision::Damaged { start, end, direction } => {
                let index = |offset: u64| (offset - input.offset()) as usize;
                Some((&input.bytes()[index(start)..index(end)], direction))
            }
            Decision::UnframedTo(_) => None,
        };
        let (follows_damaged_frame, frame_gap_ns) = (self.last_was_damaged, self.frame_gap_ns(input));
        let at = Surroundings { context, input, next_frame, follows_damaged_frame, frame_gap_ns };
        self.recovery.next_frame(&mut self.search.model, &at, decision.unframed_to(), adu)
    }

    /// The row of a frame with an invalid CRC that the search found by its announced length of `length` bytes. Where its last
    /// bytes are but a glitch in the place of bytes lost, the row ends before them, and they become the decision as unframed.
    /// `None` where they are the beginning of a longer frame: they are held back, as unframed bytes before what is decided next.
    fn damaged_hypothesis(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        length: usize,
        direction: Direction,
        adu: &mut Vec<u8>,
    ) -> Option<FrameResult> {
        let frame_gap_ns = self.frame_gap_ns(input);
        // The bytes are one frame. With `follows_damaged_frame`, no fragment of another frame is searched at their beginning.
        let at = Surroundings { context, input, next_frame: None, follows_damaged_frame: true, frame_gap_ns };
        let row = damaged_hypothesis(&mut self.search.model, &at, length, direction, adu)?;
        if row.length < length {
            self.decision = Some(Decision::UnframedTo(input.offset() + length as u64));
        }
        Some(row)
    }

    /// The row of a frame with a valid CRC at the first byte; `adu` gets its unit and PDU.
    pub(super) fn emit_frame(
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
        adu.extend_from_slice(&frame[..length - CRC_BYTES]);
        let delimited_by = self.delimited_by(input, context, length);
        FrameResult { direction, confidence, ..FrameResult::new(Verdict::Ok, length, delimited_by) }
    }

    /// What ends a frame with a valid CRC that has `length` bytes: its length if its header announces exactly that in either
    /// direction; else silence if a pause follows, or the input is closed and has no bytes after it; else its CRC.
    fn delimited_by(&self, input: &Input, context: &FramerContext<'_>, length: usize) -> DelimitedBy {
        let announced = announced_lengths(context, &input.bytes()[..length]);
        let follows_pause = || input.pause_before(length).is_some_and(|pause| pause >= self.frame_gap_ns(input));
        match announced.iter().flatten().any(|(_, extent)| *extent == Extent::Exactly(length)) {
            true => DelimitedBy::Length,
            false if follows_pause() || (input.is_closed && length == input.bytes().len()) => DelimitedBy::Silence,
            false => DelimitedBy::Checksum,
        }
    }

    /// The row of the first record, if it comes without checksum: then it is one frame, or noise if it has less than two bytes.
    /// `None` for any other read. `adu` gets all of its bytes.
    ///
    /// The search moves its root after the record, but learns nothing: `context` knows the outstanding request.
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
        Some(FrameResult { direction, ..FrameResult::new(Verdict::NoChecksum, length, DelimitedBy::Record) })
    }
}
