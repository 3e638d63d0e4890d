//! Counts of right and wrong answers, and the measures made of them.

/// Right ones among the wanted and among the claimed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Right among the wanted.
    pub found: u64,
    /// Wanted.
    pub wanted: u64,
    /// Right among the claimed.
    pub right: u64,
    /// Claimed.
    pub claimed: u64,
}

impl Tally {
    /// Share of the wanted that was found; 1 where nothing was wanted.
    pub fn recall(&self) -> f64 {
        share(self.found, self.wanted)
    }

    /// Share of the claimed that is right; 1 where nothing was claimed.
    pub fn precision(&self) -> f64 {
        share(self.right, self.claimed)
    }

    /// The harmonic mean of the two.
    pub fn f1(&self) -> f64 {
        let (recall, precision) = (self.recall(), self.precision());
        if recall + precision == 0.0 {
            0.0
        } else {
            2.0 * recall * precision / (recall + precision)
        }
    }

    /// Adds another one.
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
