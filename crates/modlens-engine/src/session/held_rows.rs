//! Rows that wait for older ones, and how they get into the order of their numbers.

use std::collections::VecDeque;

use crate::records::Transaction;

/// Rows of transactions. In a recording they wait here for older transactions that are still open.
#[derive(Default)]
pub(crate) struct HeldRows {
    /// Those that came in the order of their numbers; in a live session all of them.
    rows: VecDeque<Transaction>,
    /// Those that are older than others that came before. A request without a response is known as such when the next ones are.
    late: Vec<Transaction>,
    /// Rows are given out as they come.
    live: bool,
}

impl HeldRows {
    pub(super) fn new(live: bool) -> Self {
        Self { live, ..Self::default() }
    }

    pub(super) fn len(&self) -> usize {
        self.rows.len() + self.late.len()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Transaction> {
        self.rows.iter().chain(&self.late)
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Transaction> {
        self.rows.iter_mut().chain(&mut self.late)
    }

    /// Adds a row.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A row is large, and the caller makes it in its place.
    pub(crate) fn push(&mut self, row: Transaction) {
        if !self.live && self.rows.back().is_some_and(|last| last.number > row.number) {
            self.late.push(row);
        } else {
            self.rows.push_back(row);
        }
    }

    /// Moves the rows whose number is less than `oldest` behind those in `to`; in a live session all of them.
    ///
    /// Each late row is put into its place on this way. To put it there before would move all that have waited for it.
    pub(super) fn give_out(&mut self, oldest: u64, to: &mut Vec<Transaction>) {
        if self.late.is_empty() && to.is_empty() && self.rows.back().is_none_or(|last| self.live || last.number < oldest) {
            *to = std::mem::replace(&mut self.rows, std::mem::take(to).into()).into();
            return;
        }
        self.late.sort_by_key(|row| row.number);
        let ready = self.late.partition_point(|row| row.number < oldest);
        for late in self.late.drain(..ready) {
            let place = self.rows.partition_point(|row| row.number <= late.number);
            to.extend(self.rows.drain(..place));
            to.push(late);
        }
        let ready = if self.live { self.rows.len() } else { self.rows.partition_point(|row| row.number < oldest) };
        to.extend(self.rows.drain(..ready));
    }
}
