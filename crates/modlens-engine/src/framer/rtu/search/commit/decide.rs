//! Determines the state of the first frame of the best path, and commits it when it is final.

use std::ops::Range;

use crate::framer::rtu::search::commit::state::{CommitState, Completion, Decision, Rival, RivalBar};
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::lattice::first_decision_behind;
use crate::framer::rtu::search::nested::Contents;
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::announced_lengths;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_SPAN;
use crate::weights;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::Extent;

impl Search {
    /// Commits the first frame of the best path, or unframed bytes where that path has no frame. `None` if neither is final: then
    /// `skip.next_decision_at` is the stream offset from which on it has to be asked again.
    ///
    /// `is_closed`: no byte after the last one scanned can belong to a frame before it. Then something is always committed.
    pub(in crate::framer::rtu::search) fn decide(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        is_closed: bool,
    ) -> Option<Decision> {
        self.skip.needs_more_bytes = false;
        let (path_end, score) = if is_closed { self.best_path_before_silence() } else { self.best_path() };
        let first = self.lattice[path_end].first_on_path;
        let state = match first {
            ROOT => self.unframed_state(is_closed),
            _ if is_closed => CommitState::Final,
            _ => self.frame_state(input, context, path_end, score),
        };
        match state.wait() {
            Some((until, only_new_hypothesis_matters)) => {
                let stays_unframed = first == ROOT && self.root_leads_for_good(score);
                let may_change_at_once = !only_new_hypothesis_matters && !stays_unframed && self.is_order_settling();
                self.skip.next_decision_at = if may_change_at_once { 0 } else { until };
                None
            }
            None if first == ROOT => Some(self.commit_unframed_piece(input, is_closed)),
            None => Some(self.commit_frame(input, context, (path_end, score), is_closed)),
        }
    }

    /// Whether the order of paths may change with each byte: while the cost of the bytes after the latest hypothesis grows.
    fn is_order_settling(&self) -> bool {
        let last = &self.lattice[self.lattice.len() - 1];
        self.lattice.len() > 1 && self.scanned_to < last.end + weights::SETTLED_BEHIND_BYTES
    }

    /// Whether the path without a frame, the best one now with this score, stays the best one while the hypotheses are the same.
    /// All others have ended later, so bytes after them cost them no less from here on than they cost this one.
    ///
    /// Where noise has made so many hypotheses that they are pruned, they do not stay the same.
    fn root_leads_for_good(&self, score: f32) -> bool {
        let mut others = self.lattice[ROOT + 1..].iter();
        let falls_behind = |other: &Hypothesis| score > self.current_score(other) + weights::ROUNDING_BITS;
        self.lattice.len() < 2 * weights::BEAM_HYPOTHESES && others.all(falls_behind)
    }

    /// The state while the best path has no frame: final if closed, or if no frame can begin any more in the first block of
    /// unframed bytes (`UNFRAMED_PIECE_BYTES`). Prunes the lattice where noise has made many hypotheses.
    fn unframed_state(&mut self, is_closed: bool) -> CommitState {
        // A frame that begins in the block ends before this offset.
        let until = first_decision_behind(self.committed_offset());
        if is_closed || self.scanned_to >= until {
            return CommitState::Final;
        }
        if self.lattice.len() >= 2 * weights::BEAM_HYPOTHESES {
            self.prune();
        }
        CommitState::Unframed { until }
    }

    /// The state of the first frame of the best path, while the line is not closed; `path_end` is the index of the last frame
    /// of that path, `score` its score in bits with the bytes after it. The checks come in the order of the drawing in
    /// `commit`.
    ///
    /// Sets `skip.needs_more_bytes` where a look-ahead in a recording cannot tell yet.
    fn frame_state(&mut self, input: &Input, context: &FramerContext<'_>, path_end: usize, score: f32) -> CommitState {
        let first = self.lattice[path_end].first_on_path;
        let end = self.lattice[first].end;
        let patience = if context.may_look_ahead { weights::OFFLINE_TIE_PATIENCE_BYTES } else { weights::TIE_PATIENCE_BYTES };
        // More bytes will not tell these hypotheses apart, or there are too many of them.
        if self.scanned_to >= end + patience || self.lattice.len() >= weights::MAX_HYPOTHESES {
            return CommitState::Final;
        }
        if let Some(rival_end) = self.first_rival_end(context, first, score) {
            // A rival whose last frame ends no later than the best path's pays no more for any further byte, so it does not
            // fall further back until a new hypothesis is found.
            let has_constant_distance = rival_end <= self.lattice[path_end].end;
            return CommitState::Contested { until: end + patience, has_constant_distance };
        }
        // No frame that begins before `end` reaches further.
        let max_rival_end = end + MAX_CANDIDATE_SPAN;
        if self.scanned_to >= max_rival_end {
            return CommitState::Final;
        }
        self.state_without_complete_rival(input, context, path_end, score, max_rival_end)
    }

