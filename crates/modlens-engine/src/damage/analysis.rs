//! Finds the damaged frames of a region: candidates, the best chain of them, and the fragments around it.

use crate::damage::candidates::Candidate;
use crate::damage::expected_frame::expected_frames;
use crate::damage::glitch::is_glitch;
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::damage::whole_answer::keep_answer_whole;
use crate::rtu_model::announced_length::EXCEPTION_RESPONSE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::prefix_index::PrefixFilter;
use crate::weights::{self, MAX_EXCEPTION_FLIPS, MAX_GLITCH_BYTES, MIN_DAMAGED_FRAME_BITS, SEARCHED_BYTES};
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::EXCEPTION_BIT;

/// The exception codes of the specification (application protocol, 7), and 7, which older devices send.
const EXCEPTION_CODES: [u8; 10] = [1, 2, 3, 4, 5, 6, 7, 8, 10, 11];

impl UnframedRegion<'_, '_> {
    /// The damaged frames of this region, in order, with indices that count from its first byte; all other bytes are noise.
    ///
    /// They are the chain of candidates (`chain_of_candidates`), in front of it the fragment that `leading_fragment` finds,
    /// after it what `explain_bytes_behind` makes of the rest, and the bursts where a frame is due (`add_due_bursts`).
    pub fn damaged_frames(&self) -> Vec<DamagedFrame> {
        if self.is_mere_glitch() {
            Vec::new()
        } else {
            self.damaged_frames_of_any()
        }
    }

    /// The same, whatever the region is.
    pub(super) fn damaged_frames_of_any(&self) -> Vec<DamagedFrame> {
        let mut frames = self.chain_of_candidates();
        // On a noisy line, only what is due shows which of the bytes in front are a frame.
        if self.has_few_strays() {
            self.add_leading_fragment(&mut frames);
        }
        self.explain_bytes_behind(&mut frames);
        self.add_due_bursts(&mut frames);
        if !self.has_few_strays() {
            self.add_leading_fragment(&mut frames);
        }
        self.find_damaged_exceptions(&mut frames);
        if !self.follows_damaged_frame {
            keep_answer_whole(self, &mut frames);
        }
        frames
    }

    /// Replaces frames that seem to lack bytes by exception responses to the outstanding request, if five bytes are such a
    /// response except for a few bits. Hardly any other five bytes are as close to one.
    ///
    /// The five bytes begin where the frame began or one byte earlier. They may include noise around the frame, but no byte of
    /// the frames before and after it.
    fn find_damaged_exceptions(&self, frames: &mut [DamagedFrame]) {
        let Some(request) = self.context.outstanding_request else { return };
        let mut free_from = 0;
        for index in 0..frames.len() {
            let free_to = frames.get(index + 1).map_or(self.length, |next| next.start);
            let frame = &mut frames[index];
            let starts = [frame.start, frame.start.saturating_sub(1)].into_iter();
            let free_starts = starts.filter(|&start| start >= free_from && start + EXCEPTION_RESPONSE_BYTES <= free_to);
            let head = [request.unit, request.pdu[0] | EXCEPTION_BIT];
            let mut exception_starts =
                free_starts.filter(|&start| is_nearly_exception(head, &self.bytes()[start..][..EXCEPTION_RESPONSE_BYTES]));
            if let Some(start) = exception_starts.next().filter(|_| frame.is_short) {
                let end = start + EXCEPTION_RESPONSE_BYTES;
                *frame = DamagedFrame {
                    start,
                    end,
                    direction: Direction::Response,
                    head: head.to_vec(),
                    is_short: false,
                    damage: None,
                    is_unidentified: false,
                    // Unit and function are taken from `head`, whether or not the wrong bits are in them.
                    wrong_head_bytes: head.len(),
                };
            }
            free_from = frame.end;
        }
    }

    /// Whether the region is what a line driver has left on a line where stray bytes are usual. Nothing else is found in so few
    /// bytes there, unless the recording begins with them or the line is one of two.
    pub(super) fn is_mere_glitch(&self) -> bool {
        let is_in_between = self.input.offset() > 0 && self.context.line_direction.is_none();
        is_in_between && !self.has_few_strays() && is_glitch(self.bytes())
    }

    /// Puts the fragment in front of these frames, if there is one (`leading_fragment`).
    fn add_leading_fragment(&self, frames: &mut Vec<DamagedFrame>) {
        let first_start = frames.first().map_or(self.length, |frame| frame.start);
        frames.splice(0..0, self.leading_fragment(first_start, frames.is_empty()));
    }

