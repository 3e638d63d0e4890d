//! Rows of transactions that wait: in a recording they are returned in the order of requests, so that those after a request
//! that is still open have to wait for it.

use crate::records::Batch;
use crate::session::sources::CaptureState;
use crate::session::Session;

/// Transactions that may wait for an older one; beyond it they are written all the same, out of order.
const MAX_HELD_TRANSACTIONS: usize = 65_536;

/// Rows that are kept are copied. Where there are more than this, the next ones are returned together with many others.
const MAX_COPIED_EACH_TIME: usize = 512;

/// So many new rows are enough to copy those that are kept, however many these are.
const ENOUGH_NEW_ROWS: usize = 8192;

impl Session {
    /// Whether so many rows were kept by the last `take` that to copy them again is not worth the few that are new. Nothing
    /// waits once all requests are closed, as they are at the end of a recording.
    pub(super) fn waits_for_more(&self) -> bool {
        let is_much_to_copy = !self.decoder.live && self.kept > MAX_COPIED_EACH_TIME;
        is_much_to_copy && self.decoder.held.len() - self.kept < self.kept.min(ENOUGH_NEW_ROWS) && self.oldest_open().is_some()
    }

    /// Number of the oldest transaction that is still open.
    fn oldest_open(&self) -> Option<u64> {
        let reimported = self.captures.iter().flatten().filter_map(CaptureState::oldest);
        let open = self.decoder.open.iter().filter_map(|&bus| self.decoder.buses[bus].pairing.oldest_open_txn());
        open.chain(reimported).min()
    }

    /// Moves the transactions that may be returned from `held` to a batch.
    ///
    /// In a recording these are the ones in front of the oldest transaction that is still open, in the order of their requests.
    /// In a live session, and in a recording where more than `MAX_HELD_TRANSACTIONS` are held, all of them are.
    pub(super) fn give_out_rows(&mut self, batch: &mut Batch) {
        let is_all = self.decoder.live || self.decoder.held.len() > MAX_HELD_TRANSACTIONS;
        let oldest = self.oldest_open().filter(|_| !is_all).unwrap_or(u64::MAX);
        self.decoder.held.give_out(oldest, batch);
    }
}
