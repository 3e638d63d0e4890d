//! Pauses inside frames, by how long the longest one is.

use std::collections::BTreeMap;

use modlens_engine::records::InnerPauses;

use super::tally::{Place, Tally};

/// The longest pauses inside frames, by factors of two.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pauses {
    longest: BTreeMap<u32, Tally>,
    /// Frames with pauses.
    pub frames: u64,
}

/// Shorter pauses are counted together: 131 us.
const SHORTEST_PAUSE: u32 = 17;

impl Pauses {
    pub(super) fn count(&mut self, pauses: InnerPauses, place: Place) {
        self.frames += 1;
        let octave = (pauses.longest.max(1) as u64).ilog2().max(SHORTEST_PAUSE);
        self.longest.entry(octave).or_default().count(true, place);
    }

    /// Frames whose longest pause is of this factor of two or above, of those with pauses: a long frame has more pauses than a
    /// short one where the tap records blocks.
    pub fn from(&self, octave: u32) -> Tally {
        let mut all = Tally::default();
        self.longest.range(octave..).for_each(|(_, tally)| all.merge(tally));
        let first = self.longest.range(octave..).filter_map(|(_, tally)| tally.first).min_by_key(|place| place.number);
        let last = self.longest.range(octave..).filter_map(|(_, tally)| tally.last).max_by_key(|place| place.number);
        Tally { total: self.frames, first, last, before: 0, after: 0, ..all }
    }

    /// The factors of two that occur.
    pub fn octaves(&self) -> impl Iterator<Item = u32> + '_ {
        self.longest.keys().copied()
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.frames += later.frames;
        for (octave, tally) in &later.longest {
            self.longest.entry(*octave).or_default().merge(tally);
        }
    }
}