    /// The best chain of candidates; none where the bytes are too few.
    ///
    /// If the region is the entire input (somebody pasted one damaged frame), the frame starts at the first byte: a chain that
    /// starts later is discarded, unless only glitch bytes of a line driver precede it.
    fn chain_of_candidates(&self) -> Vec<DamagedFrame> {
        let mut frames = if self.is_too_short() { Vec::new() } else { self.best_chain(&self.all_candidates()) };
        if self.is_entire_input() && frames.first().is_some_and(|frame| !is_glitch(&self.bytes()[..frame.start])) {
            frames.clear();
        }
        frames
    }

    /// Says what the bytes after the last of `frames` are, by the first rule that fits. Without frames it does nothing.
    ///
    /// 1. They are its own rest, which came as late as the missing bytes would have taken (`resumes_after_loss`): it extends to
    ///    the region's end, and fewer bytes are missing, inside it and not at its end.
    /// 2. They show that it lost an unknown number of bytes at its end (`lost_bytes_behind`): it does not get longer.
    /// 3. They are the end of another frame (`trailing_fragment`): that is appended.
    ///
    /// If no rule fits, nothing is changed, and they will be noise.
    fn explain_bytes_behind(&self, frames: &mut Vec<DamagedFrame>) {
        match frames.last_mut() {
            Some(last) if self.is_one_burst_behind(last) && self.resumes_after_loss(last) => {
                let at = last.end - last.start;
                let count = match last.damage {
                    Some(DamageKind::LostBytes { count, .. }) => count + last.end - self.length,
                    _ => 0,
                };
                (last.end, last.damage) = (self.length, Some(DamageKind::LostBytes { at, count }));
            }
            Some(last) if self.lost_bytes_behind(last) => {
                let at = last.end - last.start;
                (last.is_short, last.damage) = (true, Some(DamageKind::LostBytes { at, count: 0 }));
            }
            _ => frames.extend(self.trailing_fragment(frames)),
        }
    }

    /// Whether so few bytes are left (at most `MAX_GLITCH_BYTES`) that no candidate can reach `MIN_DAMAGED_FRAME_BITS`.
    ///
    /// Their CRC cannot match, because they are fewer than any frame has. The bonus for ending at a frame boundary is
    /// smaller than the cost of the missing bytes, and the bonus for a preceding pause is smaller than the cost of
    /// choosing one of the expected frames. Glitch bytes of a line driver are never a unit and a function code.
    fn is_too_short(&self) -> bool {
        let max_bits = || self.model.bits_of(self.bytes()) + weights::PAUSE_BEFORE_BITS - weights::STRAY_BYTE_BITS;
        self.length <= MAX_GLITCH_BYTES && (is_glitch(self.bytes()) || max_bits() < MIN_DAMAGED_FRAME_BITS)
    }

    /// All candidates of the region, ordered by the index of their first byte.
    pub(super) fn all_candidates(&self) -> Vec<Candidate> {
        let expected = expected_frames(self);
        // Fails nearly everywhere; admits wherever the first or the second byte fits an expected frame, one whose first bytes
        // are missing included.
        let mut values = PrefixFilter::default();
        for frame in &expected {
            values.add(&frame.bytes, frame.most_missing(self.length));
        }
        let new_function_cost = self.model.least_cost_of_new_function();
        let delivers_flow_control = self.model.delivers_flow_control();
        let mut candidates = Vec::new();
        let searched_again_from = SEARCHED_BYTES.max(self.length.saturating_sub(SEARCHED_BYTES));
        for start in (0..SEARCHED_BYTES.min(self.length)).chain(searched_again_from..self.length) {
            let bytes = &self.bytes()[start..];
            if !expected.is_empty() && values.admits(bytes) {
                self.add_expected(&expected, start, &mut candidates);
            }
            self.add_familiar(start, new_function_cost, &mut candidates);
            if !delivers_flow_control {
                self.add_frames_lacking_flow_control_byte(start, &mut candidates);
            }
        }
        candidates
    }
}

/// Whether these five bytes are an exception response with this unit and function code but for a few bits.
fn is_nearly_exception([unit, code]: [u8; 2], bytes: &[u8]) -> bool {
    EXCEPTION_CODES.into_iter().any(|exception| {
        let content = [unit, code, exception];
        let sent = content.into_iter().chain(crc16(&content).to_le_bytes());
        let flips: u32 = sent.zip(bytes).map(|(sent, &byte)| (sent ^ byte).count_ones()).sum();
        flips <= MAX_EXCEPTION_FLIPS
    })
}
