//! Pairing of a request: new, repeated, or sent while another one still waits for its response. Whether it is the
//! adapter's echo is decided in `echo`.

use crate::findings::order;
use crate::pairing::damaged_request::DamagedRequest;
use crate::pairing::echo::{mirrors_request, SameRequest};
use crate::pairing::history::PastRequest;
use crate::pairing::interval::interval;
use crate::pairing::silence::Silence;
use crate::pairing::timeouts::MIN_MASTER_TIMEOUT_NS;
use crate::pairing::usual_interval::UsualInterval;
use crate::pairing::{ObservedFrame, Pairing, PairingResult, PendingTransaction};
use crate::transactions::transaction::OverlappingRequest;
use crate::weights::TIMEOUT_EVIDENCE_BITS;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::BROADCAST_UNIT;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, Layout};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// A master that asks again after its usual interval has given up no sooner than others by so much: most timeouts are far longer
/// than the cycle of so fast a master.
const CYCLE_FACTOR: Ns = 2;

/// The same where its intervals are nearly equal, and this one is as well: hardly one timeout in a hundred is that by chance.
const EXACT_CYCLE_FACTOR: Ns = 4;

/// Requests that may be open at once on a TCP connection. A serial line has one or two.
const MAX_OPEN_REQUESTS: usize = 1024;

impl Pairing {
    /// Pairs a good request: closes the requests that it supersedes and opens a transaction for it, numbered `next_txn`.
    ///
    /// - The adapter's echo opens none: the result has the finding, and `compare_with_open` has marked the open request.
    /// - A truncated request before it, of which this is the retry, gets a transaction of its own, with the number before
    ///   this one's, and is closed at once. If it is not that, it is forgotten, also by an echo.
    /// - A request to another unit may leave the open one waiting (`close_superseded`); the overlap is noted for both.
    /// - A broadcast on a serial line is closed at once, because nobody responds to it.
    ///
    /// Closed transactions are appended to `done`, the oldest first.
    pub(super) fn add_request(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        let truncated = self.truncated_request.take();
        let same = self.compare_with_open(functions, frame);
        if let SameRequest::Echo(txn) = same {
            return order::echo(txn);
        }
        if frame.mode != Mode::Tcp {
            self.usual_interval.add_request(frame.start, frame.end, self.open.is_empty());
        }
        if let Some(pause) = frame.gap.filter(|_| self.open.is_empty() && mirrors_request(functions, frame.pdu())) {
            self.timing.record_poll_pause(pause);
        }
        self.resolve_unit_mismatch(Some(frame), done);
        if self.early_response.is_some() {
            self.learn_skew(functions, frame);
        }
        let overlap = self.close_superseded(functions, frame, done);
        if matches!(same, SameRequest::Ambiguous) {
            self.history.clear_retry_candidates();
        }
        if let Some(truncated) = truncated.filter(|truncated| self.is_retry_of_truncated(truncated, frame)) {
            self.open_truncated(truncated, next_txn);
            // An overlapping request stays open: the truncated one after it is the one to close.
            self.open.rotate_right(1);
            self.close_oldest(functions, frame, done);
        }
        let mut transaction = self.start_request(frame, next_txn);
        if let (Some(overlap), Some(open)) = (overlap, self.open.back_mut()) {
            open.waited = open.waited.or(interval(open.request.end, frame.start));
            let timeout_excluded = matches!(overlap, OverlapEvidence::BeforeTimeout);
            open.overlap = Some(OverlappingRequest { txn: transaction.txn, timeout_excluded, is_answered: false });
        }
        let mut result = PairingResult { txn: Some(transaction.txn), ..PairingResult::default() };
        self.mark_retry(&mut transaction, &mut result, frame);
        self.open_or_broadcast(functions, transaction, frame, &mut result, done);
        result
    }

    /// A transaction with the next number that begins with this request.
    fn start_request(&mut self, frame: &ObservedFrame<'_>, next_txn: &mut u64) -> Box<PendingTransaction> {
        let mut transaction = self.start(frame, next_txn);
        transaction.request.fill(frame);
        transaction.findings.extend_from_slice(frame.codes);
        transaction.gap = frame.gap;
        transaction
    }

    /// Marks a transaction as the retry of an earlier one, if its request repeats that: one without a good response, or on a
    /// connection one that is open (`repeated_on_connection`). The result gets the finding. All requests that this one might
    /// have repeated are forgotten.
    fn mark_retry(&mut self, transaction: &mut PendingTransaction, result: &mut PairingResult, frame: &ObservedFrame<'_>) {
        let repeated = self.history.take_repeated(frame).map(|repeated| repeated.txn);
        if let Some(repeated) = repeated.or_else(|| self.repeated_on_connection(frame)) {
            transaction.retry_of = Some(repeated);
            order::retry(transaction, result, repeated);
        }
    }

