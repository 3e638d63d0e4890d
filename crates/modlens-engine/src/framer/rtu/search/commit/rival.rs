//! Unfinished frames that may become rivals, judged by their headers.

use std::ops::Range;

use crate::framer::rtu::header_score;
use crate::framer::rtu::search::commit::state::{Rival, RivalAt, RivalBar};
use crate::framer::rtu::search::hypothesis::Hypothesis;
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights;
use modlens_protocol::functions::EXCEPTION_BIT;

/// A set of units.
#[derive(Default)]
pub(super) struct UnitSet([u64; 4]);

impl UnitSet {
    fn insert(&mut self, unit: u8) {
        self.0[usize::from(unit >> 6)] |= 1 << (unit & 63);
    }

    fn contains(&self, unit: u8) -> bool {
        self.0[usize::from(unit >> 6)] >> (unit & 63) & 1 == 1
    }
}

/// What the headers of unfinished frames are compared with first, before each path is looked at.
pub(super) struct HeaderFilter {
    /// `RivalBar::least`.
    least: f32,
    /// The units that are addressed by an outstanding request on any path.
    outstanding_units: UnitSet,
    /// Stream offsets at which paths end, modulo 64, one bit each.
    ends: u64,
}

impl HeaderFilter {
    /// Whether some path may end exactly at this stream offset. Nearly always `false` where none does.
    pub(super) fn may_be_due_at(&self, start: u64) -> bool {
        self.ends >> (start % 64) & 1 == 1
    }
}

impl Search {
    /// The first unfinished frame that may outscore the frame `first` (an index of the lattice) on a live line, by its header:
    /// one that begins in `starts` (stream offsets, the end excluded) after any hypothesis, else one right after a frame of
    /// another path.
    ///
    /// Moves `skip.no_rival_before` past the leading starts at which no frame can become a rival while the hypotheses stay the
    /// same.
    pub(super) fn find_rival_by_header(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        starts: Range<u64>,
        bar: RivalBar,
    ) -> Option<Rival> {
        let filter = self.header_filter(bar);
        let mut all_excluded_so_far = true;
        for start in starts.start.max(self.skip.no_rival_before)..starts.end {
            let bytes = &input.bytes()[(start - input.offset()) as usize..];
            let seen = &bytes[..(self.scanned_to - start) as usize];
            if self.may_exceed(context, seen, start, &filter) {
                match self.header_rival_at(input, context, start, bar) {
                    RivalAt::Found(rival) => return Some(rival),
                    RivalAt::NotNow => all_excluded_so_far = false,
                    // Once all bytes are seen that a header is judged by, it will not be worth more later.
                    RivalAt::Never => {
                        all_excluded_so_far &= start + header_score::judged_header_bytes(context, bytes) <= self.scanned_to;
                    }
                }
            }
            if all_excluded_so_far {
                self.skip.no_rival_before = start + 1;
            }
        }
        self.header_rival_behind_other_path(input, context, first, bar)
    }

    /// A rival by its header right after a hypothesis of another path than that of the frame `first`: that path may be in the
    /// middle of its next frame, which can begin after the starts that were tried.
    fn header_rival_behind_other_path(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        first: usize,
        bar: RivalBar,
    ) -> Option<Rival> {
        (1..self.lattice.len()).filter(|&parent| self.lattice[parent].first_on_path != first).find_map(|parent| {
            let start = self.lattice[parent].end;
            let until = self.rival_until_by_header(input, context, &self.lattice[parent], start, bar.now)?;
            Some(Rival { parent, start, until })
        })
    }

    /// Whether an unfinished frame at stream offset `start` is a rival by its header as far as it is seen, after any
    /// hypothesis.
    fn header_rival_at(&self, input: &Input, context: &FramerContext<'_>, start: u64, bar: RivalBar) -> RivalAt {
        let mut result = RivalAt::Never;
        for (parent, behind) in self.lattice.iter().enumerate() {
            if self.rival_until_by_header(input, context, behind, start, bar.least).is_none() {
                continue;
            }
            if let Some(until) = self.rival_until_by_header(input, context, behind, start, bar.now) {
                return RivalAt::Found(Rival { parent, start, until });
            }
            result = RivalAt::NotNow;
        }
        result
    }

