//! The smallest counters: how often, since when, until when, and for example where.

pub use modlens_protocol::mix::mix;
use modlens_protocol::Ns;

/// Examples kept for each claim.
pub const EXAMPLES: usize = 4;

/// A place in a recording: the number of a transaction and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the transaction; 0 where none is near.
    pub number: u64,
    /// Start of it, since the beginning of the recording.
    pub elapsed: Option<Ns>,
    /// Start of it.
    pub time: Option<Ns>,
}

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
        self.failed += 1;
        self.first.get_or_insert(place);
        self.last = Some(place);
        self.after = 0;
        self.examples.add(place.number);
    }

    /// Adds what came later.
    pub fn merge(&mut self, later: &Self) {
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
    pub fn share(&self) -> crate::statistics::Share {
        crate::statistics::Share { failed: self.failed, total: self.total }
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
}
