//! Failed and all requests by a duration, which a delay is read off.

use modlens_engine::durations::{eighth, eighth_edge};
use modlens_protocol::Ns;

use crate::statistics::Share;

/// Half an octave has so many eighths.
const EIGHTHS: usize = 4;
/// From 2^13 ns (8 us) on ...
const FIRST_HALF: usize = 2 * 13;
/// ... to 2^41 ns (36 minutes); what is outside counts in the first and last half.
const HALVES: usize = 2 * 28;

/// Failed and all, by a duration: two counts for each factor of two.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ByDuration([Share; HALVES]);

impl Default for ByDuration {
    fn default() -> Self {
        Self([Share::default(); HALVES])
    }
}

impl ByDuration {
    /// Counts one.
    #[inline]
    pub fn count(&mut self, ns: Ns, failed: bool) {
        let half = eighth(ns) / EIGHTHS;
        self.0[half.saturating_sub(FIRST_HALF).min(HALVES - 1)].count(failed);
    }

    /// Adds others.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(own, more)| *own = own.with(*more));
    }

    /// The least duration above a limit of `splits` that may have been counted.
    pub fn least_above(&self, limit: Ns) -> Ns {
        let halves = FIRST_HALF..FIRST_HALF + HALVES;
        let edges = halves.zip(&self.0).filter(|(_, share)| share.total > 0).map(|(half, _)| eighth_edge(half * EIGHTHS) as Ns);
        edges.filter(|edge| *edge >= limit).min().unwrap_or(limit)
    }

    /// Each limit between two counts in ns, with what is below and above it; only where there is something on both sides.
    pub fn splits(&self) -> Vec<(Ns, Share, Share)> {
        let all = self.0.iter().copied().sum::<Share>();
        let mut below = Share::default();
        let mut found = Vec::new();
        for (half, share) in self.0.iter().enumerate() {
            below = below.with(*share);
            if share.total > 0 && below.total > 0 && below.total < all.total {
                let limit = eighth_edge((FIRST_HALF + half + 1) * EIGHTHS) as Ns;
                found.push((limit, below, all.without(below)));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_have_something_on_both_sides() {
        let mut all = ByDuration::default();
        (0..10).for_each(|_| all.count(1_000_000, true));
        (0..90).for_each(|_| all.count(50_000_000, false));
        let splits = all.splits();
        assert_eq!(splits.len(), 1);
        assert_eq!((splits[0].0, splits[0].1.failed, splits[0].2.failed), (1 << 20, 10, 0));
        // 50 ms are in the lower half of the octave from 2^25 ns on.
        assert_eq!(all.least_above(splits[0].0), 1 << 25);
    }
}
