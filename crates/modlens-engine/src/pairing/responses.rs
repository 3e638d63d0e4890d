//! Pairing of a response: requested, late, sent twice, damaged, or from a unit that was not asked.

use crate::findings::order;
use crate::findings::transaction::{note_exception, response_lengths};
use crate::pairing::echo::mirrors_request;
use crate::pairing::history::UnexpectedResponse;
use crate::pairing::{FrameLocation, ObservedFrame, Pairing, PairingResult, PendingTransaction};
use crate::transactions::result::Overlap;
use crate::transactions::transaction::{EarlyResponse, OverlappingRequest, UnitMismatch};
use crate::weights::{
    BELATED_MIRROR_BITS, DUPLICATE_RESPONSE_BITS, LATE_RESPONSE_BITS, UNEXPECTED_IN_ANY_ORDER_BITS, UNEXPECTED_RESPONSE_BITS,
};
use modlens_protocol::direction::{match_response, repeats_other_address, Direction, RequestRef, ResponseMatch};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// Unit numbers above this are reserved on serial lines (serial line specification, 2.2).
const LAST_UNIT: u8 = 247;

/// Responses of one unit in the place of others from which on that is its habit.
const MIN_ANSWERED_BY_OTHER: u64 = 2;

impl Pairing {
    /// Learns how much later than its response this request is seen, if it is the request of the early response. Whether it is
    /// or not, the early response is forgotten: its request can only have been the next one.
    pub(super) fn learn_skew(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) {
        let Some((early, request_end)) = self.early_response.take().zip(frame.end) else { return };
        let request = RequestRef { unit: frame.unit(), pdu: frame.pdu() };
        if match_response(functions, request, early.unit, &early.pdu) == ResponseMatch::Fully {
            self.timing.record_skew(request_end, early.start);
        }
    }

    /// Pairs a good response with the open request that it answers, or with the truncated request that waits, which then gets
    /// its transaction. If it answers neither, it becomes a transaction by itself (`add_unrequested`). The truncated request
    /// no longer waits in any case.
    ///
    /// The transaction is taken out of the open ones and added to `done`, with the status `ok` or `exception`; that of a
    /// request that arrived damaged stays `bad_request`. What is learned: the unit responds, unless the frame is unconfirmed
    /// or the request damaged; the response time, or the skew of two lines; and, on a serial line, evidence of two masters.
    /// The result names the transaction, and has a finding, with the other transaction where there is one, if the response
    /// proves two masters, carries another transaction identifier, comes from another unit, or answers nothing.
    pub(super) fn add_response(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        let truncated = self.truncated_request.take();
        let at = if std::mem::take(&mut self.next_answers_previous) {
            self.history.await_late();
            None
        } else {
            self.find_request(functions, frame)
        };
        let at = at.or_else(|| self.open_truncated_if_answered(functions, truncated, frame, next_txn, done));
        let Some(at) = at else { return self.add_unrequested(functions, frame, next_txn, done) };
        self.early_response = None;
        self.is_pipelined |= frame.mode == Mode::Tcp && at + 1 < self.open.len();
        let mut transaction = self.open.remove(at).expect("found above");
        if frame.mode != Mode::Tcp && transaction.unit != frame.unit() && transaction.status != Status::Broadcast {
            *self.answered_by_other.entry((transaction.unit, frame.unit())).or_default() += 1;
        }
        transaction.certainty = self.answer_bits(functions, &transaction, frame);
        self.history.add_answered(&transaction, frame);
        answer(functions, &mut transaction, frame);
        if transaction.status != Status::BadRequest {
            self.answering_units[transaction.unit as usize] |= transaction.confirms_unit;
        }
        self.learn_response_time(&mut transaction, frame);
        let mut result = PairingResult { txn: Some(transaction.txn), ..PairingResult::default() };
        // Where the order of frames is inferred, an overlap of transactions proves nothing.
        if frame.mode != Mode::Tcp && self.is_wire_order {
            self.record_overlap(&mut transaction, frame, &mut result);
        }
        order::transaction_id(&mut transaction, &mut result, frame.mbap_id);
        order::other_unit(&mut transaction, &mut result, frame.unit());
        done.push(transaction);
        result
    }

