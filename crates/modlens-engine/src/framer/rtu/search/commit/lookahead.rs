//! Look-ahead in a recording: whether a frame that has begun will be complete can be looked up in the bytes after it.
//!
//! So nothing is awaited that does not come, and no hypotheses pile up meanwhile. A frame that does come is awaited as on a
//! live line, and scored.

use std::ops::Range;

use crate::framer::rtu::frame_check::{FrameCheck, FrameLength};
use crate::framer::rtu::header_score;
use crate::framer::rtu::search::commit::frame_ahead::{has_valid_length, max_frame_length, FrameAhead};
use crate::framer::rtu::search::commit::rival::HeaderFilter;
use crate::framer::rtu::search::commit::state::{Completion, Rival, RivalAt, RivalBar};
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::{announced_lengths, EXCEPTION_RESPONSE_BYTES};
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use crate::rtu_model::side::REQUEST;
use crate::rtu_model::{score, side};
use crate::weights;
use modlens_protocol::checksum::{crc_valid_at, first_valid_length};
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

impl Search {
    /// The first unfinished frame that may outscore the frame `first` (an index of the lattice) in a recording: one that begins
    /// in `starts` (stream offsets, the end excluded) after any hypothesis, else one right after a frame of another path. It
    /// must also come to an end, with a valid CRC, or damaged right after a hypothesis. Where bytes are missing to tell, it
    /// counts, and `skip.needs_more_bytes` is set.
    ///
    /// Nearly no start can ever be a rival, whichever path it follows, and it is never looked at again: `skip.no_rival_before`
    /// moves on with each start that is no rival now, and those that may become one later are kept in `skip.open_starts`.
    pub(super) fn find_rival_by_lookahead(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        starts: Range<u64>,
        bar: RivalBar,
    ) -> Option<Rival> {
        let filter = self.header_filter(bar);
        let mut open_starts = std::mem::take(&mut self.skip.open_starts);
        let mut found = None;
        open_starts.retain(|&start| {
            if found.is_some() || start >= starts.end {
                return true;
            }
            let result = if start < starts.start { RivalAt::Never } else { self.rival_at(input, context, start, bar, &filter) };
            found = if let RivalAt::Found(rival) = result { Some(rival) } else { None };
            !matches!(result, RivalAt::Never)
        });
        let unseen = if found.is_some() { 0..0 } else { starts.start.max(self.skip.no_rival_before)..starts.end };
        for start in unseen {
            // Said at once for most starts, for which `rival_at` would say it as well.
            let ends_within_scanned = |ahead: FrameAhead<'_>| ahead.bytes.len() >= 2 && self.ends_within_scanned(context, &ahead);
            if !filter.may_be_due_at(start) && ends_within_scanned(self.frame_ahead(input, start)) {
                self.skip.no_rival_before = start + 1;
                continue;
            }
            match self.rival_at(input, context, start, bar, &filter) {
                RivalAt::Found(rival) => {
                    found = Some(rival);
                    break;
                }
                RivalAt::NotNow => open_starts.push(start),
                RivalAt::Never => {}
            }
            self.skip.no_rival_before = start + 1;
        }
        self.skip.open_starts = open_starts;
        found.or_else(|| self.rival_behind_other_path(input, context, first, bar))
    }

    /// Whether an unfinished frame at stream offset `start` is a rival, after any hypothesis. If it never completes, only
    /// hypotheses that end right there are tried, because only after these a damaged frame is possible.
    fn rival_at(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        start: u64,
        bar: RivalBar,
        filter: &HeaderFilter,
    ) -> RivalAt {
        let bytes = &input.bytes()[(start - input.offset()) as usize..];
        if !self.may_exceed(context, bytes, start, filter) {
            return RivalAt::Never;
        }
        let completion = self.completion(input, context, start);
        let never_completes = completion == Completion::Never;
        if never_completes && !(filter.may_be_due_at(start) && self.is_due_at(start)) {
            return RivalAt::Never;
        }
        let mut result = RivalAt::Never;
        for parent in 0..self.lattice.len() {
            if never_completes && self.lattice[parent].end != start {
                continue;
            }
            if let Some(until) = self.rival_until(input, context, (parent, start), bar.now, Some(completion)) {
                return RivalAt::Found(Rival { parent, start, until });
            }
            result = RivalAt::NotNow;
        }
        result
    }

