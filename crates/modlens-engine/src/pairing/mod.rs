//! Joins the requests and responses of one bus to transactions.
//!
//! Its input is whole frames; where they begin is decided by the framer, and who sent them by `direction`. A request opens a
//! transaction. What closes it gives it its status:
//!
//! | event | status |
//! |--|--|
//! | the response that fits | `ok`, `exception` |
//! | a damaged frame in place of the response, then the next request | `bad_response` |
//! | a good response of another length than requested | `bad_response` |
//! | the next request, after at least the master's timeout, or the same one | `no_response` |
//! | another request, too soon for a timeout, though the unit does respond | `not_observed`: the tap has missed the response |
//! | the end of its waiting time, live or with a transaction identifier | `no_response` |
//! | bytes missing from the recording, or its end | `not_observed` |
//! | none; the request is a broadcast, and if that is a read, no response came | `broadcast` |
//!
//! A request with a wrong checksum opens a transaction of status `bad_request`, and a response that no open request fits is
//! a transaction by itself, `unsolicited`; `history` shows whether it is late or sent twice. On a serial line one request is
//! open at a time, or two that overlap (`masters`); on a TCP connection as many as there are transaction identifiers
//! (`transaction_ids`), which further requests leave open.
//!
//! How long a request waits is decided in `timeouts`: the timeout of the user, else the one that the master's retries have
//! shown (`timing`), else until the next request. It distinguishes a retry from a response that repeats its request,
//! a second master from one that gave up, and a silent unit from a response that the tap has missed.
//!
//! Some findings show only after the row of their frame is written (a second master, a response from the wrong unit): these
//! become delayed findings.

// A transaction is large and changes hands three times; moving its box is cheaper than moving it.
#![allow(clippy::vec_box)]

use std::collections::{BTreeMap, VecDeque};

mod certainty;
mod damaged_request;
mod echo;
mod echo_share;
mod history;
mod id_habit;
pub(crate) mod interval;
mod masters;
mod requests;
mod responses;
mod silence;
pub(crate) mod timeouts;
mod timing;
mod transaction_ids;
mod usual_interval;

pub use crate::transactions::result::{DelayedFinding, FrameLocation, Overlap, PairingResult};
pub use crate::transactions::transaction::{BufferedFrame, ObservedFrame, PendingTransaction};
pub use timing::TimingModel;
use usual_interval::UsualInterval;

use crate::findings::order;
use crate::findings::transaction::note_no_response;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use crate::transactions::transaction::{ConnectionEnd, EarlyResponse, UnitMismatch};
use echo_share::EchoStatistics;
use history::History;
use id_habit::IdHabit;
use interval::interval;
use masters::MasterEvidence;
use silence::Silence;

/// Closed transactions whose buffers are kept for new ones.
const MAX_REUSABLE: usize = 8;

/// The pairing of one bus, or of one connection.
#[derive(Debug)]
pub struct Pairing {
    /// Requests that wait for their response, the oldest first. A serial line has one, or two that overlap.
    pub(crate) open: VecDeque<Box<PendingTransaction>>,
    pub(crate) history: History,
    /// Transactions whose rows are written: their buffers are used again.
    reusable: Vec<Box<PendingTransaction>>,
    /// Response times and timeouts of the bus.
    pub timing: TimingModel,
    /// The time from answered requests to the next ones.
    pub(crate) usual_interval: UsualInterval,
    /// The timeout of requests that the user has set; learned where `None`.
    timeout: Option<Ns>,
    pub(crate) echoes: EchoStatistics,
    pub(crate) masters: MasterEvidence,
    /// Two overlapping transactions of which the later one has no response yet.
    half_answered_overlap: Option<Overlap>,
    /// A response from another unit than the one asked; the next request decides what it was.
    pub(crate) unit_mismatch: Option<UnitMismatch>,
    /// How often a response came from another unit than the one asked: by the unit asked and the one that answered.
    pub(crate) answered_by_other: BTreeMap<(u8, u8), u64>,
    /// The first unexplained response since the last pair, where the order of two lines is uncertain.
    pub(crate) early_response: Option<EarlyResponse>,
    /// A request that lacks bytes. A response to it would show that the unit could read it.
    pub(crate) truncated_request: Option<Box<PendingTransaction>>,
    /// Units that have responded.
    pub(crate) answering_units: Box<[bool; 256]>,
    /// Findings on frames whose rows are written.
    pub delayed_findings: Vec<DelayedFinding>,
    /// The step of the clock: a measured time means something from twice this on.
    pub resolution: Ns,
    /// How late the reads of this line come.
    pub read_lateness: Ns,
    /// Frames come in the order in which they were on the wire. Not so for two lines whose adapters hold bytes back.
    pub is_wire_order: bool,
    /// The order of requests and responses was inferred from their content: that a response is not seen proves nothing.
    pub order_is_inferred: bool,
    live: bool,
    /// The side that responds is recorded. Where it is not, its silence means nothing.
    pub response_side_recorded: bool,
    /// How the connection ended: no open request will have a response.
    pub connection_end: Option<ConnectionEnd>,
    /// Good requests and good responses so far.
    pub heard: [u64; 2],
    /// How far time has advanced.
    now: Option<Ns>,
    /// On a connection, what the server does with transaction identifiers.
    id_habit: IdHabit,
    /// On a connection, a response came after a further request: that one was no retry.
    is_pipelined: bool,
    /// The next frame is a response to the request before the open one, by what comes after it.
    pub(crate) next_answers_previous: bool,
}

