//! The input of pairing (one frame), and a transaction from its first frame until its row is written.

use crate::weights::MAX_CONFIDENCE_BITS;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// A frame as pairing, the checks and the statistics get it.
#[derive(Clone, Copy, Debug)]
pub struct ObservedFrame<'a> {
    /// Running number of the frame, from 1.
    pub number: u64,
    /// The bytes on the wire, checksum included.
    pub wire: &'a [u8],
    /// Unit and PDU in binary, without checksum.
    pub adu: &'a [u8],
    /// Whether the frame is whole and its checksum right.
    pub verdict: Verdict,
    /// Who sent it.
    pub direction: Direction,
    /// Framing.
    pub mode: Mode,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
    /// Whether `start` is as exact as the clock: the frame begins with a read. In the middle of a read it is an estimate.
    pub clean_start: bool,
    /// Silence before the frame.
    pub gap: Option<Ns>,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// Line or packet number in the recording, or the stream offset.
    pub origin: u64,
    /// The checksum is right, but the frame stands isolated in noise: it does not prove that its unit exists.
    pub unconfirmed: bool,
    /// The log2 odds that its bounds and its direction are right.
    pub confidence: u8,
    /// The beginning or the end of the recording cuts it: what is missing was never lost.
    pub is_cut: bool,
    /// A tap began between the request and this response, if it is one.
    pub lacks_request: bool,
    /// The recording's word for who sent it.
    pub side: Option<Side>,
    /// The findings on the frame itself.
    pub codes: &'a [Finding],
}

impl ObservedFrame<'_> {
    pub(crate) fn unit(&self) -> u8 {
        self.adu.first().copied().unwrap_or(0)
    }

    pub(crate) fn pdu(&self) -> &[u8] {
        self.adu.get(1..).unwrap_or(&[])
    }

    /// The function code without the exception bit.
    pub(crate) fn function(&self) -> u8 {
        self.pdu().first().copied().unwrap_or(0) & !EXCEPTION_BIT
    }
}

/// The request or the response of a transaction, copied out of the input until the row is written.
#[derive(Clone, Debug, Default)]
pub struct BufferedFrame {
    /// Running number of the frame; 0 where the transaction lacks this half.
    pub number: u64,
    /// The bytes on the wire.
    pub wire: Vec<u8>,
    pdu: PduLocation,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
    /// The log2 odds that its bounds and its direction are right.
    pub confidence: u8,
    /// It stands isolated in noise.
    pub is_unconfirmed: bool,
    /// It is whole and undamaged.
    pub is_good: bool,
    /// The recording's word for who sent it.
    pub side: Option<Side>,
}

/// Where the PDU of a buffered frame is stored.
#[derive(Clone, Debug)]
enum PduLocation {
    /// In the bytes on the wire: index of the first byte, and length.
    InWire(usize, usize),
    /// In a buffer of its own: the wire has hex characters (ASCII), or the bytes on it are damaged.
    Own(Vec<u8>),
}

impl Default for PduLocation {
    fn default() -> Self {
        Self::InWire(0, 0)
    }
}

impl PduLocation {
    fn of(wire: &[u8], pdu: &[u8]) -> Self {
        // The PDU follows the unit (index 1) in RTU and the seven bytes of the MBAP header in TCP.
        let at = [1, 7].into_iter().find(|&at| wire.get(at..at + pdu.len()) == Some(pdu));
        at.map_or_else(|| Self::Own(pdu.to_vec()), |at| Self::InWire(at, pdu.len()))
    }
}

impl BufferedFrame {
    /// A copy of the frame with this running number.
    pub fn new(number: u64, wire: &[u8], pdu: &[u8], start: Option<Ns>) -> Self {
        let confidence = MAX_CONFIDENCE_BITS;
        Self {
            number,
            wire: wire.to_vec(),
            pdu: PduLocation::of(wire, pdu),
            start,
            end: None,
            confidence,
            is_unconfirmed: false,
            is_good: true,
            side: None,
        }
    }

    /// This frame with its PDU replaced.
    #[must_use]
    pub fn with_pdu(self, pdu: &[u8]) -> Self {
        Self { pdu: PduLocation::of(&self.wire, pdu), ..self }
    }

    /// Whether the transaction has this half.
    #[inline]
    pub fn is_present(&self) -> bool {
        self.number != 0
    }

    /// The PDU in binary.
    #[inline]
    pub fn pdu(&self) -> &[u8] {
        match &self.pdu {
            PduLocation::InWire(at, length) => &self.wire[*at..at + length],
            PduLocation::Own(bytes) => bytes,
        }
    }

    /// Index of the PDU in the bytes on the wire, if it is there as it is.
    pub fn pdu_index(&self) -> Option<usize> {
        match self.pdu {
            PduLocation::InWire(at, _) => Some(at),
            PduLocation::Own(_) => None,
        }
    }

    pub(crate) fn reset(&mut self) {
        self.number = 0;
        self.wire.clear();
        self.pdu = PduLocation::default();
        (self.start, self.end) = (None, None);
        (self.is_unconfirmed, self.is_good, self.side) = (false, false, None);
    }

    pub(crate) fn fill(&mut self, frame: &ObservedFrame<'_>) {
        self.number = frame.number;
        self.wire.clear();
        self.wire.extend_from_slice(frame.wire);
        self.pdu = PduLocation::of(frame.wire, frame.pdu());
        self.start = frame.start;
        self.end = frame.end;
        (self.confidence, self.is_unconfirmed) = (frame.confidence, frame.unconfirmed);
        self.is_good = frame.verdict.is_good();
        self.side = frame.side;
    }
}

