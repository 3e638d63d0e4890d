//! Stated odds against counted errors.

use crate::model::Direction;
use crate::reported::ReportedFrame;
use crate::score::matching::Matching;
use crate::sim::case::Case;

/// Frames that claim to be whole by their confidence, and how many of these are wrong: nobody sent a frame from there to there,
/// or the other side did. A direction that is left open is not wrong.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// By confidence: rows, and wrong ones among them.
    pub rows: [(u64, u64); 64],
    /// The same for rows marked as unconfirmed.
    pub unconfirmed: [(u64, u64); 64],
}

impl Default for Calibration {
    fn default() -> Self {
        Self { rows: [(0, 0); 64], unconfirmed: [(0, 0); 64] }
    }
}

impl Calibration {
    pub(crate) fn of(case: &Case, reported: &[ReportedFrame], matching: &Matching) -> Self {
        let mut this = Self::default();
        for (frame, truth) in reported.iter().zip(&matching.truth_of) {
            if !frame.is_whole || matching.is_unscored(frame) {
                continue;
            }
            let truth = truth.map(|at| &case.truth[at]);
            let is_right = |echo: bool, direction| echo || frame.direction == direction || frame.direction == Direction::Unknown;
            let is_right = truth.is_some_and(|truth| is_right(truth.echo, truth.direction));
            this.count(frame, !is_right);
        }
        this
    }

    /// Counts frames reported after an offset where nobody sent any.
    pub fn of_noise(reported: &[ReportedFrame], from: u64) -> Self {
        let mut this = Self::default();
        reported.iter().filter(|frame| frame.is_whole && frame.end > from).for_each(|frame| this.count(frame, true));
        this
    }

    fn count(&mut self, frame: &ReportedFrame, is_wrong: bool) {
        let rows = if frame.unconfirmed { &mut self.unconfirmed } else { &mut self.rows };
        let (all, wrong) = &mut rows[usize::from(frame.confidence.min(63))];
        *all += 1;
        *wrong += u64::from(is_wrong);
    }

    /// Rows of at least this confidence, and wrong ones among them.
    pub fn at_least(&self, bits: usize) -> (u64, u64) {
        let rows = self.rows[bits..].iter().chain(&self.unconfirmed[bits..]);
        rows.fold((0, 0), |(all, wrong), (more, more_wrong)| (all + more, wrong + more_wrong))
    }

    /// Adds the counts of another case.
    pub fn add(&mut self, other: &Self) {
        let mine = self.rows.iter_mut().chain(&mut self.unconfirmed);
        for ((all, wrong), (more, more_wrong)) in mine.zip(other.rows.iter().chain(&other.unconfirmed)) {
            (*all, *wrong) = (*all + more, *wrong + more_wrong);
        }
    }
}
