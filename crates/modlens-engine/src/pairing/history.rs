//! What pairing remembers of closed transactions: to recognise retries, late responses and responses sent twice.

use std::collections::VecDeque;

use crate::ones::add_ones;
use crate::pairing::damaged_request::DamagedRequest;
use crate::pairing::{ObservedFrame, PendingTransaction};
use modlens_protocol::direction::{match_response, RequestRef, ResponseMatch};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::Ns;

/// Unanswered requests that a late response may still belong to.
const MAX_UNANSWERED_REQUESTS: usize = 16;

/// A late response belongs to a request at most so many transactions back.
const MAX_TRANSACTIONS_LATE: u64 = 4;

/// Prior share of responses that are sent twice.
const PRIOR_DUPLICATE_RATE: f32 = 0.001;

/// Prior share of answered retries after which the response to the first request still comes, with other content.
const PRIOR_LATE_RATE: f32 = 0.1;

/// A second response to a retry is called late, or a duplicate, only if that is so many times as likely as the other.
const DECISIVE_RATIO: f32 = 3.0;

/// Probability that a byte of a response is the same in the next response to the same request.
const UNCHANGED_BYTE_PROBABILITY: f32 = 0.97;

/// Observations that a prior weighs as much as.
const PRIOR_OBSERVATIONS: f32 = 4.0;

/// A request of the past.
#[derive(Clone, Debug)]
pub(crate) struct PastRequest {
    pub txn: u64,
    /// Transaction identifier of the MBAP header.
    id: Option<u16>,
    pub unit: u8,
    pub pdu: Vec<u8>,
    /// End of its last character.
    pub end: Option<Ns>,
    /// Its bytes, if it arrived damaged.
    damaged: Option<DamagedRequest>,
}

impl PastRequest {
    pub(super) fn of(transaction: &PendingTransaction) -> Self {
        let (txn, id, unit, end) = (transaction.txn, transaction.mbap_id, transaction.unit, transaction.request.end);
        Self { txn, id, unit, end, pdu: transaction.request.pdu().to_vec(), damaged: None }
    }

    /// Whether the frame is the same request again.
    pub(super) fn is_repeated_by(&self, frame: &ObservedFrame<'_>) -> bool {
        match &self.damaged {
            Some(damaged) => damaged.may_have_been(frame.wire),
            None => self.unit == frame.unit() && self.pdu == frame.pdu(),
        }
    }

    fn is_answered_by(&self, functions: &Functions, frame: &ObservedFrame<'_>) -> bool {
        match_response(functions, RequestRef { unit: self.unit, pdu: &self.pdu }, frame.unit(), frame.pdu())
            == ResponseMatch::Fully
    }
}

/// The response to the last request that was answered.
#[derive(Debug)]
struct LastResponse {
    txn: u64,
    /// Identifier of request and response; `None` where they have none, or not the same.
    id: Option<u16>,
    unit: u8,
    pdu: Vec<u8>,
    /// The request was a retry, so that the response to the first request may still come.
    is_to_retry: bool,
}

/// How often something happened, of the occasions on which it could have.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    events: f32,
    occasions: f32,
}

impl Share {
    fn estimate(self, prior: f32) -> f32 {
        (self.events + PRIOR_OBSERVATIONS * prior) / (self.occasions + PRIOR_OBSERVATIONS)
    }
}

/// The closed transactions, as far as later frames may refer to them.
#[derive(Debug, Default)]
pub(crate) struct History {
    /// Requests without any response, the oldest first.
    unanswered: VecDeque<PastRequest>,
    /// The last request without any response, whatever was concluded from that.
    last_unanswered: Option<PastRequest>,
    /// Requests without a good response, one of which the next request may repeat.
    retry_candidates: Vec<PastRequest>,
    last_response: Option<LastResponse>,
    /// The last request, if it was a broadcast and its echo was not seen yet.
    pub last_broadcast: Option<PastRequest>,
    /// Responses that were sent twice.
    duplicates: Share,
    /// Answered retries that were followed by the response to the first request.
    late_after_retry: Share,
    /// Before the transaction of this number, requests are missing from the recording.
    missing_before: u64,
}

/// What a response is for which no request is open.
pub(super) enum UnexpectedResponse {
    /// The previous response, sent twice.
    Duplicate,
    /// The late response to this request.
    Late(PastRequest),
    /// Either a duplicate or a late response; the evidence does not tell which.
    Ambiguous,
    /// Nothing that is remembered explains it.
    Unexplained,
}