/// A later request that arrived while this transaction still waited for its response.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OverlappingRequest {
    /// Number of the later transaction.
    pub txn: u64,
    /// By the clock, the later request came sooner than any master gives up waiting.
    pub timeout_excluded: bool,
    /// The later request has its response.
    pub is_answered: bool,
}

/// How a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionEnd {
    /// By a reset, not in order.
    pub is_reset: bool,
    /// The client ended it, or else the server; `None` if that is not known.
    pub by_client: Option<bool>,
}

/// A transaction from its first frame until its row is written.
#[derive(Clone, Debug)]
pub struct PendingTransaction {
    /// Running number.
    pub txn: u64,
    /// Unit.
    pub unit: u8,
    /// Function code without the exception bit.
    pub function: u8,
    /// Framing.
    pub mode: Mode,
    /// How it ended.
    pub status: Status,
    /// Exception code.
    pub exception: Option<u8>,
    /// The request.
    pub request: BufferedFrame,
    /// The response.
    pub response: BufferedFrame,
    /// From the end of the request to the start of the response.
    pub response_time: Option<Ns>,
    /// From the end of an unanswered request to the next request.
    pub waited: Option<Ns>,
    /// From the end of the request to the start of its response, for a response that came after the timeout.
    pub late_response: Option<Ns>,
    /// The transaction whose request is repeated here.
    pub retry_of: Option<u64>,
    /// The transaction that this late response belongs to.
    pub late_response_to: Option<u64>,
    /// Silence before the request.
    pub gap: Option<Ns>,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// The findings on its frames and on the pair.
    pub findings: Vec<Finding>,
    /// Line or packet number in the recording, or the stream offset.
    pub origin: u64,
    /// The timeout has passed; a response from now on is late.
    pub(crate) is_timed_out: bool,
    /// By the specification the request gets no response (application protocol 6.8, sub-function 4): nothing is missing.
    pub(crate) expects_no_response: bool,
    /// That no response is seen proves nothing: bytes are missing from the recording, or this request may be the echo of
    /// the next one.
    pub(crate) silence_is_inconclusive: bool,
    /// The adapter's echo of the request was seen.
    pub(crate) echo_seen: bool,
    /// Its response came after the timeout.
    pub(crate) has_late_response: bool,
    /// The request that came before this one had its response.
    pub(crate) overlap: Option<OverlappingRequest>,
    /// A response that is not unconfirmed answers it: the unit exists.
    pub confirms_unit: bool,
    /// How its connection ended, if that was before the response.
    pub connection_end: Option<ConnectionEnd>,
    /// How certain what was concluded of it is, in bits; its frames may be less certain.
    pub certainty: u8,
    /// It was unconfirmed in the file that it is read back from.
    pub unconfirmed: bool,
    /// The transaction is read back from a file that modlens wrote; it was decided and checked then.
    pub is_reimported: bool,
    /// The findings read back with it, with their details.
    pub imported_findings: Vec<(Finding, String)>,
}

impl PendingTransaction {
    /// A transaction without content. Its status is `no_response` until something else is known.
    pub fn new(mode: Mode) -> Self {
        Self {
            txn: 0,
            unit: 0,
            function: 0,
            mode,
            status: Status::NoResponse,
            exception: None,
            request: BufferedFrame::default(),
            response: BufferedFrame::default(),
            response_time: None,
            waited: None,
            late_response: None,
            retry_of: None,
            late_response_to: None,
            gap: None,
            mbap_id: None,
            findings: Vec::new(),
            origin: 0,
            is_timed_out: false,
            expects_no_response: false,
            silence_is_inconclusive: false,
            echo_seen: false,
            has_late_response: false,
            overlap: None,
            confirms_unit: false,
            connection_end: None,
            certainty: MAX_CONFIDENCE_BITS,
            unconfirmed: false,
            is_reimported: false,
            imported_findings: Vec::new(),
        }
    }

    /// Its request as far as a response of this unit is concerned: a broadcast is to every unit.
    pub(crate) fn request_to(&self, unit: u8) -> RequestRef<'_> {
        let unit = if self.status == Status::Broadcast { unit } else { self.unit };
        RequestRef { unit, pdu: self.request.pdu() }
    }

    /// Clears everything, as `new` does, but keeps the allocated buffers of both frames and of the findings, for the next
    /// transaction.
    pub(crate) fn reset(&mut self, mode: Mode) {
        let (mut request, mut response) = (std::mem::take(&mut self.request), std::mem::take(&mut self.response));
        let mut findings = std::mem::take(&mut self.findings);
        request.reset();
        response.reset();
        findings.clear();
        *self = Self { request, response, findings, ..Self::new(mode) };
    }
}

/// A response that fits the open request but for its unit. The next request shows whether the master took it for the
/// response; until then the transaction waits here.
#[derive(Debug)]
pub(crate) struct UnitMismatch {
    pub transaction: Box<PendingTransaction>,
    /// The transaction of the open request.
    pub request_txn: u64,
}

/// A response without a request, on two lines whose adapters hold bytes back. The request may still be seen, if its line
/// is later than was observed so far.
#[derive(Debug)]
pub(crate) struct EarlyResponse {
    pub unit: u8,
    pub pdu: Vec<u8>,
    pub start: Ns,
}
