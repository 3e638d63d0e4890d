//! The last transactions of a bus with their data, which may come again as the answer to another request.

use crate::observation::{Data, RequestKey, COMPARED_BYTES};

/// Transactions that are remembered.
pub(super) const RECENT: u64 = 48;

/// Room for them: a power of two, so that a place is found without a division.
const PLACES: usize = 64;

/// What is remembered of the data that a request was answered with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Answer {
    /// The request as a number.
    request: u64,
    /// The first two registers (`Data::head`).
    pub head: [u16; 2],
    /// The first bytes, if there are so many.
    opening: [u8; COMPARED_BYTES],
    /// How many bytes there are; 0 stands for a transaction that has read nothing.
    pub length: u16,
}

impl Answer {
    /// What a request was answered with.
    #[inline]
    pub fn new(request: u64, data: Data) -> Self {
        Self { request, head: data.head, opening: data.opening.unwrap_or_default(), length: data.length }
    }

    /// The request.
    pub fn key(&self) -> RequestKey {
        RequestKey::of_number(self.request)
    }

    /// Whether it begins like these data, of which there are enough.
    pub fn begins_like(&self, data: Data) -> bool {
        usize::from(self.length) >= COMPARED_BYTES && Some(self.opening) == data.opening
    }
}

/// The last transactions.
#[derive(Clone, Debug)]
pub(super) struct RecentAnswers {
    places: [Answer; PLACES],
    /// How many there were.
    count: u64,
}

impl Default for RecentAnswers {
    fn default() -> Self {
        Self { places: [Answer::default(); PLACES], count: 0 }
    }
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
        self.places[self.count as usize % PLACES] = answer;
        self.count += 1;
    }

    /// How many there were, which is the number of the last one.
    #[inline]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The number of the next one.
    #[inline]
    pub fn next_number(&self) -> u64 {
        self.count + 1
    }

    /// The number of the last transaction with data of this request, and these.
    pub fn last_of(&self, key: RequestKey) -> Option<(u64, Answer)> {
        let request = key.number();
        let mut numbered = (1..=self.count).rev().zip(self.newest_first());
        numbered.find(|(_, answer)| answer.request == request && answer.length > 0)
    }

    /// All of them, the last one first.
    pub fn newest_first(&self) -> impl Iterator<Item = Answer> + '_ {
        (1..=self.count.min(RECENT)).map(|age| self.places[(self.count - age) as usize % PLACES])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_ones_are_remembered() {
        let mut recent = RecentAnswers::default();
        assert_eq!(recent.newest_first().count(), 0);
        let key = |address: u16| RequestKey { unit: 1, function: 3, address, quantity: 1 };
        let answer = |address: u16| Answer::new(key(address).number(), Data { length: 2, ..Data::default() });
        (0..200).for_each(|address| recent.push(answer(address)));
        assert!(recent.newest_first().eq((152..200).rev().map(answer)));
        assert_eq!((recent.last_of(key(152)), recent.last_of(key(151))), (Some((153, answer(152))), None));
    }
}