impl History {
    /// Remembers a closed request without a good response as one that the next request may repeat; if it `was_silent`, that
    /// is, if there was no response at all, also as one that a late response may still answer (the last 16 of these are
    /// kept).
    pub(super) fn add_unanswered(&mut self, transaction: &PendingTransaction, was_silent: bool) {
        let request = PastRequest::of(transaction);
        self.last_unanswered = Some(request.clone()).filter(|_| !transaction.response.is_present());
        if was_silent {
            if self.unanswered.len() == MAX_UNANSWERED_REQUESTS {
                self.unanswered.pop_front();
            }
            self.unanswered.push_back(request.clone());
        }
        // Its master has completed another exchange since: what it asks now it asks again.
        let has_gone_on = transaction.overlap.is_some_and(|later| later.is_answered && !later.timeout_excluded);
        if !has_gone_on {
            self.retry_candidates.push(request);
        }
    }

    /// Remembers a request that arrived damaged and was not answered.
    pub(super) fn add_damaged(&mut self, transaction: &PendingTransaction) {
        let damaged = Some(DamagedRequest::of(&transaction.request.wire));
        self.retry_candidates.push(PastRequest { damaged, ..PastRequest::of(transaction) });
    }

    /// The request without a good response that this request repeats, if any; of several, the oldest. Only the next request
    /// counts as a retry, so all candidates are forgotten.
    pub(super) fn take_repeated(&mut self, frame: &ObservedFrame<'_>) -> Option<PastRequest> {
        let at = self.retry_candidates.iter().position(|request| request.is_repeated_by(frame));
        let found = at.map(|at| self.retry_candidates.swap_remove(at));
        self.retry_candidates.clear();
        found
    }

    /// Remembers the good response `frame` to a request, which may be sent twice or, after a retry, be followed by the
    /// response to the first request: both are counted as occasions.
    pub(super) fn add_answered(&mut self, transaction: &PendingTransaction, frame: &ObservedFrame<'_>) {
        let is_to_retry = transaction.retry_of.is_some();
        self.duplicates.occasions += 1.0;
        self.late_after_retry.occasions += f32::from(u8::from(is_to_retry));
        let id = frame.mbap_id.filter(|_| frame.mbap_id == transaction.mbap_id);
        self.set_last_response((transaction.txn, id), frame.unit(), frame.pdu(), is_to_retry);
    }

    /// Counts answered requests on the fast path, which are no retries. The last response is set by `sync_after_batch`.
    #[inline]
    pub(crate) fn count_answered(&mut self, requests: u32) {
        add_ones(&mut self.duplicates.occasions, requests);
    }

    /// Sets the last response after a run of the fast path.
    pub(crate) fn sync_after_batch(&mut self, txn_and_id: (u64, Option<u16>), unit: u8, pdu: &[u8]) {
        self.set_last_response(txn_and_id, unit, pdu, false);
    }

    fn set_last_response(&mut self, (txn, id): (u64, Option<u16>), unit: u8, pdu: &[u8], is_to_retry: bool) {
        let last = self.last_response.get_or_insert_with(|| LastResponse { txn, id, unit, pdu: Vec::new(), is_to_retry });
        (last.txn, last.id, last.unit, last.is_to_retry) = (txn, id, unit, is_to_retry);
        last.pdu.clear();
        last.pdu.extend_from_slice(pdu);
    }

    /// Whether this response to transaction `txn` would also be that to the one before, which had none.
    pub(super) fn may_answer_unanswered(&self, functions: &Functions, frame: &ObservedFrame<'_>, txn: u64) -> bool {
        self.unanswered.back().is_some_and(|old| old.txn + 1 == txn && old.is_answered_by(functions, frame))
    }

    /// Whether this response (unit and PDU) would also be that to the request before the open one, which had none and asked for something
    /// else.
    pub(crate) fn may_be_late(&self, functions: &Functions, open: &PendingTransaction, adu: &[u8]) -> bool {
        self.last_unanswered.as_ref().is_some_and(|old| {
            let request = RequestRef { unit: old.unit, pdu: &old.pdu };
            let is_other = old.txn + 1 == open.txn && old.pdu != open.request.pdu();
            is_other && match_response(functions, request, adu[0], &adu[1..]) == ResponseMatch::Fully
        })
    }

    /// Notes that the response to the last request without any comes late.
    pub(super) fn await_late(&mut self) {
        let is_known = |last: &PastRequest| self.unanswered.back().is_some_and(|old| old.txn == last.txn);
        if let Some(last) = self.last_unanswered.take().filter(|last| !is_known(last)) {
            self.unanswered.push_back(last);
        }
    }

    /// The unit of the last response.
    pub(super) fn unit_of_last_response(&self) -> Option<u8> {
        self.last_response.as_ref().map(|last| last.unit)
    }

    /// Unit and PDU of the last response, if its request was a retry.
    pub(super) fn last_response_to_retry(&self) -> Option<(u8, &[u8])> {
        self.last_response.as_ref().filter(|last| last.is_to_retry).map(|last| (last.unit, &last.pdu[..]))
    }

