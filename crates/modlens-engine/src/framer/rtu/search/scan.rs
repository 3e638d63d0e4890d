//! Scans the bytes that have come: finds the ends of frames, adds hypotheses, and asks whether something is final.

use crate::framer::rtu::search::commit::Decision;
use crate::framer::rtu::search::extend::first_damaged_end;
use crate::framer::rtu::search::hypothesis::ROOT;
use crate::framer::rtu::search::lattice::{first_decision_behind, root_floor};
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::announced_lengths;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use crate::rtu_model::score;
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::functions::Extent;
use modlens_protocol::Ns;

impl Search {
    /// Scans the bytes that have come until something is committed; `None` if more bytes, a silence or the end are needed. Called
    /// again, it goes on after the last byte scanned. `frame_gap_ns` is the shortest pause between frames.
    ///
    /// Where a look-ahead needs bytes that have not come (`skip.needs_more_bytes`), it waits for them before it scans on. Once
    /// all bytes are scanned, it decides if the input is closed, or paused while a frame leads; where none leads, the adapter
    /// may still hold back the end of one.
    pub fn advance(&mut self, input: &Input, context: &FramerContext<'_>, frame_gap_ns: Ns) -> Option<Decision> {
        if !self.is_scanning {
            self.begin_scan(input, context);
        }
        self.frame_gap_ns = frame_gap_ns;
        let waits_for_bytes = std::mem::take(&mut self.skip.needs_more_bytes);
        if waits_for_bytes {
            let decision = self.decide(input, context, false);
            if decision.is_some() || self.skip.needs_more_bytes {
                return decision;
            }
        }
        let decision = self.scan_all(input, context);
        if decision.is_some() || self.skip.needs_more_bytes {
            return decision;
        }
        let a_frame_leads = || self.lattice[self.best_path().0].first_on_path != ROOT;
        let is_closed = input.is_closed || (input.is_paused && a_frame_leads());
        if is_closed && self.scanned_to > self.committed_offset() {
            return self.decide(input, context, true);
        }
        None
    }

    /// Scans the bytes that have come, up to the last one, or until something is committed or a look-ahead needs more bytes.
    ///
    /// It decides at boundaries that no frame crosses, and when `skip.next_decision_at` is reached (new hypotheses set it to 0).
    #[inline]
    fn scan_all(&mut self, input: &Input, context: &FramerContext<'_>) -> Option<Decision> {
        let base = input.offset();
        let end = base + input.bytes().len() as u64;
        // Equal to `scanned_to` where a read may begin.
        let mut read_end = self.scanned_to;
        while self.scanned_to < end {
            let index = (self.scanned_to - base) as usize;
            if self.scanned_to == read_end {
                let decision = self.decide_at_boundary(input, context, index);
                if decision.is_some() || self.skip.needs_more_bytes {
                    return decision;
                }
                read_end = input.read(index).map_or(end, |read| read.end);
            }
            let scan_to = end.min(read_end).min(self.next_event());
            self.scan(input, context, &input.bytes()[index..(scan_to - base) as usize]);
            if self.scanned_to >= self.skip.next_decision_at {
                let decision = self.decide(input, context, false);
                if decision.is_some() || self.skip.needs_more_bytes {
                    return decision;
                }
            }
        }
        None
    }

    /// The stream offset, after the last byte scanned, up to which nothing can happen unless a valid substring ends.
    #[inline]
    fn next_event(&self) -> u64 {
        self.skip.next_damaged_end_at.min(self.skip.next_decision_at).max(self.scanned_to + 1)
    }

    /// What is decided if no frame crosses the place after the last byte scanned, which has this index in the input: if it is
    /// a boundary after the root. If nothing is committed there, scanning begins again, since no valid substring reaches across.
    #[inline]
    fn decide_at_boundary(&mut self, input: &Input, context: &FramerContext<'_>, index: usize) -> Option<Decision> {
        if self.scanned_to <= self.committed_offset() || !input.is_boundary(index) {
            return None;
        }
        match self.frame_across(input, context, index) {
            FrameAcross::Valid => return None,
            FrameAcross::NeedsMoreBytes => {
                self.skip.needs_more_bytes = true;
                return None;
            }
            FrameAcross::None => {}
        }
        let decision = self.decide(input, context, true);
        if decision.is_none() {
            self.scanner.restart(self.scanned_to);
        }
        decision
    }

