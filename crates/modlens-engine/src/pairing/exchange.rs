//! A frame as pairing sees it, and a transaction while it is open.

use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// A frame, as pairing sees it.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Its number.
    pub frame: u64,
    /// Bytes on the wire.
    pub wire: &'a [u8],
    /// Unit and PDU in binary.
    pub adu: &'a [u8],
    /// What it is worth.
    pub verdict: Verdict,
    /// Who sent it.
    pub direction: Direction,
    /// Framing.
    pub mode: Mode,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
    /// Whether its start is as exact as the clock: it begins a read.
    pub clean_start: bool,
    /// Silence before it.
    pub gap: Option<Ns>,
    /// MBAP transaction identifier.
    pub mbap_id: Option<u16>,
    /// Line or packet number, or the stream offset.
    pub origin: u64,
    /// Isolated in noise: no proof that its unit exists.
    pub tentative: bool,
    /// What was found on the frame itself.
    pub codes: &'a [Finding],
}

impl Seen<'_> {
    pub(super) fn unit(&self) -> u8 {
        self.adu.first().copied().unwrap_or(0)
    }

    pub(super) fn pdu(&self) -> &[u8] {
        self.adu.get(1..).unwrap_or(&[])
    }

    pub(super) fn function(&self) -> u8 {
        self.pdu().first().copied().unwrap_or(0) & !EXCEPTION_BIT
    }
}

/// One frame kept until its transaction is complete.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    /// Its number; 0 where there is none.
    pub frame: u64,
    /// Bytes on the wire.
    pub wire: Vec<u8>,
    pdu: Pdu,
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
}

/// Where the PDU of a frame is.
#[derive(Clone, Debug)]
enum Pdu {
    /// In the bytes on the wire: from here on, so many.
    Inside(usize, usize),
    /// Apart: those are characters, or damaged.
    Own(Vec<u8>),
}

impl Default for Pdu {
    fn default() -> Self {
        Self::Inside(0, 0)
    }
}

impl Pdu {
    fn of(wire: &[u8], pdu: &[u8]) -> Self {
        // Behind the unit of RTU, or behind the header of MBAP.
        let inside = [1, 7].into_iter().find(|&at| wire.get(at..at + pdu.len()) == Some(pdu));
        inside.map_or_else(|| Self::Own(pdu.to_vec()), |at| Self::Inside(at, pdu.len()))
    }
}

impl Kept {
    /// The frame of this number.
    pub fn new(frame: u64, wire: &[u8], pdu: &[u8], start: Option<Ns>) -> Self {
        Self { frame, wire: wire.to_vec(), pdu: Pdu::of(wire, pdu), start, end: None }
    }

    /// The same with another PDU.
    #[must_use]
    pub fn with_pdu(self, pdu: &[u8]) -> Self {
        Self { pdu: Pdu::of(&self.wire, pdu), ..self }
    }

    /// Its PDU in binary.
    #[inline]
    pub fn pdu(&self) -> &[u8] {
        match &self.pdu {
            Pdu::Inside(at, length) => &self.wire[*at..at + length],
            Pdu::Own(bytes) => bytes,
        }
    }

    /// Where the PDU stands in the bytes on the wire.
    pub fn inside(&self) -> Option<usize> {
        match self.pdu {
            Pdu::Inside(at, _) => Some(at),
            Pdu::Own(_) => None,
        }
    }

    pub(super) fn reset(&mut self) {
        self.frame = 0;
        self.wire.clear();
        self.pdu = Pdu::default();
        (self.start, self.end) = (None, None);
    }

    pub(super) fn fill(&mut self, seen: &Seen<'_>) {
        self.frame = seen.frame;
        self.wire.clear();
        self.wire.extend_from_slice(seen.wire);
        self.pdu = Pdu::of(seen.wire, seen.pdu());
        self.start = seen.start;
        self.end = seen.end;
    }
}

/// A request that came while another one waited for its answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside {
    /// Its transaction.
    pub txn: u64,
    /// It came sooner than any master gives up, by the clock.
    pub clear: bool,
    /// It has its answer.
    pub answered: bool,
}

/// A transaction while it is open, and what leaves when it is done.
#[derive(Clone, Debug)]
pub struct Exchange {
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
    pub request: Kept,
    /// The response.
    pub response: Kept,
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
    /// What was found.
    pub findings: Vec<Finding>,
    /// Line or packet number, or the stream offset.
    pub origin: u64,
    /// The time-out has passed; an answer now is late.
    pub(crate) given_up: bool,
    /// No answer is due, as specified (6.8, sub-function 4): nothing was lost.
    pub(crate) silent: bool,
    /// The recording lacks bytes in which the answer may have been.
    pub(crate) blind: bool,
    /// The request was heard twice.
    pub(crate) echoed: bool,
    /// Its answer came late.
    pub(crate) late_seen: bool,
    /// The request that came before this one's answer.
    pub(crate) inside: Option<Inside>,
    /// A response that is not tentative answers it: the unit is there.
    pub sure: bool,
    /// It was decided and checked before, and is read back.
    pub retold: bool,
    /// What was found then, with the words.
    pub told: Vec<(Finding, String)>,
}

impl Exchange {
    /// One without content.
    pub fn new(mode: Mode) -> Self {
        Self {
            txn: 0,
            unit: 0,
            function: 0,
            mode,
            status: Status::NoResponse,
            exception: None,
            request: Kept::default(),
            response: Kept::default(),
            response_time: None,
            waited: None,
            late_response: None,
            retry_of: None,
            late_for: None,
            gap: None,
            mbap_id: None,
            findings: Vec::new(),
            origin: 0,
            given_up: false,
            silent: false,
            blind: false,
            echoed: false,
            late_seen: false,
            inside: None,
            sure: false,
            retold: false,
            told: Vec::new(),
        }
    }

    /// As new, but with the buffers of the old one.
    pub(super) fn reset(&mut self, mode: Mode) {
        let (mut request, mut response) = (std::mem::take(&mut self.request), std::mem::take(&mut self.response));
        let mut findings = std::mem::take(&mut self.findings);
        request.reset();
        response.reset();
        findings.clear();
        *self = Self { request, response, findings, ..Self::new(mode) };
    }
}