    /// Whether a path that goes on from the hypothesis `behind` with an unfinished frame at `start` may exceed `bar`, a path
    /// score in bits: the stream offset up to which its bound holds, so that it has to be awaited. `None` if it cannot.
    ///
    /// Only bytes scanned count. The path is worth its score less the unframed bytes between, and an upper bound of the header.
    pub(super) fn rival_until_by_header(
        &self,
        input: &Input,
        context: &FramerContext<'_>,
        behind: &Hypothesis,
        start: u64,
        bar: f32,
    ) -> Option<u64> {
        if behind.end > start || start >= self.scanned_to {
            return None;
        }
        // A frame that begins where one is due may well contain the frames found since, so its end is awaited.
        let due = if start == behind.end { weights::FRAME_DUE_BITS } else { 0.0 };
        let path_score = behind.path_score - self.model.unframed_cost(start - behind.end) + due;
        if path_score <= bar - weights::MAX_HEADER_BITS {
            return None;
        }
        let base = input.offset();
        let seen = &input.bytes()[(start - base) as usize..(self.scanned_to - base) as usize];
        let outstanding = behind.answerable.outstanding.map(|id| self.requests.get(id));
        let header = header_score::header_bound(&self.model, context, outstanding, seen);
        let header = header.filter(|header| path_score + header.bits > bar)?;
        Some(start + header.until_bytes)
    }

    /// Whether a frame that begins at stream offset `start` may lift any path above the bar of the filter with some body. True
    /// where it may answer a request that is outstanding on some path, or where unit and function are not both there. `false`
    /// costs two look-ups (and fills their cache), and nearly always spares the exact bound after each path.
    ///
    /// `seen` are the bytes from `start` on.
    pub(super) fn may_exceed(&mut self, context: &FramerContext<'_>, seen: &[u8], start: u64, filter: &HeaderFilter) -> bool {
        let &[unit, code, ..] = seen else { return true };
        let header = self.model.max_header_score(context.functions, unit, code);
        // A header that adds no more bits than this cannot exceed the bar, whichever path it follows.
        let least_bits = filter.least - (self.best_path_score_before(start) + weights::ROUNDING_BITS);
        let is_little = header + weights::FRAME_DUE_BITS <= least_bits
            || (header - self.model.unframed_cost(1) <= least_bits && !self.is_due_at(start));
        !is_little || (filter.outstanding_units.contains(unit) && self.may_answer(unit, code & !EXCEPTION_BIT))
    }

    /// The score in bits of the best of the paths that end at this stream offset or before it.
    fn best_path_score_before(&self, offset: u64) -> f32 {
        let before = self.lattice.iter().filter(|hypothesis| hypothesis.end <= offset);
        before.map(|hypothesis| hypothesis.path_score).fold(f32::MIN, f32::max)
    }

    /// Whether some path ends exactly at this stream offset.
    pub(super) fn is_due_at(&self, start: u64) -> bool {
        self.lattice.iter().any(|before| before.end == start)
    }

    /// Whether a frame of this unit and function, the latter without exception bit, answers a request that is outstanding on any
    /// path.
    fn may_answer(&self, unit: u8, function: u8) -> bool {
        let mut outstanding = self.lattice.iter().filter_map(|before| before.answerable.outstanding);
        outstanding.any(|id| self.requests.get(id).matches(unit, function))
    }

    /// The filter for this bar, which holds as long as no hypothesis is added.
    pub(super) fn header_filter(&self, bar: RivalBar) -> HeaderFilter {
        let mut outstanding_units = UnitSet::default();
        let outstanding = self.lattice.iter().filter_map(|before| before.answerable.outstanding);
        outstanding.for_each(|id| outstanding_units.insert(self.requests.get(id).unit));
        let ends = self.lattice.iter().fold(0, |ends, before| ends | 1 << (before.end % 64));
        HeaderFilter { least: bar.least, outstanding_units, ends }
    }
}
