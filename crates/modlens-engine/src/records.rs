//! Rows as they leave the session: plain structs over one arena of bytes.
//!
//! Columns are not stored: `columns` reads them off the rows on demand.

mod buses;
mod connection;
mod exchange;

pub use buses::{Bus, Buses, Network};
pub use connection::{Connection, End};
pub use exchange::{Exchange, ExchangeRun, Part};

use std::mem::take;
use std::sync::{Arc, Mutex, OnceLock};

use modlens_profiles::points::PlanInstance;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::{Finding, Severity};
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// A range of the bytes, or of the findings, of a batch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Span {
    /// Index of the first one.
    pub start: u32,
    /// How many they are.
    pub length: u32,
}

impl Span {
    /// The bytes or findings of this range.
    #[inline]
    pub fn of<T>(self, arena: &[T]) -> &[T] {
        &arena[self.start as usize..(self.start + self.length) as usize]
    }
}

/// One frame on the wire, or one run of noise.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Running number from 1.
    pub number: u64,
    /// Index of its bus.
    pub bus: u32,
    /// Number of its line on a two-line tap or a connection; 0 for the only line of a bus.
    pub line: u8,
    /// Stream offset of its first byte.
    pub offset: u64,
    /// Its bytes on the wire.
    pub wire: Span,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// Its start, counted from the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Silence before the frame.
    pub gap: Option<Ns>,
    /// Silences inside the frame.
    pub pauses: InnerPauses,
    /// Framing.
    pub mode: Mode,
    /// Who sent it.
    pub direction: Direction,
    /// Unit.
    pub unit: Option<u8>,
    /// Function code with the exception bit.
    pub code: Option<u8>,
    /// Exception code.
    pub exception: Option<u8>,
    /// Whether it is whole and its checksum right.
    pub verdict: Verdict,
    /// The checksum is right, but the frame may be an accident of noise.
    pub unconfirmed: bool,
    /// How much more likely this reading of the bytes is than the next best one, in bits.
    pub confidence: u8,
    /// What ended it.
    pub delimited_by: DelimitedBy,
    /// Number of its transaction.
    pub txn: Option<u64>,
    /// MBAP transaction identifier.
    pub mbap_id: Option<u16>,
    /// Its findings, in `Batch::codes`.
    pub findings: Span,
    /// Line or packet number in the file.
    pub origin: u64,
    /// Line or packet number of its last byte.
    pub last_origin: u64,
}

/// The silences between the reads inside a frame: those of the sender, or of the adapter that held bytes back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InnerPauses {
    /// The longest; 0 without any.
    pub longest: Ns,
    /// How many there are.
    pub count: u32,
}

/// The request or the response of a transaction.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameRef {
    /// Number of the frame; 0 where the transaction lacks it.
    pub frame: u64,
    /// Bytes on the wire.
    pub wire: Span,
    /// Its PDU.
    pub pdu: Span,
    /// Start of its first character.
    pub start: Option<Ns>,
}

/// A request and its response.
#[derive(Clone, Debug)]
pub struct Transaction {
    /// Running number from 1, in request order.
    pub number: u64,
    /// Index of its bus.
    pub bus: u32,
    /// Framing.
    pub mode: Mode,
    /// Start of the request, or of a response without request.
    pub start: Option<Ns>,
    /// Its start, counted from the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Unit.
    pub unit: u8,
    /// Function code without the exception bit.
    pub function: u8,
    /// How it ended.
    pub status: Status,
    /// Exception code.
    pub exception: Option<u8>,
    /// Log2 odds that status and pairing are right.
    pub confidence: u8,
    /// A frame of it is unconfirmed, or its odds are low.
    pub unconfirmed: bool,
    /// From the end of the request to the start of the response.
    pub response_time: Option<Ns>,
    /// From the end of an unanswered request to the next request.
    pub waited: Option<Ns>,
    /// From the end of the request to the start of its late response.
    pub late_response: Option<Ns>,
    /// The transaction whose request is repeated here.
    pub retry_of: Option<u64>,
    /// The transaction that this late response belongs to.
    pub late_response_to: Option<u64>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// MBAP transaction identifier.
    pub mbap_id: Option<u16>,
    /// The request.
    pub request: FrameRef,
    /// The response.
    pub response: FrameRef,
    /// Its findings, in `Batch::codes`.
    pub findings: Span,
    /// The profile of its unit, with the scale factors known at that time.
    pub points: Option<Arc<PlanInstance>>,
    /// Line or packet number in the file, or the stream offset.
    pub origin: u64,
}