    /// The state of the first frame of the best path while no complete rival is within the margin of `first_rival_end`.
    /// `path_end` is the index of the last frame of that path, `score` its score in bits with the bytes after it. No unfinished
    /// frame that may be a rival, because it begins before that first frame ends, reaches after stream offset `max_rival_end`,
    /// which is not scanned yet.
    ///
    /// What look-aheads find out is kept in `skip`, so that the next call need not ask again: the last rival, the starts without
    /// one, the answer on an open length. `skip.needs_more_bytes` is set where one of them (of an outer frame, or of a rival)
    /// lacks bytes to tell. None of this changes a later answer.
    fn state_without_complete_rival(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        path_end: usize,
        score: f32,
        max_rival_end: u64,
    ) -> CommitState {
        let first = self.lattice[path_end].first_on_path;
        let Hypothesis { start, end, is_crc_valid, .. } = self.lattice[first];
        if let Some(until) = self.nested_until(input, context, start, end).filter(|&until| self.scanned_to < until) {
            return CommitState::Nested { until };
        }
        let has_successor = first != path_end;
        if !has_successor && (!is_crc_valid || self.has_unclear_direction(input, context, first, score)) {
            return CommitState::AwaitsSuccessor { until: max_rival_end };
        }
        let bar = self.rival_bar(context, path_end, score);
        match self.overtakable_until(input, context, first, bar) {
            Some(until) => CommitState::Overtakable { until: until.min(max_rival_end) },
            None => CommitState::Final,
        }
    }

    /// The rivals of the frame `first` are the paths with another first frame whose score is less than the margin
    /// (`COMMIT_MARGIN_BITS`, in a recording `OFFLINE_COMMIT_MARGIN_BITS`) below `score`, that of the best path. The stream
    /// offset after the last frame of a rival, the least of all rivals; `None` if there are no rivals. The root counts as one:
    /// the path on which all bytes are unframed.
    fn first_rival_end(&self, context: &FramerContext<'_>, first: usize, score: f32) -> Option<u64> {
        let margin = if context.may_look_ahead { weights::OFFLINE_COMMIT_MARGIN_BITS } else { weights::COMMIT_MARGIN_BITS };
        let is_rival = |path: &&Hypothesis| path.first_on_path != first && self.current_score(path) > score - margin;
        self.lattice.iter().filter(is_rival).map(|rival| rival.end).min()
    }

    /// Whether nothing reports the direction of the frame `first` but what follows: there is no clock, or a silence that reports
    /// nothing (log-odds of 0), the line may carry both directions, and the same bytes in the other direction lead a path within
    /// `OPPOSITE_DIRECTION_MARGIN_BITS` of the best one, whose score is given.
    fn has_unclear_direction(&self, input: &Input, context: &FramerContext<'_>, first: usize, score: f32) -> bool {
        let index = (self.lattice[first].start - input.offset()) as usize;
        (context.timeout_log_odds)(input.pause_before(index)) == 0.0
            && context.line_direction.is_none()
            && self.has_opposite_rival(first, score - weights::OPPOSITE_DIRECTION_MARGIN_BITS)
    }

