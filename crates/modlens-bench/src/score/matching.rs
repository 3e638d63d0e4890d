//! Which reported frame is which frame of the truth.

use std::collections::{HashMap, HashSet};

use crate::reported::Reported;
use crate::score::tally::Tally;
use crate::sim::case::Case;

/// Reported frames matched with valid ones of the truth.
pub(crate) struct Matching {
    /// For each reported frame that claims to be whole: the valid frame of the truth with its start and end.
    pub(crate) truth_of: Vec<Option<usize>>,
    /// How many claim to be whole, those left out that are neither right nor wrong.
    pub(crate) claimed: u64,
    lenient: HashSet<(u8, u64)>,
}

impl Matching {
    pub(crate) fn new(case: &Case, reported: &[Reported]) -> Self {
        let valid = case.truth.iter().enumerate().filter(|(_, frame)| frame.valid);
        let mut places: HashMap<(u8, u64, u64), usize> =
            valid.map(|(at, frame)| ((frame.line, frame.start, frame.end), at)).collect();
        let lenient = lenient_places(case);
        let mut claimed = 0;
        let matches = reported.iter().map(|frame| {
            if !frame.crc_ok || lenient.contains(&(frame.line, frame.start)) {
                return None;
            }
            claimed += 1;
            // Each frame of the truth can be found once.
            places.remove(&(frame.line, frame.start, frame.end))
        });
        let truth_of = matches.collect();
        Self { truth_of, claimed, lenient }
    }

    /// Whether this report is neither right nor wrong.
    pub(crate) fn lenient(&self, frame: &Reported) -> bool {
        self.lenient.contains(&(frame.line, frame.start))
    }
}

/// Where frames begin that lack their end mark only.
fn lenient_places(case: &Case) -> HashSet<(u8, u64)> {
    let lenient = case.truth.iter().filter(|frame| frame.lenient);
    lenient.map(|frame| (frame.line, frame.start)).collect()
}

/// Damaged frames by their start: how many of the truth's were located, how many of the reported are there.
pub(crate) fn damaged(case: &Case, reported: &[Reported]) -> Tally {
    let damaged = case.truth.iter().filter(|frame| !frame.valid);
    let wanted: HashSet<(u8, u64)> = damaged.map(|frame| (frame.line, frame.start)).collect();
    let lenient = lenient_places(case);
    let whole = reported.iter().filter(|frame| frame.crc_ok);
    let whole: HashSet<(u8, u64)> = whole.map(|frame| (frame.line, frame.start)).collect();
    let bad = reported.iter().filter(|frame| !frame.crc_ok);
    let claimed: HashSet<(u8, u64)> = bad.map(|frame| (frame.line, frame.start)).collect();
    let right = wanted.intersection(&claimed).count() as u64;
    // An ASCII frame that lacks CR or LF only may be called whole as well.
    let wanted = wanted.iter().filter(|place| !(lenient.contains(*place) && whole.contains(*place)));
    Tally { found: right, wanted: wanted.count() as u64, right, claimed: claimed.len() as u64 }
}
