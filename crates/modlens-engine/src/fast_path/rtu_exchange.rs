//! The fast path of the RTU framer for whole exchanges: a request and its response are taken in one step.
//!
//! Each exchange has to leave the framer in exactly the state in which `RtuFramer::next` would leave it after the two frames.

use crate::confidence::{self, Likeness};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::framer::rtu::frame_check::is_followed_by_copy;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::rtu_model::answerable::{may_answer, RequestHead};
use crate::rtu_model::side::REQUEST;
use crate::rtu_model::traffic_model::{LearningRun, RequestCopy};
use crate::weights::{ANSWER_IN_TURN_BITS, CERTAIN_DIRECTION_BITS, RESPONSE_LOG_ODDS_BITS};
use modlens_protocol::checksum::crc_valid_at;
use modlens_protocol::direction::TimeoutLogOdds;
use modlens_protocol::functions::Functions;

/// What a request may be in truth: the response to another one, where it looks like it.
#[derive(Clone, Copy, Default)]
pub struct Answered {
    /// The request that was answered last: its response may come again.
    last: Option<RequestHead>,
    /// The late response to a superseded request may still come.
    awaits_late_response: bool,
}

impl Answered {
    /// After an exchange whose request is at the head of these bytes.
    #[inline]
    pub fn by_exchange(request: &[u8]) -> Self {
        Self { last: request.first_chunk().copied(), awaits_late_response: false }
    }

    /// Returns whether the request of this exchange, which is at the head of these bytes, may be such a response.
    #[inline]
    pub(crate) fn may_be_again(self, functions: &Functions, expected: &ExpectedExchange, bytes: &[u8]) -> bool {
        (expected.resembles_response || expected.echoes_request) && self.may_be_answered_by(functions, bytes)
    }

    /// Returns whether these bytes may be such a response, if a response has their length.
    #[inline]
    pub(crate) fn may_be_answered_by(self, functions: &Functions, bytes: &[u8]) -> bool {
        self.awaits_late_response || self.last.is_some_and(|request| may_answer(functions, request, bytes))
    }
}

/// The last exchange of a run.
#[derive(Clone, Copy)]
pub(crate) struct LastExchange {
    pub expected: ExpectedExchange,
    /// Log2 of the odds of its response's direction.
    pub odds: f32,
}

impl RtuFramer {
    /// Returns whether there is nothing ambiguous in the exchange that the request at the head of the first of these bytes announces, and
    /// whose response is at the head of the others, as far as the bytes say: its unit and function are familiar, the response is the expected one, and the CRCs are valid; those of request
    /// and response are checked if `checks` says so. `answered`: what came before. `is_response`, asked with the bytes from the
    /// second frame on, says whether the second of two equal frames is the response to the first. `false` if the bytes end before
    /// the response.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Asked of every exchange.
    pub(crate) fn is_certain(
        &self,
        functions: &Functions,
        expected: &ExpectedExchange,
        [bytes, rest]: [&[u8]; 2],
        answered: Answered,
        checks: [bool; 2],
        is_response: impl Fn(&[u8]) -> bool,
    ) -> bool {
        let [request_bytes, response_bytes] = expected.rtu_lengths();
        if answered.may_be_again(functions, expected, bytes) || bytes.len() < request_bytes || rest.len() < response_bytes {
            return false;
        }
        let is_copy = || expected.echoes_request && request_bytes == 8 && bytes.first_chunk::<8>() == rest.first_chunk();
        self.search.model.is_familiar(expected.unit, expected.code, REQUEST)
            && expected.is_answered_by(bytes, rest)
            && (!checks[0] || crc_valid_at(bytes, request_bytes))
            && (!checks[1] || checks[0] && is_copy() || crc_valid_at(rest, response_bytes))
            && (!expected.echoes_request || is_response(rest))
    }

