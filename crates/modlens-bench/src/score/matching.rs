//! Matches reported frames with frames of the truth.

use std::collections::{HashMap, HashSet};

use crate::reported::ReportedFrame;
use crate::score::tally::Tally;
use crate::sim::case::Case;

/// Reported frames with the valid frames of the truth that they match.
pub(crate) struct Matching {
    /// For each reported frame that claims to be whole, the index of the valid frame of the truth with its start and end.
    pub(crate) truth_of: Vec<Option<usize>>,
    /// The number of reported frames that claim to be whole, without those that are neither right nor wrong.
    pub(crate) claimed: u64,
    /// Line and start of ASCII frames that lack only their end mark.
    is_unscored: HashSet<(u8, u64)>,
}

impl Matching {
    /// Matches the reports of an algorithm.
    pub(crate) fn new(case: &Case, reported: &[ReportedFrame]) -> Self {
        let valid = case.truth.iter().enumerate().filter(|(_, frame)| frame.valid);
        let mut places: HashMap<(u8, u64, u64), usize> =
            valid.map(|(at, frame)| ((frame.line, frame.start, frame.end), at)).collect();
        let is_unscored = unscored_places(case);
        let mut claimed = 0;
        let matches = reported.iter().map(|frame| {
            if !frame.is_whole || is_unscored.contains(&(frame.line, frame.start)) {
                return None;
            }
            claimed += 1;
            // Each frame of the truth is matched only once.
            places.remove(&(frame.line, frame.start, frame.end))
        });
        let truth_of = matches.collect();
        Self { truth_of, claimed, is_unscored }
    }

    /// Whether this report is neither right nor wrong, and so not scored.
    pub(crate) fn is_unscored(&self, frame: &ReportedFrame) -> bool {
        self.is_unscored.contains(&(frame.line, frame.start))
    }
}

/// Line and start of ASCII frames that lack only their end mark.
fn unscored_places(case: &Case) -> HashSet<(u8, u64)> {
    let is_unscored = case.truth.iter().filter(|frame| frame.is_unscored);
    is_unscored.map(|frame| (frame.line, frame.start)).collect()
}

/// Scores damaged frames, which are matched by their start only.
pub(crate) fn damaged(case: &Case, reported: &[ReportedFrame]) -> Tally {
    let damaged = case.truth.iter().filter(|frame| !frame.valid);
    let wanted: HashSet<(u8, u64)> = damaged.map(|frame| (frame.line, frame.start)).collect();
    let is_unscored = unscored_places(case);
    let whole = reported.iter().filter(|frame| frame.is_whole);
    let whole: HashSet<(u8, u64)> = whole.map(|frame| (frame.line, frame.start)).collect();
    let bad = reported.iter().filter(|frame| !frame.is_whole);
    let claimed: HashSet<(u8, u64)> = bad.map(|frame| (frame.line, frame.start)).collect();
    let right = wanted.intersection(&claimed).count() as u64;
    // An ASCII frame that lacks only CR or LF may also be reported as whole.
    let wanted = wanted.iter().filter(|place| !(is_unscored.contains(*place) && whole.contains(*place)));
    Tally { found: right, wanted: wanted.count() as u64, right, claimed: claimed.len() as u64 }
}
