//! The scorer, which compares reported frames with the truth.
//!
//! Let V be the valid frames of the truth, O the reported frames that claim to be whole, and M those of O that match one of
//! V in start and end. Recall is M/V and precision is M/O. The headline figure (`frames_with_direction`) counts a match only
//! if its direction is right as well.

mod calibration;
pub(crate) mod labels;
mod latency;
pub(crate) mod matching;
pub mod odds;
pub(crate) mod pairs;
mod tally;

pub use calibration::Calibration;
pub use labels::LabelScore;
pub use latency::Latency;
pub use tally::Tally;

use crate::model::Label;
use crate::reported::ReportedFrame;
use crate::sim::case::Case;
use matching::Matching;

/// Stated odds of 1024 to 1, as log2.
const SURE_BITS: u8 = 10;

/// The score of one case, or the sum of several.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// Valid frames of the truth.
    pub valid: u64,
    /// Reported frames that claim to be whole.
    pub claimed: u64,
    /// Reported frames that claim to be whole and have the right start and end.
    pub matched: u64,
    /// Matched frames that have the right direction as well.
    pub matched_with_direction: u64,
    /// Matched frames with stated odds of a thousand to one or better.
    pub sure: u64,
    /// Those of them that have the wrong direction, also where the recording does not decide it.
    pub sure_and_wrong: u64,
    /// Responses that are assigned to their requests.
    pub pairs: Tally,
    /// Damaged frames, found by their start.
    pub damaged: Tally,
    /// Labels, in the order of `Label::ALL`.
    pub labels: [LabelScore; 8],
    /// In live runs the time from the read of a frame's last byte to the report.
    pub latency: Latency,
    /// Reported frames that claim to be whole by their stated odds, and how many of them are wrong.
    pub calibration: Calibration,
}

impl Score {
    /// Frames with the right start, end and direction, the headline figure.
    pub fn frames_with_direction(&self) -> Tally {
        self.tally(self.matched_with_direction)
    }

    /// Frames with the right start and end.
    pub fn frames(&self) -> Tally {
        self.tally(self.matched)
    }

    /// The share of frames with stated odds of a thousand to one or better that have the wrong direction.
    pub fn wrong_of_sure(&self) -> f64 {
        self.sure_and_wrong as f64 / self.sure.max(1) as f64
    }

    fn tally(&self, matched: u64) -> Tally {
        Tally { found: matched, wanted: self.valid, right: matched, claimed: self.claimed }
    }

    /// The score of a label.
    pub fn label(&self, label: Label) -> &LabelScore {
        &self.labels[label as usize]
    }

    /// Adds the score of another case.
    pub fn add(&mut self, other: &Self) {
        self.valid += other.valid;
        self.claimed += other.claimed;
        self.matched += other.matched;
        self.matched_with_direction += other.matched_with_direction;
        self.sure += other.sure;
        self.sure_and_wrong += other.sure_and_wrong;
        self.pairs.add(&other.pairs);
        self.damaged.add(&other.damaged);
        for (mine, theirs) in self.labels.iter_mut().zip(&other.labels) {
            mine.0.add(&theirs.0);
        }
        self.latency.add(&other.latency);
        self.calibration.add(&other.calibration);
    }
}

/// Scores reported frames against the truth of a case.
pub fn score(case: &Case, reported: &[ReportedFrame]) -> Score {
    let matching = Matching::new(case, reported);
    let mut score = Score {
        valid: case.truth.iter().filter(|frame| frame.valid).count() as u64,
        claimed: matching.claimed,
        pairs: pairs::score(case, reported, &matching),
        damaged: matching::damaged(case, reported),
        labels: labels::score(case, reported, &matching),
        latency: Latency::of(case, reported),
        calibration: Calibration::of(case, reported, &matching),
        ..Score::default()
    };
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        if let Some(truth) = truth.filter(|_| frame.is_whole).map(|at| &case.truth[at]) {
            let has_wrong_direction = !truth.echo && frame.direction != truth.direction;
            if frame.confidence >= SURE_BITS {
                score.sure += 1;
                score.sure_and_wrong += u64::from(has_wrong_direction);
            }
            score.matched += 1;
            score.matched_with_direction += u64::from(truth.is_undecided || !has_wrong_direction);
        }
    }
    score
}

/// Counts the frames that are reported after an offset where there is only noise: those reported as certain, and those
/// marked as unconfirmed.
pub fn false_frames(reported: &[ReportedFrame], from: u64) -> (u64, u64) {
    let claimed = reported.iter().filter(|frame| frame.is_whole && frame.end > from);
    claimed.fold(
        (0, 0),
        |(facts, unconfirmed), frame| {
            if frame.unconfirmed {
                (facts, unconfirmed + 1)
            } else {
                (facts + 1, unconfirmed)
            }
        },
    )
}

#[cfg(test)]
mod tests;
