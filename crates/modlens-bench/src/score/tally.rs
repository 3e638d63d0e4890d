//! Counts of right and wrong reports, with recall, precision and F1.

/// The counts for recall (found of wanted) and for precision (right of claimed).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// How many of the wanted ones were reported.
    pub found: u64,
    /// How many should have been reported.
    pub wanted: u64,
    /// How many of the reported ones are right.
    pub right: u64,
    /// How many were reported.
    pub claimed: u64,
}

impl Tally {
    /// The share of the wanted ones that was reported; 1 if none was wanted.
    pub fn recall(&self) -> f64 {
        share(self.found, self.wanted)
    }

    /// The share of the reported ones that is right; 1 if none was reported.
    pub fn precision(&self) -> f64 {
        share(self.right, self.claimed)
    }

    /// F1, the harmonic mean of recall and precision.
    pub fn f1(&self) -> f64 {
        let (recall, precision) = (self.recall(), self.precision());
        if recall + precision == 0.0 {
            0.0
        } else {
            2.0 * recall * precision / (recall + precision)
        }
    }

    /// Adds the counts of another tally.
    pub fn add(&mut self, other: &Self) {
        self.found += other.found;
        self.wanted += other.wanted;
        self.right += other.right;
        self.claimed += other.claimed;
    }
}

fn share(part: u64, whole: u64) -> f64 {
    if whole == 0 {
        1.0
    } else {
        part as f64 / whole as f64
    }
}
