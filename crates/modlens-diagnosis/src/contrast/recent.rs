//! The last transactions of a bus with their data, which may come again as the answer to another request.

use crate::observation::{Data, RequestKey};

/// Transactions that are remembered.
pub(super) const RECENT: usize = 48;

/// Room for them: a power of two, so that a place is found without a division.
const PLACES: usize = 64;

/// A transaction: to which request data came, and which.
type Answer = Option<(RequestKey, Data)>;

/// The last transactions.
#[derive(Clone, Debug, Default)]
pub(super) struct RecentAnswers {
    places: Vec<Answer>,
    /// How many there were.
    count: usize,
}

/// Two are equal that remember the same.
impl PartialEq for RecentAnswers {
    fn eq(&self, other: &Self) -> bool {
        self.newest_first().eq(other.newest_first())
    }
}

impl RecentAnswers {
    /// Remembers a transaction, and forgets the oldest one.
    #[inline]
    pub fn push(&mut self, answer: Answer) {
        if self.places.is_empty() {
            self.places.resize(PLACES, None);
        }
        self.places[self.count % PLACES] = answer;
        self.count += 1;
    }

    /// How many are remembered.
    #[inline]
    fn len(&self) -> usize {
        self.count.min(RECENT)
    }

    /// The transaction so many places back, 1 for the last one.
    #[inline]
    pub fn at_age(&self, age: usize) -> Answer {
        if age == 0 || age > self.len() {
            return None;
        }
        self.places[(self.count - age) % PLACES]
    }

    /// The last transaction with data of this request.
    #[inline(never)]
    pub fn last_of(&self, key: RequestKey) -> Answer {
        self.newest_first().find(|answer| answer.is_some_and(|(own, _)| own == key)).flatten()
    }

    /// All of them, the last one first.
    pub fn newest_first(&self) -> impl Iterator<Item = Answer> + '_ {
        (1..=self.len()).map(|age| self.at_age(age))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_ones_are_remembered() {
        let mut recent = RecentAnswers::default();
        assert_eq!((recent.at_age(1), recent.newest_first().count()), (None, 0));
        let answer = |address: u16| Some((RequestKey { unit: 1, function: 3, address, quantity: 1 }, Data::default()));
        (0..200).for_each(|address| recent.push(answer(address)));
        assert_eq!((recent.at_age(0), recent.at_age(1), recent.at_age(48)), (None, answer(199), answer(152)));
        assert_eq!(recent.at_age(49), None);
        assert!(recent.newest_first().eq((152..200).rev().map(answer)));
    }
}
