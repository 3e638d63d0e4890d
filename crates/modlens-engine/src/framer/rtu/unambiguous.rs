//! The fast path of the framer: unambiguous frames, which the search commits without having looked for them.

use crate::confidence::{self, Likeness};
use crate::framer::rtu::frame_check::{FrameCheck, FrameLength};
use crate::framer::rtu::search::Decision;
use crate::framer::rtu::single_frame::{check_frame, check_frame_behind_strays};
use crate::framer::rtu::RtuFramer;
use crate::framer::{FrameResult, FramerContext};
use crate::input::Input;
use crate::rtu_model::answerable::copy_prefix;
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::{DelimitedBy, Verdict};

impl RtuFramer {
    /// Whether the first bytes are an unambiguous frame.
    ///
    /// Not tried again at a stream offset where it has failed (`NoFrame`): after more bytes have come it could give a different
    /// result, and the output would then depend on how the input was split into blocks. After `NeedsMoreBytes` it is.
    #[inline]
    pub(super) fn try_fast_path(&mut self, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
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

    /// Whether an unambiguous frame follows one to three stray bytes of a recording: then the search commits it, and it
    /// becomes `decision`, which the caller returns.
    ///
    /// `NoFrame` is remembered, for the reason that `try_fast_path` gives, unless the question does not arise at all
    /// (`may_follow_strays`). After `NeedsMoreBytes` it is tried again when more have come.
    pub(super) fn try_fast_path_after_strays(&mut self, input: &Input, context: &FramerContext<'_>) -> FrameCheck {
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

    /// Whether a frame after stray bytes is looked for at the first byte: in a recording of a single line, with nothing that
    /// declares a direction or starts a record there, with all committed bytes returned, with a sound outstanding request or
    /// none, and not where it has failed before.
    fn may_follow_strays(&self, input: &Input, context: &FramerContext<'_>) -> bool {
        let is_single_line = context.line_direction.is_none() && context.connection_side.is_none() && !context.is_multi_line;
        let is_plain_read = input.first_read().is_some_and(|read| read.side.is_none() && !read.starts_record);
        let has_failed = self.fast_path_failed_after_strays_at == Some(input.offset());
        let all_is_given_out = self.search.committed_offset() == input.offset();
        let is_possible = context.may_look_ahead && is_single_line && is_plain_read && !has_failed && all_is_given_out;
        is_possible && self.search.has_sound_outstanding_request()
    }

    /// Whether the unambiguous frame after these stray bytes needs no search: a request is outstanding or its unit took part
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

    /// Lets the search commit the unambiguous frame after these stray bytes, and makes it the decision.
    fn commit_frame_after_strays(&mut self, input: &Input, context: &FramerContext<'_>, stray_bytes: usize, length: FrameLength) {
        let start = input.offset() + stray_bytes as u64;
        let odds = self.fast_path_odds(input, context, stray_bytes, length);
        self.search.commit_fast_path_frame(context, input.bytes(), stray_bytes, length, odds);
        let (end, direction) = (self.search.committed_offset(), self.search.last_direction());
        let confidence = unambiguous_confidence(context, &input.bytes()[stray_bytes..]).min(confidence::of_direction(odds));
        self.decision = Some(Decision::Frame { start, end, direction, confidence, unconfirmed: false });
    }

    /// Log2 of the odds of the direction of a frame that the fast path found after `stray_bytes` bytes. Only that of a response
    /// which equals its request is in any doubt.
    #[inline]
    fn fast_path_odds(&self, input: &Input, context: &FramerContext<'_>, stray_bytes: usize, length: FrameLength) -> f32 {
        let bytes = &input.bytes()[stray_bytes..stray_bytes + length.bytes()];
        let outstanding = self.search.outstanding_request().filter(|_| !length.is_request());
        if outstanding.is_none_or(|request| request.pdu[..] != bytes[1..bytes.len() - CRC_BYTES]) {
            return CERTAIN_DIRECTION_BITS;
        }
        let silence = if stray_bytes > 0 { input.silence_since(input.offset(), stray_bytes) } else { input.pause_before(0) };
        self.search.mirrored_response_odds(bytes[0], context.pause_evidence(silence), !input.has_times)
    }

    /// Commits the frame that the fast path found at the first byte, and lets model and `recovery` learn from it; gives it out,
    /// `adu` gets its unit and PDU.
    #[inline]
    pub(super) fn commit_unambiguous_frame(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        length: FrameLength,
        adu: &mut Vec<u8>,
    ) -> FrameResult {
        let frame = &input.bytes()[..length.bytes()];
        self.last_was_damaged = false;
        self.learn_inner_pause(input, frame.len());
        let odds = self.fast_path_odds(input, context, 0, length);
        self.search.commit_fast_path_frame(context, input.bytes(), 0, length, odds);
        let direction = self.search.last_direction();
        self.recovery.truncation.learn_reaction(&mut self.search.model, context, frame, direction);
        let confidence = unambiguous_confidence(context, frame).min(confidence::of_direction(odds));
        // What ended a frame whose header does not announce just this length has to be found out (`delimited_by`).
        if !length.is_exact() {
            return self.emit_frame(input, context, length.bytes(), direction, confidence, adu);
        }
        copy_prefix(adu, input.bytes(), length.bytes() - CRC_BYTES);
        FrameResult { direction, confidence, ..FrameResult::new(Verdict::Ok, length.bytes(), DelimitedBy::Length) }
    }
}

/// The confidence of the unambiguous frame that begins like this.
#[inline]
fn unambiguous_confidence(context: &FramerContext<'_>, frame: &[u8]) -> u8 {
    confidence::of_unambiguous(Likeness::of_frame(context.functions, frame))
}