/// A finding on a frame or transaction.
#[derive(Clone, Debug)]
pub struct FindingRow {
    /// Number of the frame.
    pub frame: Option<u64>,
    /// Number of the transaction.
    pub txn: Option<u64>,
    /// Index of its bus.
    pub bus: u32,
    /// Start of the frame or transaction.
    pub start: Option<Ns>,
    /// Its time, counted from the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Unit.
    pub unit: Option<u8>,
    /// The finding.
    pub finding: Finding,
    /// What was seen this time, in words for the user.
    pub detail: String,
    /// Line or packet number in the file, or the stream offset.
    pub origin: u64,
}

/// A cause of trouble, made from the rows of a whole recording.
#[derive(Clone, Debug)]
pub struct DiagnosisRow {
    /// Its code.
    pub code: &'static str,
    /// Its severity in this case.
    pub severity: Severity,
    /// Name of its bus.
    pub bus: String,
    /// Unit.
    pub unit: Option<u8>,
    /// Function code.
    pub function: Option<u8>,
    /// Address.
    pub address: Option<u16>,
    /// Address of the client.
    pub client: Option<String>,
    /// How many transactions bear it.
    pub failed: u64,
    /// Of how many.
    pub total: u64,
    /// Start of the first that bears it, on a clock that is set to UTC.
    pub since: Option<Ns>,
    /// Start of the last one, if the trouble is over.
    pub until: Option<Ns>,
    /// The corrected probability that the contrast is an accident.
    pub chance: Option<f64>,
    /// The cause in words.
    pub sentence: String,
    /// What to check.
    pub advice: String,
    /// The experiment that would prove it.
    pub proof: String,
    /// Numbers of transactions that show it.
    pub examples: Vec<u64>,
}

/// Emitted rows, with the bytes and findings that they refer to.
///
/// A batch returns its vectors to the session when it is dropped: to allocate them anew would cost more than most rows.
#[derive(Debug, Default)]
pub struct Batch {
    /// For each bus, what its rows share.
    pub buses: Arc<Buses>,
    /// The table of functions that decodes the PDUs.
    pub functions: Option<Arc<Functions>>,
    /// The bytes of all rows.
    pub arena: Vec<u8>,
    /// The findings of all frames and transactions.
    pub codes: Vec<Finding>,
    /// Frames.
    pub frames: Vec<Frame>,
    /// Transactions, but for exchanges in short: `all_transactions` has both.
    pub transactions: Vec<Transaction>,
    /// Findings.
    pub findings: Vec<FindingRow>,
    /// Exchanges in short, which are not among frames and transactions.
    pub exchanges: Vec<Exchange>,
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
    /// Where its vectors go when it is dropped.
    pub(crate) pool: MemoryPool,
}

/// The vectors of dropped batches, which are filled again.
#[derive(Clone, Debug, Default)]
pub(crate) struct MemoryPool(Arc<Mutex<Vec<Memory>>>);

type Memory = (Vec<u8>, Vec<Finding>, Vec<Frame>, Vec<Transaction>, Vec<FindingRow>, Vec<Exchange>);

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
            (batch.arena, batch.codes, batch.frames, batch.transactions, batch.findings, batch.exchanges) = memory;
        }
        batch
    }
}

impl Drop for Batch {
    /// Gives the vectors of the batch, emptied, back to its session, unless that is gone, has enough of them, or the arena is
    /// too large to be kept. `exchange_runs`, `connections` and `inner_packets`,
    /// mostly short, are not among them.
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
            memories.push((
                take(&mut self.arena),
                take(&mut self.codes),
                take(&mut self.frames),
                take(&mut self.transactions),
                take(&mut self.findings),
                take(&mut self.exchanges),
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

    /// The transactions in the order of their numbers, those in short as rows, too.
    ///
    /// These rows are made when this is first called. Where the rows are read once, one behind the other, it is cheaper to make
    /// them one by one (`ExchangeRun::transaction`).
    pub fn all_transactions(&self) -> &[Transaction] {
        if self.exchange_runs.is_empty() {
            return &self.transactions;
        }
        self.expanded.get_or_init(|| {
            let mut all = Vec::with_capacity(self.transaction_count());
            for part in self.transaction_parts() {
                match part {
                    Part::Rows(rows) => all.extend_from_slice(rows),
                    Part::Short(run) => all.extend((0..run.exchanges.length as usize).map(|at| run.transaction(self, at))),
                }
            }
            all
        })
    }

    /// How many transactions there are, those in short included.
    pub fn transaction_count(&self) -> usize {
        self.transactions.len() + self.exchanges.len()
    }

    /// Copies findings into the batch.
    pub fn store_findings(&mut self, codes: &[Finding]) -> Span {
        let start = self.codes.len() as u32;
        self.codes.extend_from_slice(codes);
        Span { start, length: codes.len() as u32 }
    }
}