    /// A rival right after a hypothesis of another path than that of the frame `first`: that path may be in the middle of its
    /// next frame, which can begin after the starts that were tried.
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
            let until = self.rival_until_by_lookahead(input, context, parent, start, bar.now)?;
            Some(Rival { parent, start, until })
        })
    }

    /// As `rival_until_by_header`, for recordings: `None` also for a frame that never comes to an end. `parent` is the index of
    /// the hypothesis after which it begins, `start` its stream offset. Sets `skip.needs_more_bytes` where bytes are missing.
    pub(super) fn rival_until_by_lookahead(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        parent: usize,
        start: u64,
        bar: f32,
    ) -> Option<u64> {
        self.rival_until(input, context, (parent, start), bar, None)
    }

    /// `rival_until_by_lookahead`, where it may be known already whether the frame comes to an end with a valid CRC.
    fn rival_until(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        (parent, start): (usize, u64),
        bar: f32,
        completion: Option<Completion>,
    ) -> Option<u64> {
        // Most paths are before bytes that begin no frame, neither a whole one nor a damaged one.
        let ahead = self.frame_ahead(input, start);
        if completion.is_none() && ahead.bytes.len() >= 2 && self.ends_within_scanned(context, &ahead) {
            return None;
        }
        let until = self.rival_until_by_header(input, context, &self.lattice[parent], start, bar)?;
        // What comes with an invalid CRC has to be within the smaller margin for complete rivals, not that for look-ahead.
        let damaged_bar = bar + weights::LOOKAHEAD_MARGIN_BITS - weights::OFFLINE_COMMIT_MARGIN_BITS;
        let completion = match completion.unwrap_or_else(|| self.completion(input, context, start)) {
            Completion::Never if start == self.lattice[parent].end => {
                self.damaged_completion(input, context, &self.lattice[parent], damaged_bar)
            }
            completion => completion,
        };
        self.skip.needs_more_bytes |= completion == Completion::Unknown;
        (completion != Completion::Never).then_some(until)
    }

    /// Whether a frame that begins at stream offset `start` ends after the last byte scanned with a valid CRC, in a length that
    /// its header admits, and before a break or a record's start (`FrameAhead`). A length without announcement counts only
    /// where unit and function are familiar. Where the bytes that give the length have not come (`Extent::AtLeast`), no CRC is
    /// computed and the answer is `Unknown`.
    ///
    /// `Unknown` where bytes of one of these lengths, or of the header, have not come, unless the input is closed.
    pub(super) fn completion(&self, input: &Input, context: &FramerContext<'_>, start: u64) -> Completion {
        let if_bytes_missing = if input.is_closed { Completion::Never } else { Completion::Unknown };
        let ahead = self.frame_ahead(input, start);
        let &[unit, code, ..] = ahead.bytes else { return if_bytes_missing };
        if self.ends_within_scanned(context, &ahead) {
            return Completion::Never;
        }
        let mut completion = Completion::Never;
        for (direction, extent) in announced_lengths(context, ahead.bytes).into_iter().flatten() {
            let result = match extent {
                Extent::Open(_) if !self.model.is_familiar(unit, code, side::index_of(direction)) => Completion::Never,
                Extent::Open(_) => ahead.look_up_open(),
                Extent::Exactly(_) | Extent::AtLeast(_) => ahead.look_up(extent),
            };
            match result {
                Completion::Completes => return Completion::Completes,
                Completion::Unknown => completion = if_bytes_missing,
                Completion::Never => {}
            }
        }
        completion
    }

    /// Whether the function code alone shows that no frame reaches beyond the bytes scanned: it is an exception response
    /// whose five bytes are all scanned, or a function code without a layout that is not familiar as a request. Most bytes are one
    /// of the two.
    #[inline]
    fn ends_within_scanned(&self, context: &FramerContext<'_>, ahead: &FrameAhead<'_>) -> bool {
        let (unit, code) = (ahead.bytes[0], ahead.bytes[1]);
        if code & EXCEPTION_BIT != 0 {
            return ahead.scanned_length >= EXCEPTION_RESPONSE_BYTES;
        }
        context.functions.row(code, &ahead.bytes[2..]).is_none() && !self.model.is_familiar(unit, code, REQUEST)
    }

    /// The bytes from stream offset `start` on, which a frame may have.
    #[inline]
    fn frame_ahead<'a>(&self, input: &'a Input, start: u64) -> FrameAhead<'a> {
        let at = (start - input.offset()) as usize;
        FrameAhead { bytes: &input.bytes()[at..], scanned_length: (self.scanned_to - start) as usize, input, at }
    }

    /// Whether a frame with an invalid CRC right after this hypothesis ends after the last byte scanned, exactly as long as it
    /// announces, and lifts the path's score above `bar` (bits). `Never` as well, for an exception response, and if its bytes
    /// have not all come.
    fn damaged_completion(&self, input: &Input, context: &FramerContext<'_>, behind: &Hypothesis, bar: f32) -> Completion {
        let ahead = self.frame_ahead(input, behind.end);
        if ahead.bytes.get(1).is_none_or(|code| code & EXCEPTION_BIT != 0) {
            return Completion::Never;
        }
        let outstanding = behind.answerable.outstanding.map(|id| self.requests.get(id));
        let exceeds_bar = |(direction, extent): (Direction, Extent)| {
            let frame = ahead.of_exact_length(extent)?;
            let score = score::damaged_frame_score(&self.model, context, outstanding, frame, side::index_of(direction))?;
            (behind.path_score + score > bar).then_some(())
        };
        Completion::if_found(announced_lengths(context, ahead.bytes).into_iter().flatten().find_map(exceeds_bar).is_some())
    }

    /// Whether any substring that begins right after the root, of whatever length, ends after stream offset `end` with a valid
    /// CRC, before a break or a record's start. `Unknown` is asked again; any other answer is kept for this root, whatever
    /// `end` is asked for later: bytes scanned since are in the lattice.
    pub(super) fn open_length_completion(&mut self, input: &Input, end: u64) -> Completion {
        let root_end = self.committed_offset();
        if let Some((_, completes)) = self.skip.open_length_completion.filter(|(root, _)| *root == root_end) {
            return Completion::if_found(completes);
        }
        let ahead = self.frame_ahead(input, root_end);
        let min_length = (end - root_end) as usize + 1;
        let max_length = ahead.max_length();
        let completes = has_valid_length(ahead.bytes, min_length, max_length);
        if !completes && max_length > ahead.bytes.len() && !input.is_closed {
            return Completion::Unknown;
        }
        self.skip.open_length_completion = Some((root_end, completes));
        Completion::if_found(completes)
    }

    /// Whether a frame that begins in the first `stray_bytes` of the input may outscore the unambiguous frame of `length` bytes
    /// after them: `Frame` if there is one, `NeedsMoreBytes` if it may still be completed. Only the fast path asks, in
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

    /// Whether the header at index `at` of the stray bytes makes a frame there a rival of the unambiguous frame after them.
    /// `to_frame_end` are the bytes from `at` on to the end of that frame.
    fn is_rival_header(&self, context: &FramerContext<'_>, at: usize, to_frame_end: &[u8]) -> bool {
        // What a frame of open length contains may look like a frame, even where its function is new to this line.
        let is_open = |frame: Option<(Direction, Extent)>| matches!(frame, Some((_, Extent::Open(_))));
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

/// The frame with a valid CRC that begins at index `at` of the input, in a length that its header admits. `at` is less than the
/// number of bytes in the input by two at least.
///
/// A length that the header leaves open counts only for a unit that took part in a sound frame (`known_units`), and only if the
/// frame ends at index `to` (its end excluded) or after it; a least length is not looked up. `NeedsMoreBytes` as soon as one
/// admitted length cannot be judged yet.
fn complete_frame_at(input: &Input, context: &FramerContext<'_>, at: usize, to: usize) -> FrameCheck {
    let bytes = &input.bytes()[at..];
    let is_known = context.known_units[usize::from(bytes[0])];
    // Nearly all bytes are function codes of no such frame.
    if !is_known && bytes[1] & EXCEPTION_BIT == 0 && context.functions.row(bytes[1], &bytes[2..]).is_none() {
        return FrameCheck::NoFrame;
    }
    for (_, extent) in announced_lengths(context, bytes).into_iter().flatten() {
        // Nearly always no such frame is there, and where the boundaries are does not matter.
        let is_out_of_question = match extent {
            Extent::Open(_) => !is_known,
            Extent::Exactly(length) if length > MAX_CANDIDATE_BYTES => true,
            Extent::Exactly(length) => length <= bytes.len() && !crc_valid_at(bytes, length),
            Extent::AtLeast(_) => false,
        };
        if is_out_of_question {
            continue;
        }
        let max_length = max_frame_length(input, at);
        let (found, needed) = match extent {
            Extent::Exactly(length) | Extent::AtLeast(length) | Extent::Open(length) if length > max_length => continue,
            Extent::Open(_) => (first_valid_length(&bytes[..max_length.min(bytes.len())], to - at), max_length),
            Extent::Exactly(length) => (crc_valid_at(bytes, length).then_some(length), length),
            // As in `look_up`: the bytes that tell the length have not come.
            Extent::AtLeast(length) => (None, length),
        };
        match found {
            Some(length) => return FrameCheck::Frame(FrameLength::exactly(length)),
            None if needed > bytes.len() && !input.is_closed => return FrameCheck::NeedsMoreBytes,
            None => {}
        }
    }
    FrameCheck::NoFrame
}