    /// What an unfinished frame has to exceed: the score of the best path (that ends with the frame `path_end`) less the margin
    /// (`COMMIT_MARGIN_BITS`, in a recording `LOOKAHEAD_MARGIN_BITS`), `now` as that path scores, and `least` once it has paid
    /// all that bytes after its last frame can cost.
    fn rival_bar(&self, context: &FramerContext<'_>, path_end: usize, score: f32) -> RivalBar {
        let unframed = self.scanned_to - self.lattice[path_end].end;
        let further_cost =
            self.model.open_unframed_cost(unframed.max(weights::SETTLED_BEHIND_BYTES)) - self.model.open_unframed_cost(unframed);
        let now = score - if context.may_look_ahead { weights::LOOKAHEAD_MARGIN_BITS } else { weights::COMMIT_MARGIN_BITS };
        RivalBar { now, least: now - further_cost - weights::ROUNDING_BITS }
    }

    /// The stream offset up to which the frame from `start` to `end` (stream offsets) may turn out to be inside a longer one
    /// that begins right after the root, or after a few stray bytes there; `None` if it does not. The offset may be scanned
    /// already: then it decides nothing. A frame after a pause is in no other one.
    fn nested_until(&mut self, input: &Input, context: &FramerContext<'_>, start: u64, end: u64) -> Option<u64> {
        let root_end = self.committed_offset();
        let pause = input.pause_before((start - input.offset()) as usize);
        if pause.is_some_and(|pause| pause >= self.frame_gap_ns) {
            return None;
        }
        let outer_starts = root_end..=root_end + weights::MAX_SKIPPED_STRAY_BYTES as u64;
        let outer_starts = outer_starts.filter(|outer| outer + weights::MIN_OUTER_HEADER_BYTES <= start);
        outer_starts.filter_map(|outer_start| self.nested_in_until(input, context, outer_start, end)).max()
    }

    /// The stream offset up to which the frame that ends at `end` may turn out to be inside a longer one that begins at
    /// `outer_start` (both are stream offsets); `None` if it does not. After stray bytes the unit of the longer frame has to be
    /// known; right after the root its unit, or what its function contains.
    ///
    /// Live, every length that counts (`may_contain_in`) is awaited; in a recording, only where the frame completes, or where
    /// that is not known yet (`skip.needs_more_bytes` is set then).
    fn nested_in_until(&mut self, input: &Input, context: &FramerContext<'_>, outer_start: u64, end: u64) -> Option<u64> {
        let outer = &input.bytes()[(outer_start - input.offset()) as usize..];
        let is_due = outer_start == self.committed_offset();
        let contents = self.contents(context, outer);
        if !self.model.has_unit(outer[0]) && (!is_due || contents.is_none()) {
            return None;
        }
        let mut until = None;
        for (direction, extent) in announced_lengths(context, outer).into_iter().flatten() {
            if self.may_contain_in(outer, is_due, contents, direction, extent) {
                let completion = self.outer_completion(input, context, outer_start, end, extent);
                self.skip.needs_more_bytes |= completion == Completion::Unknown;
                let awaited_to = (completion != Completion::Never).then(|| outer_start + span_of(extent));
                until = until.max(awaited_to);
            }
        }
        until
    }

    /// Whether a longer frame from stream offset `outer_start` on, whose header announces this length, will be complete: live it
    /// is taken for granted. With an open length it has to end after stream offset `end`.
    fn outer_completion(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        outer_start: u64,
        end: u64,
        extent: Extent,
    ) -> Completion {
        match extent {
            _ if !context.may_look_ahead => Completion::Completes,
            Extent::Open(_) => self.open_length_completion(input, end),
            Extent::Exactly(_) | Extent::AtLeast(_) => self.completion(input, context, outer_start),
        }
    }

    /// Whether a frame that begins with the bytes `outer`, in this direction and with this announced length, may contain others:
    /// with an open length right after the root (`is_due`); with an exact one if the payload of its function is copied, or
    /// if it is the response to the outstanding request and was read. A least length does not count.
    fn may_contain_in(
        &self,
        outer: &[u8],
        is_due: bool,
        contents: Option<Contents>,
        direction: Direction,
        extent: Extent,
    ) -> bool {
        match (extent, contents) {
            (Extent::Open(_), _) => is_due,
            (Extent::AtLeast(_), _) | (Extent::Exactly(_), None) => false,
            (Extent::Exactly(_), Some(Contents::Copied)) => true,
            (Extent::Exactly(_), Some(Contents::Read)) => {
                direction == Direction::Response && is_due && self.is_due_response(outer)
            }
        }
    }

