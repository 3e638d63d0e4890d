//! What pairing remembers of transactions that are closed.

use std::collections::VecDeque;

use crate::pairing::wreck::Wreck;
use crate::pairing::{Exchange, Seen};
use modlens_protocol::direction::{answers, Asked, Match};
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// Unanswered requests that a late answer may still belong to.
const REMEMBERED: usize = 16;

/// An answer later than so many transactions belongs to none of them.
const LATE_BY: u64 = 4;

/// Shares before anything was seen: answers sent twice, and answered retries behind which an old answer comes that is
/// another one.
const FIRST_DUPLICATES: f32 = 0.001;
const FIRST_LATES: f32 = 0.1;

/// Which of the two a second answer behind a retry is, is said where one is so many times as likely as the other.
const CLEARLY: f32 = 3.0;

/// Each byte of a late answer may have changed by the time of the next one.
const SAME_BYTE: f32 = 0.97;

/// Observations that a prior is worth.
const PRIOR_WEIGHT: f32 = 4.0;

/// A request, in short.
#[derive(Clone, Debug)]
pub(super) struct Request {
    pub txn: u64,
    pub unit: u8,
    pub pdu: Vec<u8>,
    pub end: Option<Ns>,
    /// What came of it, if that was not all, or not right.
    wreck: Option<Wreck>,
}

impl Request {
    pub(super) fn of(exchange: &Exchange) -> Self {
        let (txn, unit, end) = (exchange.txn, exchange.unit, exchange.request.end);
        Self { txn, unit, end, pdu: exchange.request.pdu().to_vec(), wreck: None }
    }

    pub(super) fn is(&self, seen: &Seen<'_>) -> bool {
        match &self.wreck {
            Some(wreck) => wreck.is_of(seen.wire),
            None => self.unit == seen.unit() && self.pdu == seen.pdu(),
        }
    }

    fn answered_by(&self, functions: &Functions, seen: &Seen<'_>) -> bool {
        answers(functions, Asked { unit: self.unit, pdu: &self.pdu }, seen.unit(), seen.pdu()) == Match::Fully
    }
}

/// How often something happened where it could.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    times: f32,
    of: f32,
}

impl Share {
    fn rate(self, first: f32) -> f32 {
        (self.times + PRIOR_WEIGHT * first) / (self.of + PRIOR_WEIGHT)
    }
}

/// What is remembered.
#[derive(Debug, Default)]
pub(super) struct Past {
    /// Requests without an answer.
    unanswered: VecDeque<Request>,
    /// Those that the next request may repeat.
    failed: Vec<Request>,
    /// The last request that was answered, its answer, and whether it was a retry.
    last: Option<(u8, Vec<u8>, bool)>,
    /// The last request, if it was a broadcast that was heard once.
    pub broadcast: Option<Request>,
    duplicates: Share,
    lates: Share,
    /// Requests are missing from the recording before this transaction.
    missing_before: u64,
}

/// What an answer is that nobody waits for.
pub(super) enum Again {
    /// The answer before, once more.
    Duplicate,
    /// The answer to this request, too late.
    Late(Request),
    /// One of the two.
    Unclear,
    /// Neither.
    No,
}

impl Past {
    /// A request had no good answer; `silence`: none at all.
    pub(super) fn unanswered(&mut self, exchange: &Exchange, silence: bool) {
        let request = Request::of(exchange);
        if silence {
            if self.unanswered.len() == REMEMBERED {
                self.unanswered.pop_front();
            }
            self.unanswered.push_back(request.clone());
        }
        self.failed.push(request);
    }

    /// A request that arrived damaged was not answered.
    pub(super) fn damaged(&mut self, exchange: &Exchange) {
        let wreck = Some(Wreck::of(&exchange.request.wire));
        self.failed.push(Request { wreck, ..Request::of(exchange) });
    }

    /// The unanswered request that this one repeats. Only the next request is asked for.
    pub(super) fn repeated(&mut self, seen: &Seen<'_>) -> Option<Request> {
        let at = self.failed.iter().position(|request| request.is(seen));
        let found = at.map(|at| self.failed.swap_remove(at));
        self.failed.clear();
        found
    }

    pub(super) fn answered(&mut self, exchange: &Exchange, seen: &Seen<'_>) {
        let retry = exchange.retry_of.is_some();
        self.duplicates.of += 1.0;
        self.lates.of += f32::from(u8::from(retry));
        self.keep(seen.unit(), seen.pdu(), retry);
    }

    /// The same of a request that is no retry, but for the answer itself.
    #[inline]
    pub(super) fn answered_again(&mut self) {
        self.duplicates.of += 1.0;
    }

    /// The answer to such a request.
    pub(super) fn resume(&mut self, unit: u8, pdu: &[u8]) {
        self.keep(unit, pdu, false);
    }

    fn keep(&mut self, unit: u8, pdu: &[u8], retry: bool) {
        let (known, bytes, again) = self.last.get_or_insert_with(|| (unit, Vec::new(), retry));
        (*known, *again) = (unit, retry);
        bytes.clear();
        bytes.extend_from_slice(pdu);
    }

    /// The answer before, if its request was a retry.
    pub(super) fn answer_to_retry(&self) -> Option<(u8, &[u8])> {
        self.last.as_ref().filter(|(_, _, retry)| *retry).map(|(unit, pdu, _)| (*unit, &pdu[..]))
    }

    /// Requests are missing before this transaction: an answer behind it may be to one of them.
    pub(super) fn lacks_requests(&mut self, txn: u64) {
        self.missing_before = txn;
    }

    /// Whether all requests behind that of this transaction are known.
    pub(super) fn knows_all_since(&self, txn: u64) -> bool {
        txn >= self.missing_before
    }

    /// Whether no request could be a retry, or the echo of a broadcast.
    pub(super) fn idle(&self) -> bool {
        self.failed.is_empty() && self.broadcast.is_none()
    }

    /// The next request may or may not be one again.
    pub(super) fn forget_failed(&mut self) {
        self.failed.clear();
    }

    /// What an answer is that nobody waits for. `idle`: no request came since the last answer.
    pub(super) fn again(&mut self, functions: &Functions, seen: &Seen<'_>, txn: u64, idle: bool) -> Again {
        let last = self.last.as_ref().filter(|(unit, pdu, _)| idle && *unit == seen.unit() && pdu == seen.pdu());
        let recent = |old: &Request| old.txn + LATE_BY >= txn && self.knows_all_since(old.txn);
        let fits = |old: &Request| recent(old) && old.answered_by(functions, seen);
        let late = self.unanswered.iter().rposition(fits);
        let same = SAME_BYTE.powi(seen.pdu().len() as i32);
        let late_again = self.lates.rate(FIRST_LATES) * same / (1.0 - same);
        let duplicate = self.duplicates.rate(FIRST_DUPLICATES);
        match (last, late) {
            (Some((_, _, false)), _) | (Some(_), None) => {
                self.duplicates.times += 1.0;
                Again::Duplicate
            }
            (Some(_), Some(_)) if duplicate > CLEARLY * late_again => Again::Duplicate,
            (Some(_), Some(_)) if late_again < CLEARLY * duplicate => Again::Unclear,
            (last, Some(at)) => {
                self.lates.times += f32::from(u8::from(last.is_none()));
                self.unanswered.remove(at).map_or(Again::No, Again::Late)
            }
            (None, None) => Again::No,
        }
    }
}
