//! Exchanges that went well, by unit, until they are counted with the rest: nearly all are such ones, and a few numbers are all
//! that most of them change.

use super::before::Before;
use crate::clean::Clean;

/// Unit numbers.
const UNITS: usize = 256;

/// What is pending of all units of a bus.
#[derive(Clone, Debug, Default)]
pub(super) struct CleanUnits(Vec<CleanCounts>);

/// Two are equal of which the same is pending.
impl PartialEq for CleanUnits {
    fn eq(&self, other: &Self) -> bool {
        let pending = |all: &Self| (0..UNITS).map(|unit| all.0.get(unit).cloned().unwrap_or_default()).collect::<Vec<_>>();
        pending(self) == pending(other)
    }
}

/// Exchanges with one unit that are not counted yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct CleanCounts {
    /// Nothing but the number of further ones is to be noted for lockstep (`UnitCounts::takes_clean`).
    pub is_open: bool,
    /// How many there were since they were counted last.
    pub good: u64,
    /// Those of them with a write among the transactions before.
    pub behind_writes: u64,
    /// By the unit before; this and what follows is not set back with `good`.
    pub by_previous: Few<u8>,
    /// By function.
    pub by_function: Few<u8>,
    /// Those behind a transaction, by whether that failed.
    pub after_failure: [u64; 2],
}

/// Counts by a few different keys, the same one mostly many times on end.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Few<K> {
    /// The keys with their counts.
    pub counts: Vec<(K, u64)>,
    last: usize,
}

impl<K> Default for Few<K> {
    fn default() -> Self {
        Self { counts: Vec::new(), last: 0 }
    }
}

impl<K: PartialEq> Few<K> {
    #[inline]
    fn count(&mut self, key: K) {
        match self.counts.get_mut(self.last) {
            Some((last, count)) if *last == key => *count += 1,
            _ => self.count_other(key),
        }
    }

    /// Counts a key that is not the last one.
    fn count_other(&mut self, key: K) {
        self.last = self.counts.iter().position(|(other, _)| *other == key).unwrap_or(self.counts.len());
        if self.last == self.counts.len() {
            self.counts.push((key, 0));
        }
        self.counts[self.last].1 += 1;
    }
}

impl CleanUnits {
    /// What is pending of a unit.
    #[inline]
    pub fn of(&mut self, unit: u8) -> &mut CleanCounts {
        if self.0.is_empty() {
            self.0.resize(UNITS, CleanCounts::default());
        }
        &mut self.0[usize::from(unit)]
    }

    /// What is pending of a unit, if there is anything.
    pub fn pending(&mut self, unit: u8) -> Option<&mut CleanCounts> {
        self.0.get_mut(usize::from(unit)).filter(|counts| counts.is_open)
    }

    /// Takes all that is pending, by unit.
    pub fn take(&mut self) -> impl Iterator<Item = (u8, CleanCounts)> + '_ {
        let pending = (0..=u8::MAX).zip(&mut self.0).filter(|(_, counts)| counts.is_open || counts.has_any());
        pending.map(|(unit, counts)| (unit, std::mem::take(counts)))
    }
}

impl CleanCounts {
    /// Counts one whose unit `is_open`. What its times tell is counted by `UnitCounts::count_clean_times`.
    #[inline]
    pub fn count(&mut self, seen: &Clean, before: &Before) {
        self.good += 1;
        self.by_function.count(seen.key.function);
        self.behind_writes += u64::from(before.written);
        if let Some((unit, was_silent)) = before.previous {
            self.after_failure[usize::from(before.failed)] += 1;
            if !was_silent {
                self.by_previous.count(unit);
            }
        }
    }

    fn has_any(&self) -> bool {
        !self.by_function.counts.is_empty()
    }
}
