//! The smallest counters: how often, since when, until when, and for example where.

use std::iter::Sum;

use super::gaps::{Episode, Gaps, Span};
pub use crate::place::Place;
use crate::statistics::Share;
pub use modlens_protocol::mix::mix;

/// Examples kept for each claim.
pub const EXAMPLES: usize = 4;

/// Numbers of transactions that stand for many: those whose hashes are least, so that order and parts do not matter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Examples {
    /// Hashes and numbers, in order.
    least: Vec<(u64, u64)>,
    /// The greatest hash that there is room for. Nearly all are greater, and for these it is all that is looked at.
    limit: u64,
}

impl Default for Examples {
    fn default() -> Self {
        Self { least: Vec::new(), limit: u64::MAX }
    }
}

impl Examples {
    #[inline]
    pub(super) fn add(&mut self, number: u64) {
        let hash = mix(number);
        // No transaction is near one without a number.
        if number != 0 && hash <= self.limit {
            self.insert((hash, number));
        }
    }

    fn insert(&mut self, one: (u64, u64)) {
        if let Err(at) = self.least.binary_search(&one) {
            self.least.insert(at, one);
            self.least.truncate(EXAMPLES);
        }
        if let Some((hash, _)) = self.least.get(EXAMPLES - 1) {
            self.limit = *hash;
        }
    }

    pub(super) fn merge(&mut self, other: &Self) {
        other.least.iter().for_each(|one| self.insert(*one));
    }

    /// The numbers in order.
    pub fn numbers(&self) -> Vec<u64> {
        let mut numbers: Vec<u64> = self.least.iter().map(|(_, number)| *number).collect();
        numbers.sort_unstable();
        numbers
    }
}

/// A hash of bytes (FNV-1a, mixed).
pub fn mix_bytes(bytes: &[u8]) -> u64 {
    mix(bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)))
}

/// A number by which the same bytes are known again; never 0.
pub fn fingerprint(bytes: &[u8]) -> u64 {
    let mut hash = bytes.len() as u64;
    let mut rest = bytes;
    while let Some((word, more)) = rest.split_first_chunk() {
        hash = mix(hash ^ u64::from_le_bytes(*word));
        rest = more;
    }
    if !rest.is_empty() {
        hash = mix(hash ^ rest.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte)));
    }
    hash.max(1)
}

/// What failed in one way: how often, where first and last, how many others came before and after, and examples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// How many failed.
    pub failed: u64,
    /// How many there were.
    pub total: u64,
    /// The first that failed.
    pub first: Option<Place>,
    /// The last that failed.
    pub last: Option<Place>,
    /// How many there were before the first that failed.
    pub before: u64,
    /// How many there were after the last that failed.
    pub after: u64,
    /// Some of those that failed.
    pub examples: Examples,
    /// The longest stretches between failures.
    pub gaps: Gaps,
}

impl Tally {
    /// Counts one.
    #[inline]
    pub fn count(&mut self, failed: bool, place: Place) {
        self.total += 1;
        if failed {
            self.fail(place);
        } else if self.failed == 0 {
            self.before += 1;
        } else {
            self.after += 1;
        }
    }

    /// Counts some that did not fail.
    #[inline]
    pub fn count_good(&mut self, good: u64) {
        self.total += good;
        if self.failed == 0 {
            self.before += good;
        } else {
            self.after += good;
        }
    }

    fn fail(&mut self, place: Place) {
        if let Some(until) = self.span().filter(|_| self.after > 0) {
            // The one that fails now is already among all.
            self.gaps.add(self.after, Span { total: until.total - 1, ..until }, place);
        }
        self.failed += 1;
        self.first.get_or_insert(place);
        self.last = Some(place);
        self.after = 0;
        self.examples.add(place.number);
    }

    /// What was counted from the first failure to the last one.
    fn span(&self) -> Option<Span> {
        let (first, last) = (self.first?, self.last?);
        Some(Span { failed: self.failed, total: self.total.saturating_sub(self.before + self.after), first, last })
    }

