//! Look-ahead in a recording: whether a frame that has begun will be complete can be looked up in the bytes behind it.
//!
//! So nothing is awaited that does not come, and no hypotheses pile up meanwhile. A frame that does come is awaited as on a
//! live line, and scored.

use std::ops::Range;

use crate::fast_path::frame_check::{FrameCheck, FrameLength};
use crate::framer::rtu::announced_length::announced_lengths;
use crate::framer::rtu::crc_scan::MAX_CANDIDATE_BYTES;
use crate::framer::rtu::search::commit::state::{Completion, Rival, RivalAt, RivalBar};
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::rtu::{header_score, score, side};
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights;
use modlens_protocol::checksum::{crc_valid_at, first_valid_length};
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

impl Search {
    /// As `find_rival_by_header`, for recordings: the unfinished frame must also come to an end, with a valid CRC, or damaged
    /// right behind a hypothesis. Where bytes are missing to tell, it counts, and `skip.needs_more_bytes` is set.
    ///
    /// Moves `skip.no_rival_before` behind the starts, from the first one on, at which no frame can be a rival of any path.
    pub(super) fn find_rival_by_lookahead(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        starts: Range<u64>,
        bar: RivalBar,
    ) -> Option<Rival> {
        let units = self.outstanding_units();
        let least_header = bar.least - self.max_path_score();
        let mut none_before = true;
        for start in starts.start.max(self.skip.no_rival_before)..starts.end {
            let bytes = &input.bytes()[(start - input.offset()) as usize..];
            if !self.cannot_exceed(context, bytes, start, least_header, &units) {
                match self.rival_at(input, context, start, bar) {
                    RivalAt::Found(rival) => return Some(rival),
                    RivalAt::NoneNow => none_before = false,
                    RivalAt::NeverAny => {}
                }
            }
            if none_before {
                self.skip.no_rival_before = start + 1;
            }
        }
        self.rival_behind_other_path(input, context, first, bar)
    }

    /// Whether an unfinished frame at stream offset `start` is a rival, behind any hypothesis. If it never completes, only
    /// hypotheses that end right there are tried, because only behind these a damaged frame is possible.
    fn rival_at(&mut self, input: &Input, context: &FramerContext<'_>, start: u64, bar: RivalBar) -> RivalAt {
        let never_completes = self.completion(input, context, start) == Completion::Never;
        let mut result = RivalAt::NeverAny;
        for parent in 0..self.lattice.len() {
            if never_completes && self.lattice[parent].end != start {
                continue;
            }
            if let Some(until) = self.will_outscore_until(input, context, parent, start, bar.now) {
                return RivalAt::Found(Rival { parent, start, until });
            }
            result = RivalAt::NoneNow;
        }
        result
    }

    /// A rival right behind a hypothesis of another path than that of the frame `first`: that path may be in the middle of its
    /// next frame, which can begin behind the starts that were tried.
    fn rival_behind_other_path(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        bar: RivalBar,
    ) -> Option<Rival> {
        (1..self.lattice.len()).find_map(|parent| {
            let Hypothesis { end: start, first_on_path, .. } = self.lattice[parent];
            if first_on_path == first {
                return None;
            }
            let until = self.will_outscore_until(input, context, parent, start, bar.now)?;
            Some(Rival { parent, start, until })
        })
    }

    /// As `may_outscore_until`, for recordings: `None` also for a frame that never comes to an end. `parent` is the index of the
    /// hypothesis behind which it begins, `start` its stream offset. Sets `skip.needs_more_bytes` where bytes are missing.
    pub(super) fn will_outscore_until(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        parent: usize,
        start: u64,
        bar: f32,
    ) -> Option<u64> {
        let behind = &self.lattice[parent];
        let until = self.may_outscore_until(input, context, behind, start, bar)?;
        // What comes with an invalid CRC has to be within the smaller margin for complete rivals, not that for look-ahead.
        let damaged_bar = bar + weights::LOOKAHEAD_MARGIN_BITS - weights::OFFLINE_COMMIT_MARGIN_BITS;
        let completion = match self.completion(input, context, start) {
            Completion::Never if start == behind.end => self.damaged_completion(input, context, behind, damaged_bar),
            completion => completion,
        };
        self.skip.needs_more_bytes |= completion == Completion::Unknown;
        (completion != Completion::Never).then_some(until)
    }

