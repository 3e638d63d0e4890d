//! What the frames and transactions of one connection add up to.

use crate::pairing::{ObservedFrame, Pairing, PendingTransaction};
use crate::session::in_flight::{AnswerShape, InFlight, READ_HEADER_BYTES};
use modlens_protocol::direction::{expected_data_bytes, Direction};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// The counters of one connection.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConnectionTally {
    /// Requests so far.
    pub(crate) requests: u64,
    /// Those that write.
    pub(crate) writes: u64,
    /// Those with an answer, an exception included.
    pub(crate) answered: u64,
    /// The first request by its number, and what came of it.
    pub(crate) first: Option<(u64, Status)>,
    /// A good frame of the server was paired.
    pub(crate) has_response: bool,
    /// Findings on the connection.
    pub(crate) findings: Vec<Finding>,
    pub(crate) in_flight: InFlight,
}

impl ConnectionTally {
    /// Counts a transaction that is closed.
    pub(crate) fn note_transaction(&mut self, transaction: &PendingTransaction) {
        let has_answer = matches!(transaction.status, Status::Ok | Status::Exception);
        self.has_response |= has_answer || transaction.status == Status::Unsolicited;
        if transaction.request.is_present() {
            self.requests += 1;
            self.writes += writes(transaction.function);
            self.answered += u64::from(has_answer);
            self.note_outcome(transaction.txn, transaction.status);
        }
    }

    /// Counts an exchange of the fast path: a request with its number, status and identifier, what its answer is like, and the
    /// times of both.
    #[inline]
    pub(crate) fn note_exchange(
        &mut self,
        (txn, status): (u64, Status),
        answer: (Option<u16>, AnswerShape),
        times: [Ns; 2],
        pairing: &Pairing,
    ) {
        self.requests += 1;
        self.writes += writes(answer.1.function);
        self.answered += 1;
        self.has_response = true;
        if self.first.is_none() {
            self.note_outcome(txn, status);
        }
        self.in_flight.exchange(answer, times, |waited| !pairing.is_before_timeout(waited));
    }

    /// Counts reads of the fast path as `note_exchange` does, where it has counted one before and none is in flight; the slowest
    /// answer took so long, and the last one came then.
    pub(crate) fn note_lone_exchanges(&mut self, exchanges: u64, longest: Ns, last: AnswerShape, last_answer: Ns) {
        self.requests += exchanges;
        self.answered += exchanges;
        self.in_flight.lone_exchanges(exchanges, longest, last, last_answer);
    }

    /// Notes a good frame of the slow path as a request or an answer in flight.
    pub(crate) fn note_frame(&mut self, functions: &Functions, frame: &ObservedFrame<'_>, pairing: &Pairing) {
        let pdu = frame.pdu();
        let code = pdu.first().copied().unwrap_or(0);
        let shape = |length| AnswerShape { unit: frame.unit(), function: code & !EXCEPTION_BIT, length };
        match frame.direction {
            Direction::Request => {
                let row = functions.row(code, pdu.get(1..).unwrap_or(&[]));
                let length = row.and_then(|row| expected_data_bytes(row, pdu)).map(|data| READ_HEADER_BYTES + data);
                let asked = (frame.mbap_id, shape(length));
                self.in_flight.request(asked, frame.start, |waited| !pairing.is_before_timeout(waited));
            }
            Direction::Response => {
                let length = Some(frame.adu.len()).filter(|_| code & EXCEPTION_BIT == 0);
                self.in_flight.answer((frame.mbap_id, shape(length)), frame.start);
            }
            Direction::Unknown => {}
        }
    }

    /// Notes a finding on the connection itself.
    pub(crate) fn note_finding(&mut self, finding: Finding) {
        if !self.findings.contains(&finding) {
            self.findings.push(finding);
        }
    }

    /// Transactions are not closed in the order of their requests, so the lowest number counts.
    fn note_outcome(&mut self, txn: u64, status: Status) {
        if self.first.is_none_or(|(first, _)| txn < first) {
            self.first = Some((txn, status));
        }
    }
}

/// One for a function that writes, else none.
fn writes(function: u8) -> u64 {
    Functions::embedded().writes(function).into()
}
