//! What a session has emitted, as a whole.

use std::mem::take;
use std::sync::{Arc, Mutex, OnceLock};

use crate::findings::REFUSED;
use crate::records::buses::Buses;
use crate::records::connection::Connection;
use crate::records::exchange::{Exchange, ExchangeRun, PacketPair};
use crate::records::rows::{DiagnosisRow, FindingRow, Frame, Span, Transaction};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::Functions;

/// Emitted rows, with the bytes and findings that they refer to.
///
/// A batch returns its vectors to the session when it is dropped: to allocate them again would cost more than most rows.
#[derive(Debug, Default)]
pub struct Batch {
    /// For each bus, what its rows share.
    pub buses: Arc<Buses>,
    /// The table of functions that decodes the PDUs.
    pub functions: Option<Arc<Functions>>,
    /// The bytes of all rows.
    pub arena: Vec<u8>,
    /// The findings of all frames and transactions. In a batch of a session the first is `REFUSED`, to which the rows of all
    /// compact exchanges that were refused refer.
    pub codes: Vec<Finding>,
    /// Frames.
    pub frames: Vec<Frame>,
    /// Transactions, but for compact exchanges: `all_transactions` has both.
    pub transactions: Vec<Transaction>,
    /// Findings.
    pub findings: Vec<FindingRow>,
    /// Compact exchanges, which are not among frames and transactions.
    pub exchanges: Vec<Exchange>,
    /// Times and packets of those that belong to connections, in the same order.
    pub packet_pairs: Vec<PacketPair>,
    /// The same by bus, in the order of their numbers.
    pub exchange_runs: Vec<ExchangeRun>,
    /// TCP connections that are over, in the order in which they began.
    pub connections: Vec<Connection>,
    /// Diagnoses, at the end of a recording.
    pub diagnoses: Vec<DiagnosisRow>,
    /// For frames that came in more than two packets: number of the frame, and of a packet that holds neither its first nor
    /// its last byte.
    pub inner_packets: Vec<(u64, u64)>,
    /// All transactions, once somebody has asked for them.
    expanded: OnceLock<Vec<Transaction>>,
    /// For each bus and kind a compact exchange, once somebody has asked.
    kinds: OnceLock<Vec<(usize, usize)>>,
    /// Whether a profile applies to any of them, once asked for.
    has_points: OnceLock<bool>,
    /// Where its vectors go when it is dropped.
    pub(crate) pool: MemoryPool,
}

/// The vectors of dropped batches, which are filled again.
#[derive(Clone, Debug, Default)]
pub(crate) struct MemoryPool(Arc<Mutex<Vec<Memory>>>);

type Memory = (Vec<u8>, Vec<Finding>, Vec<Frame>, Vec<Transaction>, Vec<FindingRow>, MemoryOfExchanges);

type MemoryOfExchanges = (Vec<Exchange>, Vec<PacketPair>, Vec<ExchangeRun>);

/// Batches whose memory is kept: one is filled while others are written or wait for it.
const MAX_POOLED_BATCHES: usize = 4;

/// A batch with a larger arena is an exception, whose memory is given back to the system.
const MAX_POOLED_BYTES: usize = 1 << 23;

impl MemoryPool {
    /// A batch without rows, with the vectors of a dropped batch if there are any.
    pub(crate) fn batch(&self) -> Batch {
        let mut batch = Batch::default();
        batch.pool = self.clone();
        if let Some(memory) = self.0.lock().ok().and_then(|mut memories| memories.pop()) {
            let exchanges;
            (batch.arena, batch.codes, batch.frames, batch.transactions, batch.findings, exchanges) = memory;
            (batch.exchanges, batch.packet_pairs, batch.exchange_runs) = exchanges;
        }
        batch.codes.push(REFUSED);
        batch
    }
}

impl Batch {
    /// Gives back the memory that no row takes, of a batch that is kept for long.
    pub fn shrink(&mut self) {
        self.arena.shrink_to_fit();
        self.codes.shrink_to_fit();
        self.frames.shrink_to_fit();
        self.transactions.shrink_to_fit();
        self.findings.shrink_to_fit();
        self.exchanges.shrink_to_fit();
        self.packet_pairs.shrink_to_fit();
        self.exchange_runs.shrink_to_fit();
    }
}

impl Drop for Batch {
    /// Gives the vectors of the batch, emptied, back to its session, unless that is gone, has enough of them, or the arena is
    /// too large to be kept. `connections` and `inner_packets`, mostly short, are not among them.
    fn drop(&mut self) {
        // With one reference, the session is gone, or the batch was not made by one.
        if Arc::strong_count(&self.pool.0) == 1 || self.arena.capacity() > MAX_POOLED_BYTES {
            return;
        }
        let Ok(mut memories) = self.pool.0.lock() else { return };
        if memories.len() < MAX_POOLED_BATCHES {
            self.arena.clear();
            self.codes.clear();
            self.frames.clear();
            self.transactions.clear();
            self.findings.clear();
            self.exchanges.clear();
            self.packet_pairs.clear();
            self.exchange_runs.clear();
            memories.push((
                take(&mut self.arena),
                take(&mut self.codes),
                take(&mut self.frames),
                take(&mut self.transactions),
                take(&mut self.findings),
                (take(&mut self.exchanges), take(&mut self.packet_pairs), take(&mut self.exchange_runs)),
            ));
        }
    }
}

impl Batch {
    /// Copies bytes into the arena.
    pub fn store(&mut self, bytes: &[u8]) -> Span {
        let start = self.arena.len() as u32;
        self.arena.extend_from_slice(bytes);
        Span { start, length: bytes.len() as u32 }
    }

