//! Transactions whose annotation has not been written to a packet yet, found by their numbers, which are mostly
//! consecutive.

use std::collections::VecDeque;
use std::sync::Arc;

use modlens_engine::records::Batch;

/// The position of a row: the number of its batch, counted from the first one, and its index in the batch.
type RowPosition = (u64, u32);

/// Rows by transaction number. Finding one takes a subtraction, and a batch is kept alive by one reference for all of
/// its rows.
#[derive(Debug, Default)]
pub struct PendingAnnotations {
    /// The transaction number of the first element of `rows`.
    first: u64,
    rows: VecDeque<Option<RowPosition>>,
    /// The batches of these rows, oldest first, with the number of their rows that are still here.
    batches: VecDeque<(Arc<Batch>, usize)>,
    /// The number of batches that were dropped.
    dropped_batches: u64,
}

impl PendingAnnotations {
    /// The index in `rows` of a transaction number.
    fn place(&self, number: u64) -> Option<usize> {
        usize::try_from(number.checked_sub(self.first)?).ok().filter(|&at| at < self.rows.len())
    }

    /// Adds the row at index `at` of a batch, whose number must be new.
    pub fn insert(&mut self, number: u64, batch: &Arc<Batch>, at: usize) {
        if self.batches.back().is_none_or(|(newest, _)| !Arc::ptr_eq(newest, batch)) {
            self.batches.push_back((Arc::clone(batch), 0));
        }
        let newest = self.dropped_batches + self.batches.len() as u64 - 1;
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

    /// The batch and the index of the transaction with this number.
    pub fn get(&self, number: u64) -> Option<(&Batch, usize)> {
        let (batch, at) = self.rows[self.place(number)?]?;
        Some((self.batch(batch), at as usize))
    }

    /// The batch with this number.
    fn batch(&self, number: u64) -> &Batch {
        &self.batches[(number - self.dropped_batches) as usize].0
    }

    /// Removes the transaction with this number, if it is present.
    pub fn remove(&mut self, number: u64) {
        if let Some((batch, _)) = self.place(number).and_then(|place| self.rows[place].take()) {
            self.batches[(batch - self.dropped_batches) as usize].1 -= 1;
            self.drop_unused();
        }
    }

    /// Removes the transactions for which `keep` returns false.
    pub fn retain(&mut self, keep: impl Fn(&Batch, usize) -> bool) {
        for place in 0..self.rows.len() {
            let Some((batch, at)) = self.rows[place] else { continue };
            if !keep(self.batch(batch), at as usize) {
                self.rows[place] = None;
                self.batches[(batch - self.dropped_batches) as usize].1 -= 1;
            }
        }
        self.drop_unused();
    }

    /// Drops empty elements at the front, and batches without rows.
    fn drop_unused(&mut self) {
        while let Some(None) = self.rows.front() {
            self.rows.pop_front();
            self.first += 1;
        }
        while let Some((_, 0)) = self.batches.front() {
            self.batches.pop_front();
            self.dropped_batches += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with a plain list of the numbers that were added and removed.
    #[test]
    fn numbers_can_be_added_and_removed_in_any_order() {
        let mut pending = PendingAnnotations::default();
        let batches = [Arc::new(Batch::default()), Arc::new(Batch::default())];
        for (at, number) in [7, 9, 3, 8, 20].into_iter().enumerate() {
            pending.insert(number, &batches[at / 3], at);
        }
        let held = || batches.each_ref().map(|batch| Arc::strong_count(batch) - 1);
        for number in 0..30 {
            let at = [7, 9, 3, 8, 20].iter().position(|known| *known == number);
            assert_eq!(pending.get(number).map(|(_, at)| at), at);
            if let (Some((batch, _)), Some(at)) = (pending.get(number), at) {
                assert!(std::ptr::eq(batch, &raw const *batches[at / 3]));
            }
        }
        assert_eq!(held(), [1, 1]);
        for number in [3, 9, 7] {
            pending.remove(number);
            assert!(pending.get(number).is_none());
            pending.remove(number);
        }
        assert_eq!(held(), [0, 1], "a batch without rows here is let go of");
        assert_eq!(pending.rows.len(), 13, "nothing is kept before the oldest one, which is 8");
        pending.retain(|_, at| at == 4);
        assert!(pending.get(8).is_none() && pending.get(20).is_some());
        pending.remove(20);
        assert!(pending.get(20).is_none() && pending.rows.is_empty());
        assert_eq!(held(), [0, 0]);
    }
}
