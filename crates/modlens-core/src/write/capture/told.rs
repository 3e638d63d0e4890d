//! Transactions whose words no packet has yet, by their numbers, which mostly count up.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::records::{Batch, Transaction};

/// Where the row of a transaction is.
type Row = (Arc<Batch>, usize);

/// Rows by number: a look-up is a subtraction.
#[derive(Debug, Default)]
pub struct Told {
    /// The number of the first place.
    first: u64,
    rows: VecDeque<Option<Row>>,
}

impl Told {
    fn place(&self, number: u64) -> Option<usize> {
        usize::try_from(number.checked_sub(self.first)?).ok().filter(|&at| at < self.rows.len())
    }

    /// Remembers the row with this index of a batch.
    pub fn insert(&mut self, batch: &Arc<Batch>, at: usize) {
        let number = batch.transactions[at].number;
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
            self.rows[place] = Some((Arc::clone(batch), at));
        }
    }

    /// The transaction of this number.
    pub fn get(&self, number: u64) -> Option<&Transaction> {
        let (batch, at) = self.rows[self.place(number)?].as_ref()?;
        Some(&batch.transactions[*at])
    }

    /// Its row, which is forgotten.
    pub fn remove(&mut self, number: u64) -> Option<Row> {
        let place = self.place(number)?;
        let found = self.rows[place].take();
        self.shorten();
        found
    }

    /// Forgets those for which `keep` says no.
    pub fn retain(&mut self, keep: impl Fn(&Transaction) -> bool) {
        for place in &mut self.rows {
            if place.as_ref().is_some_and(|(batch, at)| !keep(&batch.transactions[*at])) {
                *place = None;
            }
        }
        self.shorten();
    }

    fn shorten(&mut self) {
        while let Some(None) = self.rows.front() {
            self.rows.pop_front();
            self.first += 1;
        }
    }
}