impl Pairing {
    /// Pairing with this timeout of requests; it is learned where `None`. `live`: transactions are closed at their
    /// timeout, not at the next request.
    pub fn new(timeout: Option<Ns>, live: bool) -> Self {
        Self {
            open: VecDeque::new(),
            history: History::default(),
            reusable: Vec::new(),
            timing: TimingModel::default(),
            usual_interval: UsualInterval::default(),
            timeout,
            echoes: EchoStatistics::default(),
            masters: MasterEvidence::default(),
            half_answered_overlap: None,
            unit_mismatch: None,
            answered_by_other: BTreeMap::new(),
            early_response: None,
            truncated_request: None,
            answering_units: Box::new([false; 256]),
            delayed_findings: Vec::new(),
            resolution: 0,
            read_lateness: 0,
            is_wire_order: true,
            order_is_inferred: false,
            live,
            response_side_recorded: true,
            connection_end: None,
            heard: [0; 2],
            now: None,
            id_habit: IdHabit::default(),
            is_pipelined: false,
            next_answers_previous: false,
        }
    }

    /// The request that the next frame may answer: the last open one.
    pub fn outstanding_request(&self) -> Option<RequestRef<'_>> {
        self.open.back().map(|open| RequestRef { unit: open.unit, pdu: open.request.pdu() })
    }

    /// Unit and PDU of the last response, if its request was a retry.
    pub fn last_response_to_retry(&self) -> Option<(u8, &[u8])> {
        self.history.last_response_to_retry()
    }

    /// When the outstanding request ended.
    pub fn outstanding_request_end(&self) -> Option<Ns> {
        self.open.back()?.request.end
    }

    /// The smallest number of a transaction that is not closed: rows with greater numbers have to wait for it.
    pub fn oldest_open_txn(&self) -> Option<u64> {
        let mismatch = self.unit_mismatch.as_ref().map(|mismatch| mismatch.transaction.txn);
        self.open.iter().map(|open| open.txn).chain(mismatch).min()
    }

    /// Notes that bytes are missing from the recording here: they may have held the responses to all open requests.
    pub fn note_missing_bytes(&mut self) {
        for open in &mut self.open {
            open.silence_is_inconclusive = true;
        }
        self.history.note_missing_bytes();
    }

    /// Takes back a transaction whose row is written, to use its buffers again.
    pub fn recycle(&mut self, transaction: Box<PendingTransaction>) {
        if self.reusable.len() < MAX_REUSABLE {
            self.reusable.push(transaction);
        }
    }

    /// Good requests so far.
    fn requests_heard(&self) -> u64 {
        self.heard[0]
    }

    /// Good responses so far.
    fn responses_heard(&self) -> u64 {
        self.heard[1]
    }

    /// Pairs one frame; the transactions that it completes are added to `done`. A new transaction takes the number
    /// `next_txn` and increments it.
    pub fn add_frame(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        if frame.verdict.is_good() && frame.direction != Direction::Unknown {
            self.heard[usize::from(frame.direction == Direction::Response)] += 1;
        }
        if frame.is_cut {
            return self.add_cut(frame);
        }
        match (frame.verdict.is_good(), frame.direction) {
            (_, _) if frame.verdict == Verdict::Noise => PairingResult::default(),
            // A damaged response may lack unit and function: only that it came is known. On two lines whose order is
            // uncertain, it is not even known which request it followed.
            (false, Direction::Response) if self.is_wire_order => self.add_damaged(functions, frame, next_txn, done),
            (_, _) if frame.adu.len() < 2 => PairingResult::default(),
            (true, Direction::Request) => self.add_request(functions, frame, next_txn, done),
            (true, Direction::Response) if frame.lacks_request => PairingResult::default(),
            (true, Direction::Response) => self.add_response(functions, frame, next_txn, done),
            (true, Direction::Unknown) => {
                note_undirected(self.open.back_mut(), frame);
                PairingResult::default()
            }
            (false, _) => self.add_damaged(functions, frame, next_txn, done),
        }
    }

    /// A transaction with the next number, for this frame; the frame is not filled in yet.
    fn start(&mut self, frame: &ObservedFrame<'_>, next_txn: &mut u64) -> Box<PendingTransaction> {
        let mut transaction = self.reusable.pop().unwrap_or_else(|| Box::new(PendingTransaction::new(frame.mode)));
        transaction.reset(frame.mode);
        transaction.txn = *next_txn;
        *next_txn += 1;
        transaction.unit = frame.unit();
        transaction.function = frame.function();
        transaction.mbap_id = frame.mbap_id;
        transaction.origin = frame.origin;
        transaction
    }

    /// Closes a transaction without a good response. `if_silent` is its status if there was no response at all and the
    /// recording would have shown one; `silence` is from what that is concluded.
    fn close(
        &mut self,
        mut transaction: Box<PendingTransaction>,
        (if_silent, silence): (Status, Silence),
        done: &mut Vec<Box<PendingTransaction>>,
    ) {
        let silence_proves_nothing = transaction.silence_is_inconclusive || !self.response_side_recorded;
        let if_silent = if silence_proves_nothing { Status::NotObserved } else { if_silent };
        transaction.status = match transaction.status {
            Status::BadRequest => Status::BadRequest,
            _ if transaction.response.is_present() => Status::BadResponse,
            Status::Broadcast => Status::Broadcast,
            _ => if_silent,
        };
        if self.is_pipelined || transaction.status == Status::Broadcast {
            // The next request says nothing about how long this client waits.
            transaction.waited = None;
        }
        transaction.note_silence(silence);
        let had_no_response = transaction.status == Status::NoResponse;
        if transaction.status == Status::BadRequest {
            self.history.add_damaged(&transaction);
        } else if !transaction.expects_no_response {
            self.history.add_unanswered(&transaction, had_no_response && !transaction.has_late_response);
        }
        note_no_response(&mut transaction);
        done.push(transaction);
    }

    /// The unit of the last response, if no request has come since.
    pub(crate) fn unit_of_last_response(&self) -> Option<u8> {
        self.history.unit_of_last_response().filter(|_| self.open.is_empty())
    }

    /// When the next open request times out.
    pub fn deadline(&self) -> Option<Ns> {
        let waiting = self.open.iter().filter(|open| !open.is_timed_out);
        let end_of_wait =
            |open: &PendingTransaction| Some(open.request.end?.saturating_add(self.request_timeout(open.mbap_id.is_some())));
        waiting.filter_map(|open| end_of_wait(open)).min()
    }

    /// Lets time advance to `now`, so that open requests time out.
    ///
    /// A live tap closes them at once, and so is one with a transaction identifier, which no further request closes. In a
    /// recording without identifiers the transaction waits for the next request, to tell how long the master has waited.
    pub fn advance_time(&mut self, now: Ns, done: &mut Vec<Box<PendingTransaction>>) {
        self.now = self.now.max(Some(now));
        if self.open.is_empty() {
            return;
        }
        let timeouts = [false, true].map(|has_identifier| self.request_timeout(has_identifier));
        for open in &mut self.open {
            let timeout = timeouts[usize::from(open.mbap_id.is_some())];
            open.is_timed_out |= open.request.end.is_some_and(|end| now - end >= timeout);
        }
        let is_over = |open: &PendingTransaction, live: bool| open.is_timed_out && (live || open.mbap_id.is_some());
        while self.open.front().is_some_and(|open| is_over(open, self.live)) {
            self.resolve_unit_mismatch(None, done);
            let transaction = self.open.pop_front().expect("checked above");
            self.close(transaction, (Status::NoResponse, Silence::TimedOut), done);
        }
    }

    /// Closes everything at the end of the recording. Overlaps without proof of two masters are late responses.
    pub fn finish(&mut self, done: &mut Vec<Box<PendingTransaction>>) {
        self.resolve_unit_mismatch(None, done);
        let connection_end = self.connection_end.take();
        while let Some(mut transaction) = self.open.pop_front() {
            transaction.connection_end = connection_end;
            let waited = interval(transaction.request.end, self.now);
            let is_over = transaction.is_timed_out || connection_end.is_some();
            let is_given_up = is_over || waited.is_some_and(|waited| self.is_probably_given_up(waited));
            let status = if is_given_up { Status::NoResponse } else { Status::NotObserved };
            self.close(transaction, (status, Silence::TimedOut), done);
        }
        let unproven = self.masters.take_undecided().into_iter().filter(|overlap| !overlap.timeout_excluded);
        self.delayed_findings.extend(unproven.map(|overlap| order::unproven_overlap(&overlap)));
    }
}

/// A frame of which nobody knows who sent it opens nothing and answers nothing. But where it has the unit of the last open request, it may
/// be the response to that, whose silence proves nothing then.
fn note_undirected(open: Option<&mut Box<PendingTransaction>>, frame: &ObservedFrame<'_>) {
    if let Some(open) = open.filter(|open| open.unit == frame.unit()) {
        open.silence_is_inconclusive = true;
    }
}