    /// The runs of failures, in order; empty where none failed, or where tallies without a common order were added.
    pub fn episodes(&self) -> Vec<Episode> {
        self.span().map_or_else(Vec::new, |span| self.gaps.episodes(span))
    }

    /// Adds what came later.
    pub fn merge(&mut self, later: &Self) {
        match (self.span(), later.first) {
            (Some(own), Some(first)) => {
                let good = self.after + later.before;
                self.gaps.add(good, own, first);
                self.gaps.append(&later.gaps, own.failed, own.total + good);
            }
            (None, Some(_)) => self.gaps.clone_from(&later.gaps),
            (_, None) => {}
        }
        match (self.failed, later.failed) {
            (0, _) => self.before += later.before,
            (_, 0) => self.after += later.total,
            _ => self.after = later.after,
        }
        if self.failed == 0 && later.failed > 0 {
            self.after = later.after;
        }
        self.failed += later.failed;
        self.total += later.total;
        self.first = self.first.or(later.first);
        self.last = later.last.or(self.last);
        self.examples.merge(&later.examples);
    }

    /// Failed and all.
    pub fn share(&self) -> Share {
        Share { failed: self.failed, total: self.total }
    }
}

impl<'a> Sum<&'a Self> for Tally {
    fn sum<I: Iterator<Item = &'a Self>>(tallies: I) -> Self {
        tallies.fold(Self::default(), |mut sum, tally| {
            sum.merge(tally);
            sum
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(from: u64, failures: &[u64], to: u64) -> Tally {
        let mut all = Tally::default();
        for number in from..to {
            all.count(failures.contains(&number), Place { number, elapsed: None, time: None });
        }
        all
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let failures = [3, 5, 6, 17, 18, 19, 31];
        let whole = tally(0, &failures, 40);
        assert_eq!((whole.failed, whole.before, whole.after, whole.examples.numbers().len()), (7, 3, 8, 4));
        for cut in 0..=40 {
            let mut merged = tally(0, &failures, cut);
            merged.merge(&tally(cut, &failures, 40));
            assert_eq!(merged, whole, "cut at {cut}");
        }
    }

    #[test]
    fn of_more_gaps_than_are_kept_parts_merge_to_the_whole() {
        let failures: Vec<u64> = (0..40).map(|number| number * number % 997).collect();
        let whole = tally(0, &failures, 1000);
        for cut in (0..=1000).step_by(7) {
            let mut merged = tally(0, &failures, cut);
            merged.merge(&tally(cut, &failures, 1000));
            assert_eq!(merged, whole, "cut at {cut}");
        }
    }

    /// First and last of each episode, and how many failed of how many.
    fn episodes(failures: impl IntoIterator<Item = u64>, to: u64) -> Vec<[u64; 4]> {
        let failures: Vec<u64> = failures.into_iter().collect();
        let found = tally(1, &failures, to).episodes();
        found.iter().map(|one| [one.first.number, one.last.number, one.failed, one.total]).collect()
    }

    #[test]
    fn episodes_are_separated_by_more_good_ones_than_chance_allows() {
        assert_eq!(episodes((50..70).chain(400..430), 600), [[50, 69, 20, 20], [400, 429, 30, 30]]);
        // A failure now and then is one episode: the trouble was there all the time.
        assert_eq!(episodes((20..1000).step_by(37), 1000), [[20, 982, 27, 963]]);
        // Every other request fails for a while.
        assert_eq!(episodes((100..160).step_by(2).chain((500..540).step_by(2)), 800), [[100, 158, 30, 59], [500, 538, 20, 39]]);
        assert_eq!(episodes([], 100), [[0; 4]; 0]);
    }

    #[test]
    fn a_lone_failure_stretches_no_episode() {
        assert_eq!(episodes((50..70).chain([5000]), 6000), [[50, 69, 20, 20], [5000, 5000, 1, 1]]);
        let kept = crate::contrast::gaps::without_lone(tally(1, &(50..70).chain([5000]).collect::<Vec<_>>(), 6000).episodes());
        assert_eq!(kept.len(), 1);
    }
}