    /// Returns the exception code, if there is no doubt that the request at the head of these bytes, which announces this exchange,
    /// is refused right after it: its unit and function are familiar, and both CRCs are valid. `answered`: as above.
    #[cold]
    pub(crate) fn refusal_of(
        &self,
        functions: &Functions,
        expected: &ExpectedExchange,
        bytes: &[u8],
        answered: Answered,
    ) -> Option<u8> {
        let [request_bytes, response_bytes] = expected.refused().rtu_lengths();
        let response = bytes.get(request_bytes..)?;
        let exception = expected.refused_by(response)?;
        let is_certain = !answered.may_be_again(functions, expected, bytes)
            && self.search.model.is_familiar(expected.unit, expected.code, REQUEST)
            && crc_valid_at(response, response_bytes)
            && crc_valid_at(bytes, request_bytes);
        is_certain.then_some(exception)
    }

    /// What a request may be the response to, after what was framed so far.
    pub fn answered(&self) -> Answered {
        let requests = self.search.answerable();
        let last = requests.last_answered.map(|(request, _)| request.head());
        Answered { last, awaits_late_response: requests.superseded.is_some() }
    }

    /// Learns from a request and its response, whose CRCs are valid; what is the same for all exchanges of a run follows with
    /// `learn_run`. `echoes_request`: the two have the same bytes.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `TrafficModel::learn_in_run`.
    pub fn learn_in_run(&mut self, run: &mut LearningRun, request: &[u8], response: &[u8], echoes_request: bool) {
        let copy = if echoes_request { RequestCopy::Unclear } else { RequestCopy::First };
        self.search.model.learn_in_run(run, request, response, copy);
    }

    /// Brings up to date what `silence_share` goes by.
    #[inline]
    pub fn learn_answers(&mut self, run: &mut LearningRun) {
        self.search.model.learn_answers(run);
    }

    /// Brings up to date what is learned of a run, at its end.
    #[inline]
    pub fn learn_run(&mut self, run: &mut LearningRun) {
        self.search.model.learn_run(run);
    }

    /// Returns log2 of the odds of the direction of the response, which has the same bytes as the request if `expected` says so.
    /// `evidence` is what the silence before it says.
    #[inline]
    pub fn response_odds(&mut self, expected: &ExpectedExchange, has_times: bool, evidence: impl Fn() -> PauseEvidence) -> f32 {
        if expected.echoes_request {
            self.search.begin_run();
            self.search.mirrored_response_odds(expected.unit, evidence(), !has_times)
        } else {
            CERTAIN_DIRECTION_BITS
        }
    }

    /// Returns the same without times, of a response with the bytes of its request and a unit that does not answer this share of
    /// requests.
    pub(crate) fn mirrored_response_odds(&mut self, silence_share: f32, evidence: PauseEvidence) -> f32 {
        self.search.begin_run();
        self.search.odds_of_mirrored_response(silence_share, evidence, true)
    }

    /// Brings the search up to date after a run of such exchanges. `request` and `response` are the last one, which ends at the
    /// stream offset `end`; `odds` are those of its response.
    pub fn sync_after_batch(&mut self, request: &[u8], response: &[u8], end: u64, odds: f32) {
        self.last_was_damaged = false;
        self.search.sync_after_batch(request, response, end, odds);
    }
}

/// Returns whether the second of two equal frames is the response to the first and not a retry of it, by the pause between them or,
/// without times, because no third copy follows. `from_second` are the bytes from the second frame on.
pub(crate) fn is_response(pause: TimeoutLogOdds, is_timed: bool, from_second: &[u8], length: usize) -> bool {
    pause <= RESPONSE_LOG_ODDS_BITS || (!is_timed && is_followed_by_copy(from_second, length) == Some(false))
}

/// Returns the confidence of the request of an exchange on an RTU line. `echoes_request`: its response has the same bytes.
pub(crate) fn rtu_request_confidence(echoes_request: bool) -> u8 {
    confidence::of_unambiguous(Likeness::of_exchange(echoes_request))
}

/// Returns the confidence of the transaction of such an exchange, whose response's direction has `response_bits`.
pub(crate) fn rtu_transaction_confidence(echoes_request: bool, response_bits: u8) -> u8 {
    ANSWER_IN_TURN_BITS.min(rtu_request_confidence(echoes_request)).min(response_bits)
}
