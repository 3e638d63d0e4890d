//! Rows of transactions that wait: in a recording they are given out in the order of requests, so that those behind a request
//! that is still open have to wait for it.

use crate::records::{Batch, Span, Transaction};
use crate::session::sources::CaptureState;
use crate::session::Session;

/// Transactions that may wait for an older one; beyond it they are written all the same, out of order.
const MAX_HELD_TRANSACTIONS: usize = 65_536;

/// Rows that are kept are copied. Where there are more than this, the next ones are given out together with many others.
const MAX_COPIED_EACH_TIME: usize = 512;

/// So many new rows are enough to copy those that are kept, however many these are.
const ENOUGH_NEW_ROWS: usize = 8192;

/// Rows that have come too late are put into their places one by one, as long as this moves each of all rows so often on
/// average.
const MAX_SHIFTS: usize = 4;

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

    /// How many of the first transactions in `held` may be given out.
    ///
    /// In a recording `held` is sorted by number, in the order of the requests, and those in front of the oldest transaction
    /// that is still open are ready. In a live session, and in a recording where more than `MAX_HELD_TRANSACTIONS` are held,
    /// all of them are, as they were emitted.
    pub(super) fn ready_rows(&mut self) -> usize {
        if self.live || self.held.len() > MAX_HELD_TRANSACTIONS {
            return self.held.len();
        }
        let oldest = self.oldest_open().unwrap_or(u64::MAX);
        sort(&mut self.held, self.kept);
        self.held.partition_point(|row| row.number < oldest)
    }

    /// Copies the bytes and findings of the transactions that are kept for a later call to the next batch, and lets the rows
    /// refer to the copies. `from` is the batch that is given out. A PDU that is a part of the bytes on the wire stays one.
    pub(super) fn copy_held_bytes(&mut self, from: &Batch) {
        for row in &mut self.held {
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

/// Sorts rows by number, which they are but for a few: a request without a response is known as such when the next ones are. To
/// put these few where they belong costs far less than a sort, which moves all rows several times.
///
/// The first `sorted` rows are in order.
fn sort(rows: &mut [Transaction], sorted: usize) {
    let mut moved = 0;
    for at in sorted.max(1)..rows.len() {
        let number = rows[at].number;
        if rows[at - 1].number <= number {
            continue;
        }
        let place = rows[..at].partition_point(|row| row.number <= number);
        moved += at - place;
        if moved > MAX_SHIFTS * rows.len() {
            rows.sort_by_key(|row| row.number);
            return;
        }
        rows[place..=at].rotate_right(1);
    }
}
