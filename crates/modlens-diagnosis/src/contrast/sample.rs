//! A map that keeps the keys with the least hashes. Which ones these are depends on neither order nor parts, so that maps of
//! parts merge to the map of the whole.

use std::collections::BTreeMap;

/// Up to `LIMIT` entries, by the hash of their keys.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample<K, V, const LIMIT: usize> {
    entries: BTreeMap<(u64, K), V>,
    /// Whether a key was left out.
    pub overflowed: bool,
}

impl<K, V, const LIMIT: usize> Default for Sample<K, V, LIMIT> {
    fn default() -> Self {
        Self { entries: BTreeMap::new(), overflowed: false }
    }
}

impl<K: Ord + Clone, V: Default, const LIMIT: usize> Sample<K, V, LIMIT> {
    /// The entry of a key, which is added if it is new; `None` if there is no room for it.
    pub fn entry(&mut self, hash: u64, key: K) -> Option<&mut V> {
        let full_key = (hash, key);
        if self.entries.len() >= LIMIT && !self.entries.contains_key(&full_key) {
            self.overflowed = true;
            if self.entries.last_key_value().is_some_and(|(last, _)| *last < full_key) {
                return None;
            }
            self.entries.pop_last();
        }
        Some(self.entries.entry(full_key).or_default())
    }

    /// Adds what came later.
    pub fn merge(&mut self, later: &Self, merge: impl Fn(&mut V, &V)) {
        self.overflowed |= later.overflowed;
        for ((hash, key), value) in &later.entries {
            if let Some(own) = self.entry(*hash, key.clone()) {
                merge(own, value);
            }
        }
    }

    /// How many entries there are.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The hashes of the keys.
    pub fn hashes(&self) -> impl Iterator<Item = u64> + '_ {
        self.entries.keys().map(|(hash, _)| *hash)
    }

    /// Leaves out the entries whose hash does not meet this.
    pub fn retain(&mut self, keeps: impl Fn(u64) -> bool) {
        self.entries.retain(|(hash, _), _| keeps(*hash));
    }

    /// The entries, in the order of their keys.
    pub fn sorted(&self) -> Vec<(&K, &V)> {
        let mut all: Vec<(&K, &V)> = self.entries.iter().map(|((_, key), value)| (key, value)).collect();
        all.sort_by(|one, other| one.0.cmp(other.0));
        all
    }
}
