//! A map that keeps the keys with the least hashes. Which ones these are depends on neither order nor parts, so that maps of
//! parts merge to the map of the whole.

/// Up to `LIMIT` entries, by the hash of their keys.
#[derive(Clone, Debug)]
pub struct Sample<K, V, const LIMIT: usize> {
    slots: Vec<(K, V)>,
    /// The hash of each key and where it is in `slots`, in the order of hashes, then of keys. Insertion moves the greater ones,
    /// which for so few is faster than a tree.
    order: Vec<(u64, u32)>,
    /// The greatest hash of all keys if there is no more room, else the greatest there is.
    last_hash: u64,
    /// Whether a key was left out.
    pub overflowed: bool,
}

impl<K, V, const LIMIT: usize> Default for Sample<K, V, LIMIT> {
    fn default() -> Self {
        Self { slots: Vec::new(), order: Vec::new(), last_hash: u64::MAX, overflowed: false }
    }
}

/// Two are equal that have the same entries, whatever the order in which they came.
impl<K: Ord + Clone, V: Default + PartialEq, const LIMIT: usize> PartialEq for Sample<K, V, LIMIT> {
    fn eq(&self, other: &Self) -> bool {
        self.overflowed == other.overflowed && self.len() == other.len() && self.entries().eq(other.entries())
    }
}

impl<K: Ord + Clone, V: Default, const LIMIT: usize> Sample<K, V, LIMIT> {
    /// The entry of a key, which is added if it is new; `None` if there is no room for it.
    pub fn entry(&mut self, hash: u64, key: K) -> Option<&mut V> {
        let at = self.slot(hash, key)?;
        Some(&mut self.slots[at].1)
    }

    /// The place of a key's entry, which is added if it is new; `None` if there is no room for it. A place stays that of its
    /// key until the key has to make room for another one: `at` says so.
    pub fn slot(&mut self, hash: u64, key: K) -> Option<usize> {
        if self.refuses(hash, &key) {
            self.overflowed = true;
            return None;
        }
        let place = self.order.binary_search_by(|(own, at)| own.cmp(&hash).then_with(|| self.slots[*at as usize].0.cmp(&key)));
        let place = match place {
            Ok(found) => return Some(self.order[found].1 as usize),
            Err(place) => place,
        };
        let entry = (key, V::default());
        let at = if self.slots.len() < LIMIT {
            self.slots.push(entry);
            self.slots.len() - 1
        } else {
            self.overflowed = true;
            let (_, at) = self.order.pop()?;
            self.slots[at as usize] = entry;
            at as usize
        };
        self.order.insert(place, (hash, at as u32));
        self.note_last();
        Some(at)
    }

    fn note_last(&mut self) {
        let last = self.order.last().filter(|_| self.slots.len() >= LIMIT);
        self.last_hash = last.map_or(u64::MAX, |(hash, _)| *hash);
    }

    /// Whether keys with this hash are beyond those that there is room for; that one was left out is noted then.
    #[inline]
    pub fn is_beyond(&mut self, hash: u64) -> bool {
        let is_beyond = hash > self.last_hash;
        self.overflowed |= is_beyond;
        is_beyond
    }

    /// Whether a key is beyond those that there is room for.
    #[inline]
    fn refuses(&self, hash: u64, key: &K) -> bool {
        if hash != self.last_hash || self.slots.len() < LIMIT {
            return hash > self.last_hash;
        }
        self.order.last().is_some_and(|(_, at)| self.slots[*at as usize].0 < *key)
    }

    /// The entry at this place, if it is still that of this key.
    #[inline]
    pub fn at(&mut self, slot: usize, key: &K) -> Option<&mut V> {
        self.slots.get_mut(slot).filter(|(own, _)| own == key).map(|(_, value)| value)
    }

    /// Adds what came later. To merge a value with nothing before it is to take it.
    pub fn merge(&mut self, later: Self, merge: impl Fn(&mut V, &V)) {
        self.overflowed |= later.overflowed;
        let mut slots: Vec<Option<(K, V)>> = later.slots.into_iter().map(Some).collect();
        for (hash, at) in later.order {
            let Some((key, value)) = slots[at as usize].take() else { continue };
            let entries = self.slots.len();
            if let Some(slot) = self.slot(hash, key) {
                if self.slots.len() > entries {
                    self.slots[slot].1 = value;
                } else {
                    merge(&mut self.slots[slot].1, &value);
                }
            }
        }
    }

    /// How many entries there are.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// The hashes of the keys.
    pub fn hashes(&self) -> impl Iterator<Item = u64> + '_ {
        self.order.iter().map(|(hash, _)| *hash)
    }

    /// Leaves out the entries whose hash does not meet this.
    pub fn retain(&mut self, keeps: impl Fn(u64) -> bool) {
        let mut slots: Vec<Option<(K, V)>> = std::mem::take(&mut self.slots).into_iter().map(Some).collect();
        self.order.retain(|(hash, _)| keeps(*hash));
        for (_, at) in &mut self.order {
            self.slots.extend(slots[*at as usize].take());
            *at = self.slots.len() as u32 - 1;
        }
        self.note_last();
    }

    /// The values, in no order.
    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut V> {
        self.slots.iter_mut().map(|(_, value)| value)
    }

    /// The entries, in the order of their keys' hashes.
    pub fn entries(&self) -> impl Iterator<Item = (&K, &V)> + Clone {
        self.order.iter().map(|(_, at)| &self.slots[*at as usize]).map(|(key, value)| (key, value))
    }

    /// The entries, in the order of their keys.
    pub fn sorted(&self) -> Vec<(&K, &V)> {
        let mut all: Vec<(&K, &V)> = self.entries().collect();
        all.sort_by(|one, other| one.0.cmp(other.0));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(keys: impl Iterator<Item = u64>) -> Sample<u64, u64, 4> {
        let mut all = Sample::default();
        for key in keys {
            if let Some(count) = all.entry(key, key) {
                *count += 1;
            }
        }
        all
    }

    #[test]
    fn the_least_hashes_stay_in_whatever_order_they_come() {
        let (up, down) = (sample(1..=9), sample((1..=9).rev()));
        assert_eq!(up, down);
        assert_eq!(up.sorted(), [(&1, &1), (&2, &1), (&3, &1), (&4, &1)]);
        assert!(up.overflowed && !sample(1..=4).overflowed);
    }

    #[test]
    fn a_place_is_that_of_its_key_until_the_key_makes_room() {
        let mut all = sample([1, 2, 3, 9].into_iter());
        let slot = all.slot(9, 9).unwrap();
        *all.at(slot, &9).unwrap() = 7;
        assert_eq!(all.slot(4, 4), Some(slot));
        assert_eq!(all.at(slot, &9), None);
        assert_eq!(all.at(slot, &4).copied(), Some(0));
        all.retain(|hash| hash > 1);
        assert_eq!(all.sorted(), [(&2, &1), (&3, &1), (&4, &0)]);
    }
}