    /// Whether a frame that begins at stream offset `start` ends behind the last byte scanned with a valid CRC, in a length that
    /// its header admits, and before a break or a record's start. A length without announcement counts only where unit and
    /// function are familiar; where only a least length is announced, nothing is looked up.
    ///
    /// `Unknown` where bytes of one of these lengths, or of the header, have not come, unless the input is closed.
    pub(super) fn completion(&self, input: &Input, context: &FramerContext<'_>, start: u64) -> Completion {
        let at = (start - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        let scanned_length = (self.scanned_to - start) as usize;
        let max_length = max_frame_length(input, at);
        let unless_closed = if input.is_closed { Completion::Never } else { Completion::Unknown };
        if bytes.len() < 2 {
            return unless_closed;
        }
        let mut completion = Completion::Never;
        for (direction, extent) in announced_lengths(context, bytes).into_iter().flatten() {
            let (needed, completes) = match extent {
                Extent::Exactly(length) if length > max_length || length <= scanned_length => continue,
                Extent::Exactly(length) => (length, crc_valid_at(bytes, length)),
                Extent::AtLeast(length) if length > max_length => continue,
                Extent::AtLeast(_) => (max_length, false),
                Extent::Open(_) if !self.model.is_familiar(bytes[0], bytes[1], side::index_of(direction)) => continue,
                Extent::Open(_) => (max_length, has_valid_length(bytes, scanned_length + 1, max_length)),
            };
            if completes {
                return Completion::Completes;
            }
            if needed > bytes.len() {
                completion = unless_closed;
            }
        }
        completion
    }

    /// Whether a frame with an invalid CRC right behind this hypothesis ends behind the last byte scanned, exactly as long as it
    /// announces, and lifts the path's score above `bar` (bits). `Never` if its bytes have not all come, too.
    fn damaged_completion(&self, input: &Input, context: &FramerContext<'_>, behind: &Hypothesis, bar: f32) -> Completion {
        let at = (behind.end - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        if bytes.get(1).is_none_or(|code| code & EXCEPTION_BIT != 0) {
            return Completion::Never;
        }
        let (scanned_length, max_length) = ((self.scanned_to - behind.end) as usize, max_frame_length(input, at));
        let outstanding = behind.answerable.outstanding.map(|id| self.requests.get(id));
        let completes = |(direction, extent): (Direction, Extent)| match extent {
            Extent::Exactly(length) if length > scanned_length && length <= max_length.min(bytes.len()) => {
                let frame = &bytes[..length];
                let score = score::damaged_frame_score(&self.model, context, outstanding, frame, side::index_of(direction));
                score.is_some_and(|score| behind.path_score + score > bar)
            }
            _ => false,
        };
        if announced_lengths(context, bytes).into_iter().flatten().any(completes) {
            Completion::Completes
        } else {
            Completion::Never
        }
    }

    /// Whether any substring that begins right behind the root, of whatever length, ends behind stream offset `end` with a valid
    /// CRC, before a break or a record's start. `Unknown` is asked again; any other answer is kept for this root, whatever
    /// `end` is asked for later: bytes scanned since are in the lattice.
    pub(super) fn open_length_completion(&mut self, input: &Input, end: u64) -> Completion {
        let root_end = self.committed_offset();
        if let Some((_, completes)) = self.skip.open_length_completion.filter(|(root, _)| *root == root_end) {
            return if completes { Completion::Completes } else { Completion::Never };
        }
        let at = (root_end - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        let max_length = max_frame_length(input, at);
        let min_length = (end - root_end) as usize + 1;
        let completes = has_valid_length(bytes, min_length, max_length);
        if !completes && max_length > bytes.len() && !input.is_closed {
            return Completion::Unknown;
        }
        self.skip.open_length_completion = Some((root_end, completes));
        if completes {
            Completion::Completes
        } else {
            Completion::Never
        }
    }

    /// Whether a frame that begins in the first `stray_bytes` of the input may outscore the unambiguous frame of `length` bytes
    /// behind them: `Frame` if there is one, `NeedsMoreBytes` if it may still be completed. Only the fast path asks, in
    /// recordings.
    ///
    /// It is a rival if its header may lift its path to less than `STRAY_RIVAL_MARGIN_BITS` below a certain frame, or if its unit
    /// is known and its length is open, so that it may contain the unambiguous frame.
    pub fn rival_in_stray_bytes(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        stray_bytes: usize,
        length: usize,
    ) -> FrameCheck {
        for at in 0..stray_bytes {
            // Asked first, because nearly always no such frame is complete.
            let found = complete_frame_at(input, context, at, stray_bytes + length);
            let to_frame_end = &input.bytes()[at..stray_bytes + length];
            if !matches!(found, FrameCheck::NoFrame) && self.is_rival_header(context, at, to_frame_end) {
                return found;
            }
        }
        FrameCheck::NoFrame
    }

    /// Whether the header at index `at` of the stray bytes makes a frame there a rival of the unambiguous frame behind them.
    /// `to_frame_end` are the bytes from `at` on to the end of that frame.
    fn is_rival_header(&self, context: &FramerContext<'_>, at: usize, to_frame_end: &[u8]) -> bool {
        // What a frame of open length contains may look like a frame, even where its function is new to this line.
        let is_open = |of: Option<(Direction, Extent)>| matches!(of, Some((_, Extent::Open(_))));
        let is_known = context.known_units[usize::from(to_frame_end[0])];
        if is_known && announced_lengths(context, to_frame_end).into_iter().any(is_open) {
            return true;
        }
        let outstanding = self.lattice[ROOT].answerable.outstanding.map(|id| self.requests.get(id));
        let path_score = if at == 0 { weights::FRAME_DUE_BITS } else { 0.0 } - self.model.unframed_cost(at as u64);
        let header = header_score::header_bound(&self.model, context, outstanding, to_frame_end);
        let bar = weights::CERTAIN_FRAME_BITS - weights::STRAY_RIVAL_MARGIN_BITS;
        header.is_some_and(|header| path_score + header.bits > bar)
    }
}

/// Whether the CRC is valid in any length from `min_length` to `max_length`, both inclusive, as far as the bytes have come.
fn has_valid_length(bytes: &[u8], min_length: usize, max_length: usize) -> bool {
    first_valid_length(&bytes[..max_length.min(bytes.len())], min_length).is_some()
}

/// The most bytes that a frame at this index of the input can have: none crosses a break or a record's start.
fn max_frame_length(input: &Input, at: usize) -> usize {
    let rest = input.bytes().len() - at;
    let edge = input.boundary_after(at, at + rest.min(MAX_CANDIDATE_BYTES) - 1, input.break_ns);
    edge.map_or(MAX_CANDIDATE_BYTES, |edge| edge - at)
}

/// The frame with a valid CRC that begins at index `at` of the input, in a length that its header admits.
///
/// A length that the header leaves open counts only for a unit that took part in a sound frame (`known_units`), and only if the
/// frame ends at index `to` or behind it.
/// `NeedsMoreBytes` as soon as one admitted length cannot be judged yet.
fn complete_frame_at(input: &Input, context: &FramerContext<'_>, at: usize, to: usize) -> FrameCheck {
    let bytes = &input.bytes()[at..];
    let max_length = max_frame_length(input, at);
    for (_, extent) in announced_lengths(context, bytes).into_iter().flatten() {
        let (Extent::Exactly(length) | Extent::AtLeast(length) | Extent::Open(length)) = extent;
        let is_open = matches!(extent, Extent::Open(_));
        let needed = if is_open { max_length } else { length };
        if length > max_length || (is_open && !context.known_units[usize::from(bytes[0])]) {
            continue;
        }
        let found = match extent {
            Extent::Exactly(_) => crc_valid_at(bytes, length).then_some(length),
            Extent::AtLeast(_) => None,
            Extent::Open(_) => first_valid_length(&bytes[..max_length.min(bytes.len())], to - at),
        };
        match found {
            Some(length) => return FrameCheck::Frame(FrameLength::exactly(length)),
            None if needed > bytes.len() && !input.is_closed => return FrameCheck::NeedsMoreBytes,
            None => {}
        }
    }
    FrameCheck::NoFrame
}
