//! The rows: plain structs over one arena of bytes.

use std::sync::Arc;

use modlens_profiles::points::PlanInstance;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::{Finding, Severity};
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

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
    /// End of the last character.
    pub end: Option<Ns>,
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
    /// Who sent its first byte, where the recording says so.
    pub side: Option<Side>,
}

/// The silences between the reads inside a frame: those of the sender, or of the adapter that held bytes back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InnerPauses {
    /// The longest; 0 without any.
    pub longest: Ns,
    /// How many there are.
    pub count: u32,
    /// Reads of the frame; 0 without times.
    pub reads: u32,
    /// Bytes after the first read, and from the time of that to the time of the last one.
    pub bytes: u32,
    /// As above.
    pub lasted: Ns,
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
    /// End of its last character.
    pub end: Option<Ns>,
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
    /// How certain it is: suspected, likely or diagnosed.
    pub certainty: &'static str,
    /// The corrected probability that the contrast is an accident.
    pub chance: Option<f64>,
    /// The share of all odd transactions and bytes of the bus that it explains.
    pub share: Option<f64>,
    /// The odds against the best rival.
    pub odds: Option<f64>,
    /// Its runs as ISO 8601 intervals, on a clock that is set to UTC.
    pub episodes: String,
    /// The cause in words.
    pub sentence: String,
    /// What to check.
    pub advice: String,
    /// The experiment that would prove it.
    pub proof: String,
    /// Numbers of transactions that show it.
    pub examples: Vec<u64>,
}
