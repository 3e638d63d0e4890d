//! Where the counters of a request are, by its key.

/// Places at first: a power of two.
const FIRST_PLACES: usize = 16;

/// At most one place of so many is taken, so that a number that is not here is mostly missing at the first look.
const PLACES_PER_NUMBER: usize = 4;

/// Indices of numbers that somebody else keeps, in the order in which they came.
#[derive(Clone, Debug, Default)]
pub(super) struct RequestIndices {
    /// For each place, the index of a number plus one; 0 where there is none. A number is at the place of its hash, or
    /// after places that were taken.
    places: Vec<u16>,
}

impl RequestIndices {
    /// The place where a number is looked for first: the highest bits of its product with an odd number without pattern.
    #[inline]
    fn first_place(&self, number: u64) -> usize {
        (number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 48) as usize & self.places.len().wrapping_sub(1)
    }

    /// The index of a number; `number_at` says which one has an index.
    #[inline]
    pub fn find(&self, number: u64, number_at: impl Fn(usize) -> u64) -> Option<usize> {
        let mut place = self.first_place(number);
        loop {
            let index = usize::from(*self.places.get(place)?).checked_sub(1)?;
            if number_at(index) == number {
                return Some(index);
            }
            place = (place + 1) & (self.places.len() - 1);
        }
    }

    /// Adds the last one of so many numbers, which is not among the others.
    pub fn add(&mut self, count: usize, number_at: impl Fn(usize) -> u64) {
        if PLACES_PER_NUMBER * count <= self.places.len() {
            self.put(count - 1, number_at(count - 1));
            return;
        }
        let places = (2 * self.places.len()).max(FIRST_PLACES);
        self.places.clear();
        self.places.resize(places, 0);
        for index in 0..count {
            self.put(index, number_at(index));
        }
    }

    fn put(&mut self, index: usize, number: u64) {
        let mut place = self.first_place(number);
        while self.places[place] != 0 {
            place = (place + 1) & (self.places.len() - 1);
        }
        self.places[place] = index as u16 + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        #[test]
        fn what_was_added_is_found_where_it_is(keys in proptest::collection::vec(0u64..2000, 1..1500)) {
            let (mut indices, mut oracle, mut kept) = (RequestIndices::default(), HashMap::new(), Vec::new());
            for key in keys {
                prop_assert_eq!(indices.find(key, |at| kept[at]), oracle.get(&key).copied());
                oracle.entry(key).or_insert_with(|| {
                    kept.push(key);
                    indices.add(kept.len(), |at| kept[at]);
                    kept.len() - 1
                });
            }
            prop_assert!(indices.places.len() >= PLACES_PER_NUMBER * kept.len());
        }
    }
}
