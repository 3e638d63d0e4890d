//! The last transactions of a bus with their data, which may come again as the answer to another request.

use crate::clean::Exchanges;
use crate::observation::{Data, RequestKey};

/// Transactions that are remembered.
pub(super) const RECENT: u64 = 48;

/// Room for them: a power of two, so that a place is found without a division.
const PLACES: u64 = 64;

/// A transaction: to which request data came, and which.
type Answer = Option<(RequestKey, Data)>;

/// What is remembered of a transaction.
#[derive(Clone, Copy, Debug)]
pub(super) enum Remembered {
    /// What it read.
    Answer(Answer),
    /// The compact exchange with this index in its batch: most are forgotten before somebody asks what they have read.
    Exchange(u32),
}

/// The last transactions.
#[derive(Clone, Debug, Default)]
pub(super) struct RecentAnswers {
    places: Vec<Remembered>,
    /// How many there were.
    count: u64,
    /// How many there were when their exchanges were looked up.
    looked_up: u64,
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
        self.remember(Remembered::Answer(answer));
    }

    /// Remembers a transaction.
    #[inline]
    pub fn remember(&mut self, transaction: Remembered) {
        if self.places.is_empty() {
            self.places.resize(PLACES as usize, Remembered::Answer(None));
        }
        self.places[(self.count % PLACES) as usize] = transaction;
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

    /// How many are remembered.
    #[inline]
    fn len(&self) -> u64 {
        self.count.min(RECENT)
    }

    /// Looks up what the exchanges of this batch among them have read. That has to be done before anything is asked, and before
    /// the next batch.
    pub fn look_up(&mut self, exchanges: &Exchanges<'_>) {
        let first = self.looked_up.max(self.count - self.len());
        self.looked_up = self.count;
        for number in first..self.count {
            let place = &mut self.places[(number % PLACES) as usize];
            if let Remembered::Exchange(index) = *place {
                *place = Remembered::Answer(exchanges.read(index));
            }
        }
    }

    /// The number of the last transaction with data of this request, and these.
    pub fn last_of(&self, key: RequestKey) -> Option<(u64, Data)> {
        let mut numbered = (1..=self.count).rev().zip(self.newest_first());
        numbered.find_map(|(number, answer)| answer.filter(|(own, _)| *own == key).map(|(_, data)| (number, data)))
    }

    /// All of them, the last one first.
    pub fn newest_first(&self) -> impl Iterator<Item = Answer> + '_ {
        (1..=self.len()).map(|age| match self.places[((self.count - age) % PLACES) as usize] {
            Remembered::Answer(answer) => answer,
            Remembered::Exchange(..) => unreachable!("exchanges are looked up before somebody asks"),
        })
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
        let answer = |address: u16| Some((key(address), Data::default()));
        (0..200).for_each(|address| recent.push(answer(address)));
        assert!(recent.newest_first().eq((152..200).rev().map(answer)));
        assert_eq!((recent.last_of(key(152)), recent.last_of(key(151))), (Some((153, Data::default())), None));
    }
}