    /// Whether a frame with a valid CRC, of a length that its header announces, begins at the root and goes on after the silence
    /// before this byte: its sender paused. Live, nobody waits for it.
    fn frame_across(&self, input: &Input, context: &FramerContext<'_>, index: usize) -> FrameAcross {
        let start = (self.committed_offset() - input.offset()) as usize;
        let bytes = &input.bytes()[start..];
        let is_silence = input.read(index).is_some_and(|read| !read.starts_record);
        if !context.may_look_ahead || !is_silence || bytes.len() < 2 {
            return FrameAcross::None;
        }
        let mut found = FrameAcross::None;
        for (_, extent) in announced_lengths(context, bytes).into_iter().flatten() {
            let (Extent::Exactly(length) | Extent::AtLeast(length)) = extent else { continue };
            if start + length <= index || length > MAX_CANDIDATE_BYTES {
                continue;
            }
            match bytes.get(..length) {
                Some(frame) if extent == Extent::Exactly(length) && crc_valid(frame) => {
                    let starts_record = input.boundary_after(start, start + length - 1, Ns::MAX).is_some();
                    return if starts_record { FrameAcross::None } else { FrameAcross::Valid };
                }
                None if !input.is_closed => found = FrameAcross::NeedsMoreBytes,
                _ => {}
            }
        }
        found
    }

    /// Begins to scan after the root.
    fn begin_scan(&mut self, input: &Input, context: &FramerContext<'_>) {
        let root_end = self.committed_offset();
        self.scanner.restart(root_end);
        self.scanned_to = root_end;
        self.model.update_costs();
        self.lattice[ROOT].next_damaged_end_at = first_damaged_end(input, context, root_end);
        self.skip.forget_decisions(first_decision_behind(root_end));
        self.skip.next_damaged_end_at = self.lattice[ROOT].next_damaged_end_at;
        self.skip.needs_more_bytes = false;
        self.is_scanning = true;
    }

    /// Scans these bytes, the first of them at `scanned_to`, up to the first one with which valid substrings end, and adds their
    /// hypotheses and those of damaged frames that end there. `scanned_to` moves; new hypotheses make a decision due.
    fn scan(&mut self, input: &Input, context: &FramerContext<'_>, bytes: &[u8]) {
        let mut valid_starts = std::mem::take(&mut self.valid_starts);
        let (model, rejected, root) = (&self.model, &self.rejected, &self.lattice[ROOT]);
        let is_in_plain_noise = self.is_in_plain_noise(input, context);
        // Noise is full of substrings that were weighed before.
        let is_rejected = |start: u64, frame: &[u8]| {
            let floor = root_floor(model, root, start + frame.len() as u64);
            rejected.contains(frame, root.end, model.unframed_cost(start - root.end), floor)
        };
        let may_be_frame = |start: u64, length: usize| {
            if start < root.end {
                return false;
            }
            let frame = &input.bytes()[(start - input.offset()) as usize..][..length];
            let may_be_rejected = is_in_plain_noise && !model.has_unit(frame[0]);
            !(score::is_impossible(frame[1], length) || may_be_rejected && is_rejected(start, frame))
        };
        self.scanned_to += self.scanner.scan(self.scanned_to, bytes, &may_be_frame, &mut valid_starts) as u64;
        let hypotheses_before = self.lattice.len();
        let floor = if valid_starts.is_empty() { 0.0 } else { self.beam_floor() };
        for &start in &valid_starts {
            self.add_valid_hypotheses(input, context, start, floor);
        }
        if self.scanned_to >= self.skip.next_damaged_end_at {
            self.add_damaged_hypotheses(input, context, self.scanner.is_at_end());
        }
        self.valid_starts = valid_starts;
        if self.lattice.len() > hypotheses_before {
            self.skip.next_decision_at = 0;
        }
    }
}

/// A frame that a silence of `break_ns` cuts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum FrameAcross {
    /// There is none.
    None,
    /// Its CRC is valid.
    Valid,
    /// Its last bytes have not come.
    NeedsMoreBytes,
}