    /// Returns the transaction of the last response, if this one has its identifier, unit and function, an exception or not, and
    /// other content. `None` where the client has used the identifier for a request without response as well: it may be the late
    /// response to that.
    pub(super) fn contradicted_by(&self, frame: &ObservedFrame<'_>) -> Option<u64> {
        let last = self.last_response.as_ref().filter(|last| last.id.is_some() && last.id == frame.mbap_id)?;
        let has_function = last.pdu.first().is_some_and(|code| code & !EXCEPTION_BIT == frame.function());
        let is_other = last.unit == frame.unit() && has_function && last.pdu != frame.pdu();
        let may_be_late = || self.unanswered.iter().any(|old| old.id == last.id && old.txn + MAX_TRANSACTIONS_LATE >= last.txn);
        (is_other && !may_be_late()).then_some(last.txn)
    }

    /// Notes that bytes are missing from a connection: a request with the identifier of the last response may have been among them.
    pub(super) fn note_missing_bytes(&mut self) {
        if let Some(last) = &mut self.last_response {
            last.id = None;
        }
    }

    /// Notes that requests before this transaction are missing: a response after it may belong to one of them.
    pub(super) fn note_missing_requests(&mut self, before: u64) {
        self.missing_before = before;
    }

    /// Whether the recording lacks no request from this transaction on.
    pub(super) fn is_complete_since(&self, txn: u64) -> bool {
        txn >= self.missing_before
    }

    /// Whether the next request may repeat one without a good response.
    pub(crate) fn has_retry_candidates(&self) -> bool {
        !self.retry_candidates.is_empty()
    }

    /// Whether a request of a connection, the next one, repeats one without a good response.
    pub(crate) fn is_repeated_by(&self, unit: u8, pdu: &[u8]) -> bool {
        let is_same = |request: &PastRequest| request.damaged.is_some() || (request.unit == unit && request.pdu == pdu);
        self.retry_candidates.iter().any(is_same)
    }

    /// Forgets the requests that the next one may repeat: the evidence does not tell whether it is a retry.
    pub(crate) fn clear_retry_candidates(&mut self) {
        self.retry_candidates.clear();
    }

    /// Classifies a good response that no open request fits. `txn` is the number of its own transaction; `no_request_since`:
    /// no request came since the last response.
    ///
    /// | the last response, if no request came since | an unanswered request that it fully answers | result |
    /// |--|--|--|
    /// | the same, not to a retry | any | duplicate |
    /// | the same, to a retry | none | duplicate |
    /// | the same, to a retry | one | duplicate or late, if one is three times as likely as the other, else ambiguous |
    /// | another, or none | one | late |
    /// | another, or none | none | unexplained |
    ///
    /// The third row: it may as well be the late response to the first request, which by chance has the same content. The
    /// longer the response, the less likely that is. The unanswered request is the newest that fits; it must be at most four
    /// transactions back, with no requests missing from the recording since. If the response is late, that request is
    /// forgotten, as it has its response now. Duplicates (of the first two rows) and late responses (of the fourth) are
    /// counted, which makes them more likely the next time.
    pub(super) fn classify_unexpected(
        &mut self,
        functions: &Functions,
        frame: &ObservedFrame<'_>,
        txn: u64,
        no_request_since: bool,
    ) -> UnexpectedResponse {
        let is_same = |last: &&LastResponse| no_request_since && last.unit == frame.unit() && last.pdu == frame.pdu();
        let same_as_last = self.last_response.as_ref().filter(is_same).map(|last| last.is_to_retry);
        let is_recent = |old: &PastRequest| old.txn + MAX_TRANSACTIONS_LATE >= txn && self.is_complete_since(old.txn);
        let fits = |old: &PastRequest| is_recent(old) && old.is_answered_by(functions, frame);
        let newest_answered = self.unanswered.iter().rposition(fits);
        let unchanged = UNCHANGED_BYTE_PROBABILITY.powi(frame.pdu().len() as i32);
        let late_unchanged = self.late_after_retry.estimate(PRIOR_LATE_RATE) * unchanged / (1.0 - unchanged);
        let duplicate = self.duplicates.estimate(PRIOR_DUPLICATE_RATE);
        match (same_as_last, newest_answered) {
            (Some(false), _) | (Some(_), None) => {
                self.duplicates.events += 1.0;
                UnexpectedResponse::Duplicate
            }
            (Some(_), Some(_)) if duplicate > DECISIVE_RATIO * late_unchanged => UnexpectedResponse::Duplicate,
            (Some(_), Some(_)) if late_unchanged < DECISIVE_RATIO * duplicate => UnexpectedResponse::Ambiguous,
            (same_as_last, Some(at)) => {
                self.late_after_retry.events += f32::from(u8::from(same_as_last.is_none()));
                self.unanswered.remove(at).map_or(UnexpectedResponse::Unexplained, UnexpectedResponse::Late)
            }
            (None, None) => UnexpectedResponse::Unexplained,
        }
    }
}
