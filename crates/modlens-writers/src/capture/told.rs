//! Transactions whose words no packet has yet, by their numbers, which mostly count up.

use std::collections::VecDeque;
use std::sync::Arc;

use modlens_engine::records::Batch;

/// Where a row is: which batch since the first one, and the row's index in it.
type Place = (u64, u32);

/// Rows by number: a look-up is a subtraction, and batches are counted, not held by every row of theirs.
#[derive(Debug, Default)]
pub struct Told {
    /// The number of the first place.
    first: u64,
    rows: VecDeque<Option<Place>>,
    /// The batches of these rows, the oldest first, and how many rows of each there are.
    batches: VecDeque<(Arc<Batch>, usize)>,
    /// Batches that were let go of.
    gone: u64,
}

impl Told {
    fn place(&self, number: u64) -> Option<usize> {
        usize::try_from(number.checked_sub(self.first)?).ok().filter(|&at| at < self.rows.len())
    }

    /// Remembers the row with this index of a batch under its number, which is not there yet.
    pub fn insert(&mut self, number: u64, batch: &Arc<Batch>, at: usize) {
        if self.batches.back().is_none_or(|(newest, _)| !Arc::ptr_eq(newest, batch)) {
            self.batches.push_back((Arc::clone(batch), 0));
        }
        let newest = self.gone + self.batches.len() as u64 - 1;
        if let Some((_, rows)) = self.batches.back_mut() {
            *rows += 1;
        }
        if self.rows.is_empty() {
            self.first = number;
        }
        while number < self.first {
            self.rows.push_front(None);
            self.first -= 1;
        }
        while self.place(number).is_none() {
            self.rows.push_back(None);
        }
        if let Some(place) = self.place(number) {
            self.rows[place] = Some((newest, at as u32));
        }
    }

    /// Batch and index of the transaction of this number.
    pub fn get(&self, number: u64) -> Option<(&Batch, usize)> {
        let (batch, at) = self.rows[self.place(number)?]?;
        Some((self.batch(batch), at as usize))
    }

    fn batch(&self, number: u64) -> &Batch {
        &self.batches[(number - self.gone) as usize].0
    }

    /// Forgets it.
    pub fn remove(&mut self, number: u64) {
        if let Some((batch, _)) = self.place(number).and_then(|place| self.rows[place].take()) {
            self.batches[(batch - self.gone) as usize].1 -= 1;
            self.shorten();
        }
    }

    /// Forgets those for which `keep` says no.
    pub fn retain(&mut self, keep: impl Fn(&Batch, usize) -> bool) {
        for place in 0..self.rows.len() {
            let Some((batch, at)) = self.rows[place] else { continue };
            if !keep(self.batch(batch), at as usize) {
                self.rows[place] = None;
                self.batches[(batch - self.gone) as usize].1 -= 1;
            }
        }
        self.shorten();
    }

    fn shorten(&mut self) {
        while let Some(None) = self.rows.front() {
            self.rows.pop_front();
            self.first += 1;
        }
        while let Some((_, 0)) = self.batches.front() {
            self.batches.pop_front();
            self.gone += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a plain list of what was put in and taken out.
    #[test]
    fn numbers_come_and_go_in_any_order() {
        let mut told = Told::default();
        let batches = [Arc::new(Batch::default()), Arc::new(Batch::default())];
        for (at, number) in [7, 9, 3, 8, 20].into_iter().enumerate() {
            told.insert(number, &batches[at / 3], at);
        }
        let held = || batches.each_ref().map(|batch| Arc::strong_count(batch) - 1);
        for number in 0..30 {
            let at = [7, 9, 3, 8, 20].iter().position(|known| *known == number);
            assert_eq!(told.get(number).map(|(_, at)| at), at);
            if let (Some((batch, _)), Some(at)) = (told.get(number), at) {
                assert!(std::ptr::eq(batch, &raw const *batches[at / 3]));
            }
        }
        assert_eq!(held(), [1, 1]);
        for number in [3, 9, 7] {
            told.remove(number);
            assert!(told.get(number).is_none());
            told.remove(number);
        }
        assert_eq!(held(), [0, 1], "a batch without rows here is let go of");
        assert_eq!(told.rows.len(), 13, "nothing is kept before the oldest one, which is 8");
        told.retain(|_, at| at == 4);
        assert!(told.get(8).is_none() && told.get(20).is_some());
        told.remove(20);
        assert!(told.get(20).is_none() && told.rows.is_empty());
        assert_eq!(held(), [0, 0]);
    }
}
