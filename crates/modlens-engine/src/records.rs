//! Rows as they leave the session: plain structs over one arena of bytes.
//!
//! Columns are not stored: `columns` reads them off the rows when somebody asks.

mod buses;

pub use buses::{Bus, Buses, Network};

use std::sync::{Arc, Mutex};

use modlens_profiles::points::PlanInstance;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Bytes in the arena of a batch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// How many.
    pub length: u32,
}

impl Span {
    /// The bytes.
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
    /// Which bus.
    pub bus: u32,
    /// Which line of a two-line tap; 0 for the only one.
    pub line: u8,
    /// Position in the stream.
    pub offset: u64,
    /// The bytes.
    pub wire: Span,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// The same, since the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Silence before it.
    pub gap: Option<Ns>,
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
    /// What it is worth.
    pub verdict: Verdict,
    /// Checksum right, but not yet to be believed.
    pub tentative: bool,
    /// Bits.
    pub confidence: u8,
    /// What ended it.
    pub cut_by: CutBy,
    /// Its transaction.
    pub txn: Option<u64>,
    /// MBAP transaction identifier.
    pub mbap_id: Option<u16>,
    /// In `Batch::codes`.
    pub findings: Span,
    /// Line or packet number in the file.
    pub origin: u64,
    /// That of its last byte.
    pub last_origin: u64,
}

/// One frame's part in a transaction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Half {
    /// Number of the frame; 0 where there is none.
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
    /// Which bus.
    pub bus: u32,
    /// Framing.
    pub mode: Mode,
    /// Start of the request, or of a response nobody asked for.
    pub start: Option<Ns>,
    /// The same, since the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Unit.
    pub unit: u8,
    /// Function code without the exception bit.
    pub function: u8,
    /// How it ended.
    pub status: Status,
    /// Exception code.
    pub exception: Option<u8>,
    /// End of request to start of response.
    pub response_time: Option<Ns>,
    /// End of an unanswered request to the next request.
    pub waited: Option<Ns>,
    /// End of the request to the start of a late answer.
    pub late_response: Option<Ns>,
    /// The transaction that this request repeats.
    pub retry_of: Option<u64>,
    /// The transaction that this late answer belongs to.
    pub late_for: Option<u64>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// MBAP transaction identifier.
    pub mbap_id: Option<u16>,
    /// The request.
    pub request: Half,
    /// The response.
    pub response: Half,
    /// In `Batch::codes`.
    pub findings: Span,
    /// The profile of its unit, as it was then.
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
    /// Which bus.
    pub bus: u32,
    /// When.
    pub start: Option<Ns>,
    /// The same, since the first byte of the recording.
    pub elapsed: Option<Ns>,
    /// Unit.
    pub unit: Option<u8>,
    /// Which.
    pub finding: Finding,
    /// What was seen, in words.
    pub detail: String,
    /// Line or packet number in the file, or the stream offset.
    pub origin: u64,
}

/// Rows that were decided, with the bytes they refer to.
///
/// A batch that a session gave out gives its memory back when it is dropped: fresh memory costs more than most rows.
#[derive(Debug, Default)]
pub struct Batch {
    /// What rows of a bus share.
    pub buses: Arc<Buses>,
    /// The table that decodes the PDUs.
    pub functions: Option<Arc<Functions>>,
    /// Bytes.
    pub arena: Vec<u8>,
    /// Findings of frames and transactions.
    pub codes: Vec<Finding>,
    /// Frames.
    pub frames: Vec<Frame>,
    /// Transactions.
    pub transactions: Vec<Transaction>,
    /// Findings.
    pub findings: Vec<FindingRow>,
    /// Number of a frame and of a packet that holds neither its first nor its last byte.
    pub between: Vec<(u64, u64)>,
    /// Where its memory goes.
    pub(crate) spare: Spare,
}

/// The vectors of batches that were dropped, to be filled again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spare(Arc<Mutex<Vec<Memory>>>);

type Memory = (Vec<u8>, Vec<Finding>, Vec<Frame>, Vec<Transaction>, Vec<FindingRow>);

/// So many are kept: one is filled while another is written.
const SPARE: usize = 2;

/// A batch with more bytes than this was an exception.
const USUAL: usize = 1 << 23;

impl Spare {
    /// A batch without rows.
    pub(crate) fn batch(&self) -> Batch {
        let mut batch = Batch::default();
        batch.spare = self.clone();
        if let Some(memory) = self.0.lock().ok().and_then(|mut memories| memories.pop()) {
            (batch.arena, batch.codes, batch.frames, batch.transactions, batch.findings) = memory;
        }
        batch
    }
}

impl Drop for Batch {
    fn drop(&mut self) {
        // The session is gone, or has never seen this batch.
        if Arc::strong_count(&self.spare.0) == 1 || self.arena.capacity() > USUAL {
            return;
        }
        let Ok(mut memories) = self.spare.0.lock() else { return };
        if memories.len() == SPARE {
            return;
        }
        self.arena.clear();
        self.codes.clear();
        self.frames.clear();
        self.transactions.clear();
        self.findings.clear();
        let mut memory = Memory::default();
        std::mem::swap(&mut memory.0, &mut self.arena);
        std::mem::swap(&mut memory.1, &mut self.codes);
        std::mem::swap(&mut memory.2, &mut self.frames);
        std::mem::swap(&mut memory.3, &mut self.transactions);
        std::mem::swap(&mut memory.4, &mut self.findings);
        memories.push(memory);
    }
}

impl Batch {
    /// Stores bytes.
    pub fn keep(&mut self, bytes: &[u8]) -> Span {
        let start = self.arena.len() as u32;
        self.arena.extend_from_slice(bytes);
        Span { start, length: bytes.len() as u32 }
    }

    /// Where bytes of the arena are in it.
    pub fn span_of(&self, bytes: &[u8]) -> Span {
        let start = (bytes.as_ptr() as usize).wrapping_sub(self.arena.as_ptr() as usize);
        Span { start: start as u32, length: bytes.len() as u32 }
    }

    /// Stores findings.
    pub fn keep_codes(&mut self, codes: &[Finding]) -> Span {
        let start = self.codes.len() as u32;
        self.codes.extend_from_slice(codes);
        Span { start, length: codes.len() as u32 }
    }
}
