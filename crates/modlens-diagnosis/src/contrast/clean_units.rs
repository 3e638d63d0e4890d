//! Exchanges that went well, by unit, until they are counted with the rest: nearly all are such ones, and a few numbers are all
//! that most of them change.

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
    pub by_previous: Few,
    /// By function.
    pub by_function: Few,
    /// All of them: none of these was after a failure.
    pub after_success: u64,
}

/// Counts by unit or function, of which there are a few.
#[derive(Clone, Debug, Default)]
pub(super) struct Few {
    /// The keys with their counts.
    counts: Vec<(u8, u64)>,
    /// By the last bits of a key: which of the counts is probably its own.
    likely: [u8; LIKELY],
}

/// Likely places: a power of two.
const LIKELY: usize = 16;

/// Two are equal that have counted the same.
impl PartialEq for Few {
    fn eq(&self, other: &Self) -> bool {
        self.counts == other.counts
    }
}

impl Few {
    /// Adds to the count of a key.
    #[inline]
    pub fn add(&mut self, key: u8, more: u64) {
        let likely = self.likely[usize::from(key) % LIKELY];
        match self.counts.get_mut(usize::from(likely)) {
            Some((own, count)) if *own == key => *count += more,
            _ => self.add_elsewhere(key, more),
        }
    }

    /// Takes the keys with their counts.
    pub fn take(&mut self) -> impl Iterator<Item = (u8, u64)> + '_ {
        self.counts.drain(..)
    }

    /// Adds to a key that is not at its likely place.
    fn add_elsewhere(&mut self, key: u8, more: u64) {
        let at = self.counts.iter().position(|(other, _)| *other == key).unwrap_or(self.counts.len());
        if at == self.counts.len() {
            self.counts.push((key, 0));
        }
        self.counts[at].1 += more;
        self.likely[usize::from(key) % LIKELY] = at as u8;
    }
}

impl CleanUnits {
    /// What is pending of a unit of which nothing but the number of further exchanges is to be noted.
    #[inline]
    pub fn open(&mut self, unit: u8) -> Option<&mut CleanCounts> {
        self.0.get_mut(usize::from(unit)).filter(|counts| counts.is_open)
    }

    /// Whether there is such a unit.
    #[inline]
    pub fn is_open(&self, unit: u8) -> bool {
        self.0.get(usize::from(unit)).is_some_and(|counts| counts.is_open)
    }

    /// What is pending of a unit.
    #[inline]
    pub fn of(&mut self, unit: u8) -> &mut CleanCounts {
        if self.0.is_empty() {
            self.0.resize(UNITS, CleanCounts::default());
        }
        &mut self.0[usize::from(unit)]
    }

    /// The units of which something is pending.
    pub fn all_pending(&mut self) -> impl Iterator<Item = (u8, &mut CleanCounts)> {
        (0..=u8::MAX).zip(&mut self.0).filter(|(_, counts)| counts.is_open || !counts.by_function.counts.is_empty())
    }
}
