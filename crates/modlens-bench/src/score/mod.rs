//! The scorer: reported frames against the truth.
//!
//! With V the valid frames of the truth, O the reported ones that claim to be whole, M those of O that match V in start
//! and end: recall is M/V, precision M/O. The headline (`fd`) counts a match only with the right direction.

pub(crate) mod labels;
mod latency;
pub(crate) mod matching;
pub(crate) mod pairs;
mod tally;

pub use labels::LabelScore;
pub use latency::Latency;
pub use tally::Tally;

use crate::model::Label;
use crate::reported::Reported;
use crate::sim::case::Case;
use matching::Matching;

/// What came out for one case, or for many.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// Valid frames of the truth.
    pub valid: u64,
    /// Reported frames that claim to be whole.
    pub claimed: u64,
    /// Those with the right start and end.
    pub matched: u64,
    /// Those with the right direction too.
    pub matched_fd: u64,
    /// Request and response joined.
    pub pairs: Tally,
    /// Damaged frames, by their start.
    pub damaged: Tally,
    /// What people act on, in the order of `Label::ALL`.
    pub labels: [LabelScore; 8],
    /// Live: from the last byte's read to the report.
    pub latency: Latency,
}

impl Score {
    /// Frames with exact start, end and direction: the headline.
    pub fn fd(&self) -> Tally {
        self.tally(self.matched_fd)
    }

    /// Frames with exact start and end.
    pub fn frames(&self) -> Tally {
        self.tally(self.matched)
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
        self.matched_fd += other.matched_fd;
        self.pairs.add(&other.pairs);
        self.damaged.add(&other.damaged);
        for (mine, theirs) in self.labels.iter_mut().zip(&other.labels) {
            mine.0.add(&theirs.0);
        }
        self.latency.add(&other.latency);
    }
}

/// Compares what was reported with what was sent.
pub fn score(case: &Case, reported: &[Reported]) -> Score {
    let matching = Matching::new(case, reported);
    let mut score = Score {
        valid: case.truth.iter().filter(|frame| frame.valid).count() as u64,
        claimed: matching.claimed,
        pairs: pairs::score(case, reported, &matching),
        damaged: matching::damaged(case, reported),
        labels: labels::score(case, reported, &matching),
        latency: Latency::of(case, reported),
        ..Score::default()
    };
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        if let Some(truth) = truth.filter(|_| frame.crc_ok).map(|at| &case.truth[at]) {
            score.matched += 1;
            score.matched_fd += u64::from(truth.echo || frame.direction == truth.direction);
        }
    }
    score
}

/// Facts and tentative frames that an algorithm claims behind this offset, where there is only noise.
pub fn false_frames(reported: &[Reported], from: u64) -> (u64, u64) {
    let claimed = reported.iter().filter(|frame| frame.crc_ok && frame.end > from);
    claimed.fold(
        (0, 0),
        |(facts, tentative), frame| {
            if frame.tentative {
                (facts, tentative + 1)
            } else {
                (facts + 1, tentative)
            }
        },
    )
}

#[cfg(test)]
mod tests;
