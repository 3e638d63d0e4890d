//! Histograms of durations with logarithmic buckets, which merge by addition. A bucket has the sum of its durations as well, so
//! that what is printed is a mean of durations that were seen, and not the edge of a bucket.

use modlens_protocol::Ns;

use crate::statistics::Share;

/// Buckets for each factor of two, so that a bucket is an eighth wide at most.
const STEPS: usize = 8;
/// From 2^13 ns (8 us) on ...
const FIRST_OCTAVE: usize = 13;
/// ... to 2^41 ns (36 minutes); what is outside counts in the first and last bucket.
const OCTAVES: usize = 28;

/// Durations.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Durations {
    /// How many.
    pub count: u64,
    /// The longest.
    pub most: Ns,
    buckets: Vec<Bucket>,
}

/// How many durations a bucket has, and their sum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Bucket {
    count: u64,
    sum: Ns,
}

impl Durations {
    /// Counts one.
    #[inline]
    pub fn add(&mut self, ns: Ns) {
        if self.buckets.is_empty() {
            self.buckets.resize(OCTAVES * STEPS, Bucket::default());
        }
        self.count += 1;
        self.most = self.most.max(ns);
        let bucket = &mut self.buckets[bucket(ns)];
        bucket.count += 1;
        bucket.sum = bucket.sum.saturating_add(ns);
    }

    /// Adds others.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        self.buckets.resize(OCTAVES * STEPS, Bucket::default());
        self.count += other.count;
        self.most = self.most.max(other.most);
        for (own, more) in self.buckets.iter_mut().zip(&other.buckets) {
            own.count += more.count;
            own.sum = own.sum.saturating_add(more.sum);
        }
    }

    /// A bound for what is decided: this share does not exceed it, and it is an eighth too long at most. `None` of none.
    pub fn percentile(&self, share: f64) -> Option<Ns> {
        self.bucket_of(share).map(|(at, _)| upper(at).min(self.most))
    }

    /// What is printed: the mean of the durations that are about as long as the one which this share does not exceed. It is exact
    /// where they are equal, or only one. `None` of none.
    pub fn typical(&self, share: f64) -> Option<Ns> {
        self.bucket_of(share).map(|(_, bucket)| bucket.sum / bucket.count as Ns)
    }

    /// The bucket of the duration that this share does not exceed.
    fn bucket_of(&self, share: f64) -> Option<(usize, Bucket)> {
        let rank = ((self.count as f64 * share).ceil() as u64).max(1);
        let mut below = 0;
        self.buckets.iter().copied().enumerate().find(|(_, bucket)| {
            below += bucket.count;
            below >= rank
        })
    }

    /// How many are shorter than this duration, to the precision of the buckets.
    pub fn below(&self, ns: Ns) -> u64 {
        self.buckets.iter().take(bucket(ns)).map(|bucket| bucket.count).sum()
    }

    /// How many exceed this duration, to the precision of the buckets.
    pub fn above(&self, ns: Ns) -> u64 {
        self.buckets.iter().skip(bucket(ns) + 1).map(|bucket| bucket.count).sum()
    }
}

#[inline]
fn bucket(ns: Ns) -> usize {
    let ns = ns.max(1 << FIRST_OCTAVE) as u64;
    let octave = ns.ilog2() as usize;
    let step = ((ns << (63 - octave)) >> 60) as usize & (STEPS - 1);
    ((octave - FIRST_OCTAVE) * STEPS + step).min(OCTAVES * STEPS - 1)
}

/// The upper end of a bucket.
fn upper(bucket: usize) -> Ns {
    let (octave, step) = (FIRST_OCTAVE + bucket / STEPS, bucket % STEPS);
    ((1u64 << octave) as f64 * (1.0 + (step as f64 + 1.0) / STEPS as f64)) as Ns
}

/// Failed and all, by a duration: two buckets for each factor of two.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ByDuration([Share; 2 * OCTAVES]);

impl Default for ByDuration {
    fn default() -> Self {
        Self([Share::default(); 2 * OCTAVES])
    }
}

impl ByDuration {
    /// Counts one.
    #[inline]
    pub fn count(&mut self, ns: Ns, failed: bool) {
        self.0[bucket(ns) / (STEPS / 2)].count(failed);
    }

    /// Adds others.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(own, more)| *own = own.with(*more));
    }

    /// Each limit between buckets in ns, with what is below and above it; only where there is something on both sides.
    pub fn splits(&self) -> Vec<(Ns, Share, Share)> {
        let all = self.0.iter().fold(Share::default(), |sum, share| sum.with(*share));
        let mut below = Share::default();
        let mut found = Vec::new();
        for (half, share) in self.0.iter().enumerate() {
            below = below.with(*share);
            if share.total > 0 && below.total > 0 && below.total < all.total {
                found.push((upper((half + 1) * (STEPS / 2) - 1), below, all.without(below)));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_right_within_an_eighth() {
        let mut all = Durations::default();
        (1..=1000).for_each(|ms| all.add(ms * 1_000_000));
        for (share, ms) in [(0.5, 500.0), (0.99, 990.0), (1.0, 1000.0)] {
            let found = all.percentile(share).unwrap() as f64 / 1e6;
            assert!(found >= ms * 0.99 && found <= ms * 1.13, "{share}: {found}");
        }
        assert_eq!(Durations::default().percentile(0.5), None);
    }

    #[test]
    fn what_is_printed_was_seen() {
        let mut all = Durations::default();
        for ms in [300, 530, 532, 537, 2000] {
            all.add(ms * 1_000_000);
        }
        // A bucket ends at 2^29 ns = 536.870912 ms.
        assert_eq!(all.typical(0.2), Some(300_000_000));
        assert_eq!(all.typical(0.5), Some(531_000_000));
        assert_eq!(all.typical(0.8), Some(537_000_000));
        assert_eq!(all.typical(1.0), Some(2_000_000_000));
        let mut twice = all.clone();
        twice.merge(&all);
        assert_eq!((twice.count, twice.typical(0.5)), (10, Some(531_000_000)));
        assert_eq!(Durations::default().typical(0.5), None);
    }

    #[test]
    fn splits_have_something_on_both_sides() {
        let mut all = ByDuration::default();
        (0..10).for_each(|_| all.count(1_000_000, true));
        (0..90).for_each(|_| all.count(50_000_000, false));
        let splits = all.splits();
        assert_eq!(splits.len(), 1);
        assert_eq!((splits[0].0, splits[0].1.failed, splits[0].2.failed), (1 << 20, 10, 0));
    }
}