    /// Sets the response time of a transaction, in ns, and learns from it; `None` where it cannot be measured. Of two lines
    /// whose order is uncertain, the skew is learned, too, from times however coarse.
    fn learn_response_time(&mut self, transaction: &mut PendingTransaction, frame: &ObservedFrame<'_>) {
        transaction.response_time = self.measurable_interval(transaction.request.end, frame.start, frame.clean_start);
        if let (false, Some((request_end, start))) = (self.is_wire_order, transaction.request.end.zip(frame.start)) {
            self.timing.record_skew(request_end, start);
        }
        match transaction.response_time {
            Some(time) if transaction.request.pdu() != transaction.response.pdu() => self.timing.record_response_time(time),
            Some(time) => self.timing.record_mirrored_response_time(time),
            None if transaction.request.pdu() != transaction.response.pdu() || frame.start.is_none() || frame.clean_start => {}
            None => self.timing.record_hidden_response_time(),
        }
    }

    /// Opens the truncated request, if there is one and this response comes from its unit and has its function; gives its
    /// index among the open ones, 0, since all that were open before are closed. Else `None`, and nothing is changed.
    fn open_truncated_if_answered(
        &mut self,
        functions: &Functions,
        truncated: Option<Box<PendingTransaction>>,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> Option<usize> {
        let request = truncated.filter(|request| (request.unit, request.function) == (frame.unit(), frame.function()))?;
        self.resolve_unit_mismatch(None, done);
        while !self.open.is_empty() {
            self.close_oldest(functions, frame, done);
        }
        self.open_truncated(request, next_txn);
        Some(0)
    }

    /// Index of the open request that the response answers: the oldest that it answers at least in unit and function (fully,
    /// if that is a broadcast), and that has not timed out. Where the response has a transaction identifier, `find_by_id` has
    /// other rules: the request with that identifier, or the last one where the server has the habit of another.
    fn find_request(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) -> Option<usize> {
        if frame.mbap_id.is_some() {
            return self.find_by_id(functions, frame);
        }
        let fits = |transaction: &PendingTransaction| {
            let matched = match_response(functions, transaction.request_to(frame.unit()), frame.unit(), frame.pdu());
            let enough = if transaction.status == Status::Broadcast { ResponseMatch::Fully } else { ResponseMatch::Partly };
            let is_other = matched == ResponseMatch::Partly && may_be_next_write(functions, transaction, frame);
            !transaction.is_timed_out && matched >= enough && !is_other
        };
        self.open.iter().position(|transaction| fits(transaction)).or_else(|| self.find_request_by_habit(functions, frame))
    }

    /// Index of the last open request, if this response fits it but for its unit and comes from a gateway that puts its own
    /// number into responses: a reserved one, or one that has answered for others before and never
    /// for itself. The unit asked has never answered by itself.
    fn find_request_by_habit(&self, functions: &Functions, frame: &ObservedFrame<'_>) -> Option<usize> {
        let unit = frame.unit();
        let answered = || self.answered_by_other.iter().filter(|((_, by), _)| *by == unit).map(|(_, n)| n).sum::<u64>();
        let is_gateway = !self.answering_units[usize::from(unit)] && (unit > LAST_UNIT || answered() >= MIN_ANSWERED_BY_OTHER);
        let answers_itself = |asked: u8| self.answering_units[usize::from(asked)];
        self.find_request_to_other_unit(functions, frame).filter(|&(_, asked)| is_gateway && !answers_itself(asked))?;
        self.open.len().checked_sub(1)
    }

    /// Counts the overlap of this answered transaction with another, once both are answered, as evidence of two masters. It
    /// may be the earlier of the two, whose `overlap` names the later one, or the later one. If the earlier one is answered
    /// first, the overlap waits in `half_answered_overlap`. Overlaps that are proven by now get their finding: on this frame,
    /// if it belongs to one of the two transactions (and none if it has another one already); else a delayed one, on the
    /// earlier response.
    fn record_overlap(&mut self, transaction: &mut PendingTransaction, frame: &ObservedFrame<'_>, result: &mut PairingResult) {
        if let Some(later) = transaction.overlap {
            let overlap = overlap_of(transaction, later, frame);
            if later.is_answered {
                self.masters.add_overlap(overlap);
            } else {
                self.half_answered_overlap = Some(overlap);
            }
        }
        for later in self.open.iter_mut().filter_map(|open| open.overlap.as_mut()) {
            later.is_answered |= later.txn == transaction.txn;
        }
        if let Some(overlap) = self.half_answered_overlap.take_if(|overlap| overlap.later_txn == transaction.txn) {
            self.masters.add_overlap(overlap);
        }
        for overlap in self.masters.take_proven() {
            self.delayed_findings.extend(order::two_masters(&overlap, transaction, result));
        }
    }

    /// The time in ns from the end of a request to the start of its response. `None` without a clock, if the start is not
    /// exact, or if it is less than two steps of the clock, or negative.
    pub fn measurable_interval(&self, end: Option<Ns>, start: Option<Ns>, is_exact: bool) -> Option<Ns> {
        let time = start? - end?;
        (is_exact && time >= 2 * self.resolution && time >= 0).then_some(time)
    }

    /// Pairs a good response that no open request fits: it becomes a transaction of status `unsolicited`, with the next
    /// number, and its finding says why it came. Tried in this order:
    ///
    /// 1. late, a duplicate, or in contradiction to the one before, as the past explains it (`explain_unrequested`);
    /// 2. the right response to the last open request but for its unit: the transaction waits in `unit_mismatch` for the next
    ///    request, in place of another one there, which is resolved. It is the only case that is not added to `done` at once;
    /// 3. from the unit of the last open request, but with another function;
    /// 4. unsolicited. If nothing at all explains it, requests are missing from the recording before it, which history notes.
    ///
    /// Where frames may not be in the order of the wire, an unexplained one is kept as the early response if none is: its
    /// request may only be seen later. No open request is closed or changed, but for one that this is the late response to.
    fn add_unrequested(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        let mut transaction = self.start_unsolicited(frame, next_txn);
        // The response to a write may be the same write again.
        let is_mirror = mirrors_request(functions, frame.pdu());
        let at_most = |bits: u8| if is_mirror { bits.min(BELATED_MIRROR_BITS) } else { bits };
        let result = match self.explain_unrequested(functions, frame, transaction.txn) {
            Explanation::Late { txn, request_end } => {
                transaction.late_response_to = Some(txn);
                transaction.late_response = self.measurable_interval(request_end, frame.start, frame.clean_start);
                transaction.certainty = at_most(LATE_RESPONSE_BITS);
                order::late(transaction.txn, txn)
            }
            Explanation::Conflicting { txn } => order::conflicting(transaction.txn, txn),
            Explanation::Duplicate => {
                transaction.certainty = at_most(DUPLICATE_RESPONSE_BITS);
                order::duplicate(transaction.txn)
            }
            unknown @ (Explanation::Ambiguous | Explanation::None) => {
                let is_unexplained = matches!(unknown, Explanation::None);
                if is_unexplained && !self.is_wire_order {
                    self.keep_early_response(frame);
                }
                if let Some((request_txn, asked)) = self.find_request_to_other_unit(functions, frame) {
                    *self.answered_by_other.entry((asked, frame.unit())).or_default() += 1;
                    return self.await_next_request(transaction, request_txn, done);
                }
                self.compare_function(&transaction, is_unexplained)
            }
        };
        transaction.findings.extend(result.finding);
        done.push(transaction);
        result
    }

    /// A transaction of status `unsolicited` with the next number that has only this response.
    fn start_unsolicited(&mut self, frame: &ObservedFrame<'_>, next_txn: &mut u64) -> Box<PendingTransaction> {
        let mut transaction = self.start(frame, next_txn);
        transaction.response.fill(frame);
        transaction.findings.extend_from_slice(frame.codes);
        transaction.status = Status::Unsolicited;
        // Where hardly any request is heard, somebody may have asked all the same.
        let hears_requests = 4 * self.requests_heard() >= self.responses_heard();
        let is_in_order = self.is_wire_order && !self.order_is_inferred && hears_requests;
        transaction.certainty = if is_in_order { UNEXPECTED_RESPONSE_BITS } else { UNEXPECTED_IN_ANY_ORDER_BITS };
        transaction.exception = exception_code(frame);
        transaction.gap = frame.gap;
        transaction
    }

    /// Keeps a response as the early one, whose request may only be seen later, unless one is kept already or it has no time.
    fn keep_early_response(&mut self, frame: &ObservedFrame<'_>) {
        if let (None, Some(start)) = (&self.early_response, frame.start) {
            self.early_response = Some(EarlyResponse { unit: frame.unit(), pdu: frame.pdu().to_vec(), start });
        }
    }

    /// Lets an unsolicited response, which fits the open request `request_txn` but for its unit, wait for the next request. One
    /// that waits already is resolved first, and added to `done`.
    fn await_next_request(
        &mut self,
        mut transaction: Box<PendingTransaction>,
        request_txn: u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        let result = order::unsolicited(transaction.txn);
        self.resolve_unit_mismatch(None, done);
        transaction.findings.extend(result.finding);
        self.unit_mismatch = Some(UnitMismatch { transaction, request_txn });
        result
    }

    /// The finding on an unsolicited response of which only its function may tell why it came: the last open request is to
    /// its unit, with another function, or not. If not, and if nothing else explains it either (`is_unexplained`), history is
    /// told that requests are missing before it.
    fn compare_function(&mut self, transaction: &PendingTransaction, is_unexplained: bool) -> PairingResult {
        let has_other_function =
            |open: &PendingTransaction| open.unit == transaction.unit && open.function != transaction.function;
        if let Some(open) = self.open.back().filter(|open| has_other_function(open)) {
            return order::wrong_function(transaction.txn, open.txn);
        }
        if is_unexplained {
            self.history.note_missing_requests(transaction.txn);
        }
        order::unsolicited(transaction.txn)
    }

    /// Why a response came that no open request fits, as far as the past explains it. `txn` is the number of its own
    /// transaction.
    ///
    /// A request that is still open though it has timed out comes first (`mark_late`). If the last open request arrived
    /// damaged, nothing is decided: it may be the response to that. Then it may contradict the last response; else the closed
    /// transactions are asked (`classify_unexpected`).
    fn explain_unrequested(&mut self, functions: &Functions, frame: &ObservedFrame<'_>, txn: u64) -> Explanation {
        if let Some(late) = self.mark_late(functions, frame) {
            return late;
        }
        if self.open.back().is_some_and(|open| open.status == Status::BadRequest) {
            return Explanation::Ambiguous;
        }
        if let Some(txn) = self.history.contradicted_by(frame) {
            return Explanation::Conflicting { txn };
        }
        match self.history.classify_unexpected(functions, frame, txn, self.open.is_empty()) {
            UnexpectedResponse::Duplicate => Explanation::Duplicate,
            UnexpectedResponse::Late(old) => Explanation::Late { txn: old.txn, request_end: old.end },
            UnexpectedResponse::Ambiguous => Explanation::Ambiguous,
            UnexpectedResponse::Unexplained => Explanation::None,
        }
    }

    /// Marks the oldest open request that has timed out and that this response fully answers as having its late response; it
    /// stays open. `None` if there is none, if it has one already, or if requests are missing from the recording since.
    fn mark_late(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) -> Option<Explanation> {
        let is_late_for = |old: &PendingTransaction| {
            let request = RequestRef { unit: old.unit, pdu: old.request.pdu() };
            let fits = match_response(functions, request, frame.unit(), frame.pdu()) == ResponseMatch::Fully;
            old.is_timed_out && !old.has_late_response && fits && self.history.is_complete_since(old.txn)
        };
        let at = self.open.iter().position(|old| is_late_for(old))?;
        let old = &mut self.open[at];
        old.has_late_response = true;
        Some(Explanation::Late { txn: old.txn, request_end: old.request.end })
    }

    /// Transaction and unit of the last open request that this response would fully answer, had it come from the unit asked.
    /// `None` on a connection, and if that request is to the same unit, arrived damaged, has its response (a damaged one), or
    /// wants none.
    fn find_request_to_other_unit(&self, functions: &Functions, frame: &ObservedFrame<'_>) -> Option<(u64, u8)> {
        let open = self.open.back().filter(|open| open.unit != frame.unit() && frame.mode != Mode::Tcp)?;
        let waits = open.status != Status::BadRequest && !open.response.is_present() && !open.expects_no_response;
        let request = RequestRef { unit: frame.unit(), pdu: open.request.pdu() };
        let fits = waits && match_response(functions, request, frame.unit(), frame.pdu()) == ResponseMatch::Fully;
        fits.then_some((open.txn, open.unit))
    }

    /// Decides whether the response that waits in `unit_mismatch` was meant for the open request, now that `next` has come,
    /// or `None` where something other than a good request ends the wait. Its transaction is added to `done` either way.
    /// Without one that waits, nothing happens.
    ///
    /// It came from the wrong unit if its request is still open and has timed out or is sent again, or if the next request
    /// came no sooner than a master gives up. That becomes a delayed finding. Else requests are missing before it.
    ///
    /// A master that drops the response waits for its timeout, and most retry then. If the next request comes sooner, the
    /// master was content: the tap has missed the right response, and the request of the one that seemed wrong.
    pub(super) fn resolve_unit_mismatch(&mut self, next: Option<&ObservedFrame<'_>>, done: &mut Vec<Box<PendingTransaction>>) {
        let Some(UnitMismatch { mut transaction, request_txn }) = self.unit_mismatch.take() else { return };
        let is_wrong_unit = self.open.iter().find(|open| open.txn == request_txn).is_some_and(|open| {
            let is_retried = next.is_some_and(|next| open.unit == next.unit() && open.request.pdu() == next.pdu());
            let waited = next.and_then(|next| next.start).zip(open.request.end).map(|(start, end)| start - end);
            is_retried || open.is_timed_out || waited.is_some_and(|waited| !self.is_before_timeout(waited))
        });
        if is_wrong_unit {
            self.delayed_findings.push(order::wrong_unit(&mut transaction, request_txn));
        } else {
            self.history.note_missing_requests(transaction.txn);
        }
        done.push(transaction);
    }

    /// The end of the recording cuts this frame. If it may be the response to the last open request, that was not observed; it
    /// is no damaged one.
    pub(super) fn add_cut(&mut self, frame: &ObservedFrame<'_>) -> PairingResult {
        let Some(open) = self.open.back_mut().filter(|_| frame.direction != Direction::Request) else {
            return PairingResult::default();
        };
        open.silence_is_inconclusive = true;
        PairingResult { txn: Some(open.txn), ..PairingResult::default() }
    }

    /// Pairs a damaged frame: with the last open request, if it may be its response, else as a damaged request.
    ///
    /// It may be the response if that request has neither timed out nor a response yet, and the frame has its unit and
    /// function, or at least is not taken for a request. The request stays open, so that its status, `bad_response`, is set
    /// when it is closed; the frame's findings become the transaction's.
    pub(super) fn add_damaged(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<PendingTransaction>>,
    ) -> PairingResult {
        if let Some(open) = self.open.back_mut().filter(|open| !open.is_timed_out) {
            let same_header = frame.unit() == open.unit && frame.function() == open.function;
            // What the sender of the request sends after it is no response.
            let is_of_sender = (open.request.side, frame.side) == (Some(Side::Sent), Some(Side::Sent));
            if !open.response.is_present() && !is_of_sender && (same_header || frame.direction != Direction::Request) {
                open.response.fill(frame);
                open.findings.extend_from_slice(frame.codes);
                return PairingResult { txn: Some(open.txn), ..PairingResult::default() };
            }
        }
        self.add_damaged_request(functions, frame, next_txn, done)
    }
}

/// Why a response came that no open request fits.
enum Explanation {
    /// It is the late response of this transaction.
    Late { txn: u64, request_end: Option<Ns> },
    /// It is the previous response, sent twice.
    Duplicate,
    /// It contradicts the response of this transaction, which has its identifier.
    Conflicting { txn: u64 },
    /// There are several explanations, between which the evidence does not decide.
    Ambiguous,
    /// Nothing explains it.
    None,
}

/// Puts the response into the transaction of its request, with its findings, an exception's among them. The status becomes
/// `ok` or `exception`, or `bad_response` where the response has another length than was requested: nobody knows which
/// registers its values belong to. That of a request that arrived damaged stays `bad_request`. How long the master waited is
/// no longer noted: that is the time of a request without response.
fn answer(functions: &Functions, transaction: &mut PendingTransaction, frame: &ObservedFrame<'_>) {
    transaction.waited = None;
    transaction.confirms_unit = !frame.unconfirmed && transaction.unit == frame.unit();
    transaction.response.fill(frame);
    transaction.findings.extend_from_slice(frame.codes);
    transaction.exception = exception_code(frame);
    if transaction.status != Status::BadRequest {
        transaction.status = match transaction.exception {
            Some(_) => Status::Exception,
            None if response_lengths(functions, transaction).is_some_and(|(length, requested)| length != requested) => {
                Status::BadResponse
            }
            None => Status::Ok,
        };
    }
    note_exception(transaction);
}

/// Whether a response with another address than this write is rather the next of several writes of which one side is heard:
/// where the response should repeat its request byte by byte.
fn may_be_next_write(functions: &Functions, open: &PendingTransaction, frame: &ObservedFrame<'_>) -> bool {
    let request = open.request.pdu();
    let row = functions.row(open.function, request.get(1..).unwrap_or(&[])).filter(|row| row.has_equal_layouts);
    row.is_some_and(|row| repeats_other_address(row, request, frame.pdu()))
}

/// The overlap of this transaction, which `frame` answers, with a later one.
fn overlap_of(transaction: &PendingTransaction, later: OverlappingRequest, frame: &ObservedFrame<'_>) -> Overlap {
    let (txn, unit) = (transaction.txn, transaction.unit);
    let response = FrameLocation { txn, frame: frame.number, unit, start: frame.start, origin: frame.origin };
    Overlap { response, later_txn: later.txn, timeout_excluded: later.timeout_excluded }
}

/// The exception code of a response whose function code has the exception bit.
fn exception_code(frame: &ObservedFrame<'_>) -> Option<u8> {
    frame.pdu().first().filter(|&code| code & EXCEPTION_BIT != 0).and_then(|_| frame.pdu().get(1).copied())
}
