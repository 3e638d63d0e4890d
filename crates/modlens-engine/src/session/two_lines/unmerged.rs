//! Frames of two lines without a clock, until their order is known.
//!
//! Each line is framed by itself. Its frames wait here until `merge_order` has found their place among those of the other
//! line.

use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::session::bus::{declared_direction, BusState};
use crate::session::line::{add_vote, LineState};
use crate::session::two_lines::alignment::{merge_order, LineFrame};
use crate::weights;
use modlens_protocol::direction::{possible_directions, Direction};
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::Functions;

/// A line that stays silent while the other one delivers so many bytes is silent for good: waiting for it ends.
const MAX_WAITING_BYTES: usize = 16 << 20;

impl LineState {
    /// The bytes from the next frame to emit on.
    pub(in crate::session) fn emission_input(&self) -> &Input {
        self.unmerged.as_ref().map_or(&self.input, |unmerged| &unmerged.input)
    }

    /// Removes the bytes of a frame that was emitted.
    pub(in crate::session) fn consume(&mut self, length: usize) {
        match &mut self.unmerged {
            Some(unmerged) => unmerged.input.consume(length),
            None => self.input.consume(length),
        }
    }

    /// Finds one more frame (or noise) in the bytes that have come, unless the window is full; says whether there was one. It
    /// is taken out of the line's own input and waits in `unmerged`, whose input still has its bytes. A good one votes on who
    /// speaks on this line. `false` for a line whose frames do not wait.
    fn queue_frame(&mut self, context: &FramerContext<'_>) -> bool {
        let Self { unmerged: Some(unmerged), input, framer, request_votes, .. } = self else { return false };
        if unmerged.frames.len() >= weights::WIDE_WINDOW_FRAMES || input.bytes().is_empty() {
            return false;
        }
        let mut adu = Vec::new();
        let Some(result) = framer.next(input, context, &mut adu) else { return false };
        input.consume(result.length);
        let adu = if result.verdict == Verdict::Noise { Vec::new() } else { adu };
        let is_good = result.verdict.is_good();
        if is_good {
            *request_votes = add_vote(*request_votes, context.functions, &adu);
        }
        unmerged.frames.push_back(LineFrame { direction: result.direction, is_good, adu });
        unmerged.results.push_back(result);
        true
    }

    /// Assigns waiting frames that either side may send to the one that, as is known by now, speaks on this line. Frames that
    /// only the other side can send keep their direction.
    fn assign_ambiguous_to(&mut self, functions: &Functions, speaker: Direction) {
        let Some(unmerged) = &mut self.unmerged else { return };
        for (result, frame) in unmerged.results.iter_mut().zip(&mut unmerged.frames) {
            if frame.adu.len() > 1
                && result.direction != speaker
                && possible_directions(functions, &frame.adu[1..]) == (true, true)
            {
                (result.direction, frame.direction) = (speaker, speaker);
            }
        }
    }

    /// The next waiting frame of this line; `adu` gets its unit and PDU.
    fn pop_unmerged(&mut self, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let unmerged = self.unmerged.as_mut()?;
        *adu = unmerged.frames.pop_front()?.adu;
        unmerged.results.pop_front()
    }

    /// Whether the window is full, or nothing can come any more that would fill it.
    fn is_window_complete(&self) -> bool {
        let is_full = self.unmerged.as_ref().is_some_and(|unmerged| unmerged.frames.len() >= weights::WIDE_WINDOW_FRAMES);
        is_full || (self.input.is_ended && self.input.bytes().is_empty())
    }
}

/// Two lines without a clock: their frames wait, unmerged, until the order is inferred from their content.
impl BusState {
    /// The next frame of two lines without a clock, as `next_frame` gives it. Each time the frames ordered so far are used up,
    /// both lines are framed as far as their bytes and the window go; frames that either side may send are assigned to the one
    /// that speaks on their line, if that is known; then the order of the frames found is inferred. `None` while the order is
    /// open because the window is not full and more bytes may come.
    pub(in crate::session) fn next_frame_without_clock(
        &mut self,
        functions: &Functions,
        live: bool,
        adu: &mut Vec<u8>,
    ) -> Option<(usize, FrameResult)> {
        if self.merged_order.is_empty() {
            self.frame_lines_in_turn(functions, live);
            for at in 0..self.lines.len() {
                if let Some(speaker) = self.speaker(at) {
                    self.lines[at].1.assign_ambiguous_to(functions, speaker);
                }
            }
            self.merged_order = infer_line_order(functions, &mut self.lines).into();
        }
        let at = self.merged_order.pop_front()?;
        Some((at, self.lines[at].1.pop_unmerged(adu)?))
    }

    /// Frames the bytes of all lines in turn, a frame each, until none yields a further one: so what one line shows of who
    /// speaks on it (`speaker`) helps the other from its first frames on. No outstanding request and no silence is given as
    /// evidence, as pairing has not seen these frames yet and there is no clock.
    fn frame_lines_in_turn(&mut self, functions: &Functions, live: bool) {
        let mut at = 0;
        let mut lines_without_frame = 0;
        while lines_without_frame < self.lines.len() {
            let context = FramerContext {
                may_look_ahead: !live,
                is_multi_line: true,
                line_direction: self.speaker(at),
                paired_units: &self.paired_units,
                declared_direction: &|side| declared_direction(self.side_votes, side),
                ..FramerContext::without_clock(functions, &self.known_units)
            };
            let has_frame = self.lines[at].1.queue_frame(&context);
            lines_without_frame = if has_frame { 0 } else { lines_without_frame + 1 };
            at = (at + 1) % self.lines.len();
        }
    }
}

/// The lines of the next frames, as indices into `lines`; empty while more frames of one line must be known first: until the
/// window of each line is full or its recording has ended, or until one line has delivered 16 MiB that do not fit in its
/// window.
///
/// If a line has room in its window, or the wait was given up, `merge_order` takes what waits for all that there is.
fn infer_line_order(functions: &Functions, lines: &mut [(u8, LineState)]) -> Vec<usize> {
    let has_waited_enough = lines.iter().any(|(_, line)| line.input.bytes().len() > MAX_WAITING_BYTES);
    let is_over = lines.iter().all(|(_, line)| line.input.is_ended && line.input.bytes().is_empty());
    let lacks_second_line = lines.len() < 2 && !is_over;
    if !has_waited_enough && (lacks_second_line || !lines.iter().all(|(_, line)| line.is_window_complete())) {
        return Vec::new();
    }
    let has_room =
        |line: &LineState| line.unmerged.as_ref().is_some_and(|unmerged| unmerged.frames.len() < weights::WIDE_WINDOW_FRAMES);
    let is_complete = has_waited_enough || lines.iter().any(|(_, line)| has_room(line));
    let mut frames = lines.iter_mut().map(|(_, line)| line.unmerged.as_mut().map(|unmerged| &*unmerged.frames.make_contiguous()));
    let (first, second) = (frames.next().flatten().unwrap_or(&[]), frames.next().flatten().unwrap_or(&[]));
    merge_order(functions, [first, second], is_complete)
}
