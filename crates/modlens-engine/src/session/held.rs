//! Rows of transactions that wait: in a recording they are given out in the order of requests, so that those behind a request
//! that is still open have to wait for it.

use std::collections::VecDeque;

use crate::records::{Batch, Span, Transaction};
use crate::session::sources::CaptureState;
use crate::session::Session;

/// Transactions that may wait for an older one; beyond it they are written all the same, out of order.
const MAX_HELD_TRANSACTIONS: usize = 65_536;

/// Rows that are kept are copied. Where there are more than this, the next ones are given out together with many others.
const MAX_COPIED_EACH_TIME: usize = 512;

/// So many new rows are enough to copy those that are kept, however many these are.
const ENOUGH_NEW_ROWS: usize = 8192;

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
    fn give_out(&mut self, oldest: u64, to: &mut Vec<Transaction>) {
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

impl Session {
    /// Whether so many rows were kept by the last `take` that to copy them again is not worth the few that are new. Nothing
    /// waits once all requests are closed, as they are at the end of a recording.
    pub(super) fn waits_for_more(&self) -> bool {
        let is_much_to_copy = !self.live && self.kept > MAX_COPIED_EACH_TIME;
        is_much_to_copy && self.held.len() - self.kept < self.kept.min(ENOUGH_NEW_ROWS) && self.oldest_open().is_some()
    }

    /// Number of the oldest transaction that is still open.
    fn oldest_open(&self) -> Option<u64> {
        let reimported = self.captures.iter().flatten().filter_map(CaptureState::oldest);
        let open = self.open.iter().filter_map(|&bus| self.buses[bus].pairing.oldest_open_txn());
        open.chain(reimported).min()
    }

    /// Moves the transactions that may be given out from `held` to a batch.
    ///
    /// In a recording these are the ones in front of the oldest transaction that is still open, in the order of their requests.
    /// In a live session, and in a recording where more than `MAX_HELD_TRANSACTIONS` are held, all of them are.
    pub(super) fn give_out_rows(&mut self, batch: &mut Batch) {
        let is_all = self.live || self.held.len() > MAX_HELD_TRANSACTIONS;
        let oldest = self.oldest_open().filter(|_| !is_all).unwrap_or(u64::MAX);
        self.held.give_out(oldest, &mut batch.transactions);
    }

    /// Copies the bytes and findings of the transactions that are kept for a later call to the next batch, and lets the rows
    /// refer to the copies. `from` is the batch that is given out. A PDU that is a part of the bytes on the wire stays one.
    pub(super) fn copy_held_bytes(&mut self, from: &Batch) {
        for row in self.held.rows.iter_mut().chain(&mut self.held.late) {
            row.findings = self.batch.store_findings(row.findings.of(&from.codes));
            for half in [&mut row.request, &mut row.response] {
                let inside = half.pdu.start.wrapping_sub(half.wire.start);
                let wire = self.batch.store(half.wire.of(&from.arena));
                half.pdu = if inside < half.wire.length.max(1) {
                    Span { start: wire.start + inside, length: half.pdu.length }
                } else {
                    self.batch.store(half.pdu.of(&from.arena))
                };
                half.wire = wire;
            }
        }
    }
}