    /// Adds the transaction of a new request to the open ones; that of a broadcast on a serial line is closed at once and
    /// remembered, because its echo may follow. A read that is broadcast stays open, though no unit should respond to it
    /// (serial line specification, 2.1): some do.
    fn open_or_broadcast(
        &mut self,
        functions: &Functions,
        mut transaction: Box<PendingTransaction>,
        frame: &ObservedFrame<'_>,
        result: &mut PairingResult,
        done: &mut Vec<Box<PendingTransaction>>,
    ) {
        self.history.last_broadcast = None;
        if transaction.unit == BROADCAST_UNIT && frame.mode != Mode::Tcp {
            transaction.status = Status::Broadcast;
            self.history.last_broadcast = Some(PastRequest::of(&transaction));
            if order::broadcast(functions, &mut transaction, result) {
                transaction.expects_no_response = true;
                self.open.push_back(transaction);
            } else {
                done.push(transaction);
            }
        } else {
            transaction.expects_no_response = has_no_response(functions, &transaction);
            self.open.push_back(transaction);
        }
    }

    /// Closes the open requests whose response is not expected any more once this request was sent: on a connection those that
    /// `close_reused` names, and the oldest where more than `MAX_OPEN_REQUESTS` would be open; on a serial line all but the last
    /// one, and that as well, unless the new request overlaps it (`overlaps`). A response to one of them would be a late one.
    ///
    /// `Some` if the last open one stays open because of an overlap, with the evidence for it.
    fn close_superseded(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> Option<OverlapEvidence> {
        if frame.mode == Mode::Tcp {
            while self.open.len() >= MAX_OPEN_REQUESTS {
                self.close_oldest(functions, frame, done);
            }
            self.close_reused(functions, frame, done);
            return None;
        }
        while self.open.len() > 1 {
            self.close_oldest(functions, frame, done);
        }
        let overlap = self.open.back().and_then(|open| self.overlaps(open, frame));
        if overlap.is_none() && !self.open.is_empty() {
            self.close_oldest(functions, frame, done);
        }
        overlap
    }

    /// On a connection, closes the open requests whose transaction identifier this request uses again, and notes how long
    /// the client has waited for its last one. Of a client that numbers nothing and does not wait, several stay open.
    fn close_reused(&mut self, functions: &Functions, frame: &ObservedFrame<'_>, done: &mut Vec<Box<PendingTransaction>>) {
        let min_waited = 2 * self.resolution;
        if let Some(last) = self.open.back_mut() {
            let waited = || interval(last.request.end, frame.start).filter(|&ns| ns >= min_waited);
            last.waited = last.waited.or_else(waited);
        }
        let is_given_up = |this: &Self, open: &PendingTransaction| {
            let waited = interval(open.request.end, frame.start);
            open.mbap_id == frame.mbap_id && waited.is_none_or(|waited| !this.is_before_timeout(waited))
        };
        while let Some(at) = self.open.iter().position(|open| is_given_up(self, open)) {
            self.close_at(at, functions, frame, done);
        }
    }

    /// On a connection, the open request that this one repeats: the same content again right after it, from a client that was
    /// never seen to ask before it had its response, after a time at which it may have given up.
    fn repeated_on_connection(&self, frame: &ObservedFrame<'_>) -> Option<u64> {
        let open = self.open.back().filter(|_| frame.mode == Mode::Tcp && !self.is_pipelined)?;
        let is_same = open.unit == frame.unit() && open.request.pdu() == frame.pdu();
        let waited = interval(open.request.end, frame.start)?;
        // Its wait is known already where another request came in between, and where bytes are missing it may have had a response.
        let is_next = open.waited.is_none_or(|first| first == waited) && !open.silence_is_inconclusive;
        (is_same && is_next && !self.is_before_timeout(waited)).then_some(open.txn)
    }

    /// Whether this request leaves the open one waiting for its response, since a second master may have sent it: one to
    /// another unit, not a broadcast, while the open one may still be answered, because it has had no response, not even a
    /// damaged one, and has not timed out. `None` if not so, or if its own master may have given up by then, as masters on this
    /// line do (`is_before_timeout`). Without times one overlap at a time is assumed.
    fn overlaps(&self, open: &PendingTransaction, frame: &ObservedFrame<'_>) -> Option<OverlapEvidence> {
        let may_still_be_answered = !open.is_timed_out && !open.response.is_present();
        let waits = open.status != Status::BadRequest && !open.expects_no_response && may_still_be_answered;
        if open.unit == frame.unit() || !waits || frame.unit() == BROADCAST_UNIT {
            return None;
        }
        match interval(open.request.end, frame.start) {
            Some(waited) => self.is_before_timeout(waited).then_some(OverlapEvidence::BeforeTimeout),
            None => open.overlap.is_none().then_some(OverlapEvidence::WithoutClock),
        }
    }

    /// Pairs a request that arrived damaged, if it may be one (`may_be_damaged_request`); else it does nothing. One of its full
    /// length closes all open requests and opens a transaction, since a response to it would show that the unit could read it; a
    /// truncated one only waits for such a response, or for its retry.
    pub(super) fn add_damaged_request(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        if !self.may_be_damaged_request(functions, frame) {
            return PairingResult::default();
        }
        if frame.verdict != Verdict::BadChecksum {
            self.truncated_request = Some(truncated_request(frame));
            self.history.note_missing_requests(*next_txn);
            return PairingResult::default();
        }
        self.resolve_unit_mismatch(None, done);
        while !self.open.is_empty() {
            self.close_oldest(functions, frame, done);
        }
        let mut transaction = self.start_request(frame, next_txn);
        transaction.status = Status::BadRequest;
        let txn = transaction.txn;
        self.open.push_back(transaction);
        PairingResult { txn: Some(txn), ..PairingResult::default() }
    }

    /// Whether a damaged frame is taken for a request: on a serial line, where the framer takes it for one, with two bytes at
    /// least (unit and function), of which one is known: the function is in the table, or the unit has responded before.
    fn may_be_damaged_request(&self, functions: &Functions, frame: &ObservedFrame<'_>) -> bool {
        let is_known = || functions.name(frame.function()).is_some() || self.answering_units[usize::from(frame.unit())];
        frame.mode != Mode::Tcp && frame.direction == Direction::Request && frame.adu.len() > 1 && is_known()
    }

    /// Whether the frame is the retry of a request of which only the beginning arrived.
    fn is_retry_of_truncated(&self, truncated: &PendingTransaction, frame: &ObservedFrame<'_>) -> bool {
        let waited = interval(truncated.request.end, frame.start);
        let may_be_same = DamagedRequest::of(&truncated.request.wire).may_have_been(frame.wire);
        may_be_same && waited.is_none_or(|waited| !self.is_before_timeout(waited))
    }

    /// Gives a truncated request its transaction, once what follows has shown that it was a request.
    pub(super) fn open_truncated(&mut self, mut request: Box<PendingTransaction>, next_txn: &mut u64) {
        request.txn = *next_txn;
        *next_txn += 1;
        self.open.push_back(request);
    }

    /// Closes the oldest open request because `next` arrived, and learns from how long its master waited.
    pub(super) fn close_oldest(
        &mut self,
        functions: &Functions,
        next: &ObservedFrame<'_>,
        done: &mut Vec<Box<PendingTransaction>>,
    ) {
        self.close_at(0, functions, next, done);
    }

    /// As `close_oldest`, for the open request with this index; nothing if there is none. `waited`, where it is not known
    /// yet, is the time from the end of the request to the start of `next`; less than two steps of the clock is not kept.
    ///
    /// Without a good response its status is `no_response`, or in two cases `not_observed`. One: the unit does respond, and the tap
    /// has probably missed it, since the next request came too soon for a timeout, or nothing proves that there was one
    /// (`silence_of`). The other: the order of frames is inferred, where a lack of response may as well be missing bytes. Neither
    /// holds where `next` repeats the request, unless it comes just as soon as after a response (`is_missed_in_cycle`).
    /// `close` has the other statuses.
    fn close_at(&mut self, at: usize, functions: &Functions, next: &ObservedFrame<'_>, done: &mut Vec<Box<PendingTransaction>>) {
        let Some(mut transaction) = self.open.remove(at) else { return };
        let waited = transaction.waited.or(interval(transaction.request.end, next.start));
        transaction.waited = waited.filter(|&ns| ns >= 2 * self.resolution);
        let is_same = transaction.unit == next.unit() && transaction.request.pdu() == next.pdu();
        let is_missed = is_same && next.mode != Mode::Tcp && self.is_missed_in_cycle(&transaction, waited);
        let is_retried = is_same && !is_missed;
        let may_be_missed = is_missed || (is_same && waited.is_some_and(|waited| may_be_cycle(&self.usual_interval, waited)));
        if next.verdict.is_good() && !may_be_missed {
            self.learn_timeout(functions, &transaction, is_retried);
        }
        let silence = self.silence_of(&transaction, (waited, is_retried));
        let is_too_soon = is_missed || waited.is_some_and(|waited| !is_retried && self.is_before_timeout(waited));
        let is_missed_by_tap = (is_too_soon || matches!(silence, Silence::Unproven | Silence::Unheard))
            && self.answering_units[transaction.unit as usize];
        let is_unproven = self.order_is_inferred && !is_retried;
        let status = if is_missed_by_tap || is_unproven { Status::NotObserved } else { Status::NoResponse };
        self.close(transaction, (status, silence), done);
        if is_missed {
            self.history.clear_retry_candidates();
        }
    }

    /// Whether the tap has missed the response to an open request, because its master asks the same again as soon as it does
    /// after a response, and sooner than any master gives up.
    fn is_missed_in_cycle(&mut self, open: &PendingTransaction, waited: Option<Ns>) -> bool {
        let is_silent = !open.response.is_present() && !open.expects_no_response && open.status != Status::BadRequest;
        let is_soon =
            |&waited: &Ns| self.is_before_timeout(waited / CYCLE_FACTOR) || is_exact_cycle(&self.usual_interval, waited);
        let soon = waited.filter(is_soon);
        is_silent && soon.is_some_and(|waited| self.usual_interval.is_missed_response(waited))
    }

    /// Learns from a request that is closed because a good one came: if it arrived undamaged and had no response at all, that
    /// its master gave up, how long it waited, and whether it asked again.
    ///
    /// A request that its response repeats teaches nothing, since the timeout is what distinguishes such a response from a retry; nor
    /// does the wait of one that another overlaps, because a second master may have sent that.
    fn learn_timeout(&mut self, functions: &Functions, transaction: &PendingTransaction, is_retried: bool) {
        let is_damaged = transaction.status == Status::BadRequest;
        let was_silent = !transaction.response.is_present() && !transaction.expects_no_response && !is_damaged;
        if was_silent && !mirrors_request(functions, transaction.request.pdu()) {
            self.masters.add_timeout(is_retried);
            if let Some(waited) = transaction.waited.filter(|_| transaction.overlap.is_none()) {
                self.timing.record_timeout(waited, is_retried);
            }
        }
    }

    /// From what it is concluded that an open request had no response, when another request follows `waited` after it.
    fn silence_of(&self, open: &PendingTransaction, (waited, is_retried): (Option<Ns>, bool)) -> Silence {
        let has_timed_out = || self.timing.timeout_log_odds(waited) > TIMEOUT_EVIDENCE_BITS;
        match (is_retried, open.retry_of.is_some()) {
            (true, _) => Silence::BeforeRetry,
            (false, true) => Silence::OfRetry,
            (false, false) if self.responses_heard() == 0 => Silence::Unheard,
            (false, false) if self.masters.skips_by_habit() => Silence::ByHabit,
            (false, false) if has_timed_out() => Silence::BeforeAnother,
            (false, false) => Silence::Unproven,
        }
    }
}

/// Why a request is taken for that of a second master, which leaves the open one waiting.
#[derive(Clone, Copy)]
enum OverlapEvidence {
    /// By the clock it came sooner than any master gives up.
    BeforeTimeout,
    /// There is no clock, so that a timeout cannot be excluded.
    WithoutClock,
}

/// Whether a wait before the same request says nothing of a timeout: it is short, and the master waits as long after a response,
/// or has not shown how long it waits then. A unit that is dead is waited for in vain, so soon as well.
fn may_be_cycle(usual: &UsualInterval, waited: Ns) -> bool {
    let is_short = waited / CYCLE_FACTOR < MIN_MASTER_TIMEOUT_NS;
    (is_short || is_exact_cycle(usual, waited)) && (!usual.is_known() || (usual.is_usual(waited) && usual.may_go_on()))
}

/// Whether so short a wait is just one of the usual, nearly equal intervals.
fn is_exact_cycle(usual: &UsualInterval, waited: Ns) -> bool {
    waited / EXACT_CYCLE_FACTOR < MIN_MASTER_TIMEOUT_NS && usual.is_exactly_usual(waited)
}

/// The transaction of a request that lacks bytes; it has no number yet.
fn truncated_request(frame: &ObservedFrame<'_>) -> Box<PendingTransaction> {
    let mut request = Box::new(PendingTransaction::new(frame.mode));
    (request.unit, request.function, request.origin) = (frame.unit(), frame.function(), frame.origin);
    (request.gap, request.status) = (frame.gap, Status::BadRequest);
    request.request.fill(frame);
    request.findings.extend_from_slice(frame.codes);
    request
}

/// Whether the specification wants no response to this request (6.8, sub-function 4, force listen only mode).
fn has_no_response(functions: &Functions, transaction: &PendingTransaction) -> bool {
    let body = transaction.request.pdu().get(1..).unwrap_or(&[]);
    functions.row(transaction.function, body).is_some_and(|row| row.response == Layout::NoResponse)
}