    /// The range of bytes that are a slice of the arena of this batch; of any other slice the range means nothing.
    pub fn span_of(&self, bytes: &[u8]) -> Span {
        let start = (bytes.as_ptr() as usize).wrapping_sub(self.arena.as_ptr() as usize);
        Span { start: start as u32, length: bytes.len() as u32 }
    }

    /// The transactions in the order of their numbers, compact exchanges as rows as well.
    ///
    /// These rows are made when this is first called. Where the rows are read once, one after the other, it is cheaper to make
    /// them one by one (`compact_row`).
    pub fn all_transactions(&self) -> &[Transaction] {
        if self.exchange_runs.is_empty() {
            return &self.transactions;
        }
        self.expanded.get_or_init(|| {
            let mut all = Vec::with_capacity(self.transaction_count());
            for part in self.transaction_parts() {
                match part {
                    Part::Rows(rows) => all.extend_from_slice(rows),
                    Part::Compact(run) => {
                        all.extend((0..run.exchanges.length as usize).map(|at| self.compact_row(run, at)));
                    }
                }
            }
            all
        })
    }

    /// The row of the compact exchange at this place of a run.
    #[inline]
    pub fn compact_row(&self, run: &ExchangeRun, at: usize) -> Transaction {
        run.transaction(&self.exchanges, &self.packet_pairs, at)
    }

    /// A compact exchange for each bus and kind (`Exchange::kind`): index of its run, and its place there.
    pub fn exchange_kinds(&self) -> &[(usize, usize)] {
        self.kinds.get_or_init(|| {
            let mut kinds = Vec::new();
            for (index, run) in self.exchange_runs.iter().enumerate() {
                let mut seen = [false; Exchange::KINDS];
                for (at, exchange) in run.exchanges.of(&self.exchanges).iter().enumerate() {
                    if !std::mem::replace(&mut seen[exchange.kind()], true) {
                        kinds.push((index, at));
                    }
                }
            }
            kinds
        })
    }

    /// Whether a profile applies to the unit of a compact exchange.
    pub fn has_points(&self) -> bool {
        *self.has_points.get_or_init(|| self.exchange_runs.iter().any(|run| run.points.is_some()))
    }

    /// How many transactions there are, compact exchanges included.
    pub fn transaction_count(&self) -> usize {
        self.transactions.len() + self.exchanges.len()
    }

    /// The transactions in the order of their numbers, in parts.
    pub fn transaction_parts(&self) -> impl Iterator<Item = Part<'_, Transaction>> {
        parts(&self.transactions, |row| row.number, self.exchange_runs.iter(), |run| run.number)
    }

    /// The same from a part on that is not after the transaction at this place, with the place of its first one. It is the part
    /// that has the transaction, unless numbers are missing between the first and the last.
    pub fn transaction_parts_from(&self, place: usize) -> (usize, impl Iterator<Item = Part<'_, Transaction>>) {
        let (rows, runs) = (&self.transactions[..], &self.exchange_runs[..]);
        let firsts = [rows.first().map(|row| row.number), runs.first().map(|run| run.number)];
        let ends = [rows.last().map(|row| row.number + 1), runs.last().map(ExchangeRun::end)];
        let first = firsts.into_iter().flatten().min().unwrap_or(0);
        let is_whole = ends.into_iter().flatten().max() == Some(first + self.transaction_count() as u64);
        let number = first + if is_whole { place as u64 } else { 0 };
        let rows = &rows[rows.partition_point(|row| row.number < number)..];
        let runs = &runs[runs.partition_point(|run| run.end() <= number)..];
        let begins_at = runs.first().map_or(number, |run| run.number.min(number));
        let parts = parts(rows, |row| row.number, runs.iter(), |run| run.number);
        ((begins_at - first) as usize, parts)
    }

    /// The frames in the order of their numbers, in parts, of a recording of which frames were wanted: a compact exchange without
    /// times stands for its two. Those of others are rows.
    pub fn frame_parts(&self) -> impl Iterator<Item = Part<'_, Frame>> {
        let runs = self.exchange_runs.iter().filter(|run| run.packets.is_none());
        parts(&self.frames, |row| row.number, runs, |run| run.frame)
    }

    /// Gives back the rows of frames.
    pub fn forget_frames(&mut self) {
        self.frames = Vec::new();
        self.inner_packets = Vec::new();
    }

    /// Copies findings into the batch.
    pub fn store_findings(&mut self, codes: &[Finding]) -> Span {
        let start = self.codes.len() as u32;
        self.codes.extend_from_slice(codes);
        Span { start, length: codes.len() as u32 }
    }
}

/// Rows of a batch that stand one after the other: as rows, or compact exchanges.
#[derive(Clone, Copy, Debug)]
pub enum Part<'a, Row> {
    /// As rows; at least one.
    Rows(&'a [Row]),
    /// Compact exchanges.
    Compact(&'a ExchangeRun),
}

fn parts<'a, Row>(
    mut rows: &'a [Row],
    row_number: fn(&Row) -> u64,
    runs: impl Iterator<Item = &'a ExchangeRun>,
    run_number: fn(&ExchangeRun) -> u64,
) -> impl Iterator<Item = Part<'a, Row>> {
    let mut runs = runs.peekable();
    std::iter::from_fn(move || {
        if let Some(run) = runs.next_if(|run| rows.first().is_none_or(|row| run_number(run) < row_number(row))) {
            return Some(Part::Compact(run));
        }
        let until = runs.peek().map_or(u64::MAX, |run| run_number(run));
        let (part, others) = rows.split_at(rows.iter().position(|row| row_number(row) > until).unwrap_or(rows.len()));
        rows = others;
        (!part.is_empty()).then_some(Part::Rows(part))
    })
}