    /// Whether a response that begins like this would answer the outstanding request.
    fn is_due_response(&self, frame: &[u8]) -> bool {
        self.outstanding_request().is_some_and(|request| request.matches(frame[0], frame[1]))
    }

    /// The stream offset up to which an unfinished frame may still outscore the frame `first` (an index of the lattice); `None`
    /// if none can. It has begun in `rival_starts`, or right after a frame of another path.
    ///
    /// The rival is kept in `skip.last_rival` and asked first the next time: what was possible a byte ago mostly still is.
    fn overtakable_until(&mut self, input: &Input, context: &FramerContext<'_>, first: usize, bar: RivalBar) -> Option<u64> {
        let starts = self.rival_starts(context, first)?;
        let last_rival = self.skip.last_rival.take();
        let known = last_rival.and_then(|rival| self.check_rival_again(input, context, first, &starts, bar, rival));
        let found = match known {
            None if context.may_look_ahead => self.find_rival_by_lookahead(input, context, first, starts, bar),
            None => self.find_rival_by_header(input, context, first, starts, bar),
            known => known,
        };
        self.skip.last_rival = found;
        found.map(|rival| rival.until.min(rival.start + MAX_CANDIDATE_SPAN + 1))
    }

    /// The stream offsets (the end excluded) at which an unfinished frame that outscores the frame `first` may have begun: from
    /// the root on, as far back as a frame is long, before the end of `first`. A frame that begins inside a certain one
    /// (`CERTAIN_FRAME_BITS`) does not outscore it: in a recording, they end at the start of a certain one.
    ///
    /// `None` if `first` is certain and begins right after the root. After stray bytes, it may itself are inside a longer
    /// frame.
    fn rival_starts(&self, context: &FramerContext<'_>, first: usize) -> Option<Range<u64>> {
        let frame = &self.lattice[first];
        let is_certain = frame.frame_score >= weights::CERTAIN_FRAME_BITS;
        if is_certain && frame.start == self.committed_offset() {
            return None;
        }
        let starts_end = if is_certain && context.may_look_ahead { frame.start } else { frame.end };
        Some(self.committed_offset().max(self.scanned_to.saturating_sub(MAX_CANDIDATE_SPAN))..starts_end)
    }

    /// The rival found last, with the offset up to which it may now outscore `first`; `None` if it is none any more, or begins
    /// neither in `starts` nor right after a frame of another path.
    fn check_rival_again(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        starts: &Range<u64>,
        bar: RivalBar,
        Rival { parent, start, .. }: Rival,
    ) -> Option<Rival> {
        let behind = &self.lattice[parent];
        let continues_other_path = start == behind.end && parent != ROOT && behind.first_on_path != first;
        let until = match starts.contains(&start) || continues_other_path {
            true if context.may_look_ahead => self.rival_until_by_lookahead(input, context, parent, start, bar.now),
            true => self.rival_until_by_header(input, context, behind, start, bar.now),
            false => None,
        };
        Some(Rival { parent, start, until: until? })
    }

    /// Whether the bytes of the frame `first` are also a hypothesis of the other direction that ends a path whose score now, with
    /// the bytes after it, exceeds `bar` (bits).
    pub(super) fn has_opposite_rival(&self, first: usize, bar: f32) -> bool {
        self.lattice.iter().any(|other| self.is_opposite(first, other) && self.current_score(other) > bar)
    }

    /// Whether a hypothesis has the bytes of the frame `first` in the other direction.
    fn is_opposite(&self, first: usize, other: &Hypothesis) -> bool {
        let frame = &self.lattice[first];
        (other.start, other.end) == (frame.start, frame.end) && other.direction != frame.direction
    }
}

/// The most bytes that a frame of this announced length has.
fn span_of(extent: Extent) -> u64 {
    match extent {
        Extent::Exactly(length) => length as u64,
        Extent::AtLeast(_) | Extent::Open(_) => MAX_CANDIDATE_SPAN,
    }
}
