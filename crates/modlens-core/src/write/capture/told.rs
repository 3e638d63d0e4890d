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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framer::Mode;
    use crate::records::{Half, Span, Status};

    fn batch(numbers: &[u64]) -> Arc<Batch> {
        let row = |&number: &u64| Transaction {
            number,
            bus: 0,
            mode: Mode::Rtu,
            start: None,
            elapsed: None,
            unit: 1,
            function: 3,
            status: Status::Ok,
            exception: None,
            response_time: None,
            waited: None,
            late_response: None,
            retry_of: None,
            late_for: None,
            gap: None,
            mbap_id: None,
            request: Half::default(),
            response: Half::default(),
            findings: Span::default(),
            points: None,
            origin: 0,
        };
        let mut batch = Batch::default();
        batch.transactions = numbers.iter().map(row).collect();
        Arc::new(batch)
    }

    /// Against a plain list of what was put in and taken out.
    #[test]
    fn numbers_come_and_go_in_any_order() {
        let mut told = Told::default();
        let batch = batch(&[7, 9, 3, 8, 20]);
        (0..5).for_each(|at| told.insert(&batch, at));
        for number in 0..30 {
            let there = [3, 7, 8, 9, 20].contains(&number);
            assert_eq!(told.get(number).map(|row| row.number), there.then_some(number));
        }
        for (number, at) in [(3, 2), (9, 1), (7, 0)] {
            assert_eq!(told.remove(number).map(|(_, at)| at), Some(at));
            assert!(told.get(number).is_none() && told.remove(number).is_none());
        }
        assert_eq!(told.rows.len(), 13, "nothing is kept before the oldest one, which is 8");
        told.retain(|row| row.number > 8);
        assert!(told.get(8).is_none() && told.get(20).is_some());
        assert!(told.remove(20).is_some() && told.rows.is_empty());
    }
}
