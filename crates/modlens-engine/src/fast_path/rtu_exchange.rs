//! The fast path of the RTU framer for whole exchanges: a request and its response are taken in one step.
//!
//! Each exchange has to leave the framer in exactly the state in which `RtuFramer::next` would leave it behind the two frames.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::frame_check::is_followed_by_copy;
use crate::framer::rtu::side::REQUEST;
use crate::framer::rtu::traffic_model::RequestCopy;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::input::Input;
use crate::weights::{CERTAIN_DIRECTION_BITS, RESPONSE_LOG_ODDS_BITS};
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::direction::TimeoutLogOdds;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

impl RtuFramer {
    /// The exchange at the head of the input, if there is no doubt about it: its unit and function are familiar, and its
    /// request and its response follow each other with valid CRCs, in one read without times or within `request_timeout`.
    ///
    /// May be called only while nothing is open (`Framer::is_settled_at`). `last_answered`: unit and function of the exchange
    /// before; `request_timeout` in nanoseconds; `pause`: the log2 odds timeout : response of the silence before the byte at an
    /// index of the input. Consumes and learns nothing: the caller does, if nothing else speaks against the exchange.
    ///
    /// `None` also while bytes of it are missing, where the request may be the previous response once more, where marks of the
    /// receiver or records forbid it (`Input::holds_exchange`), and where the response equals its request and may be a retry.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
    pub fn next_exchange(
        &self,
        functions: &Functions,
        input: &Input,
        last_answered: Option<(u8, u8)>,
        request_timeout: Ns,
        pause: impl Fn(usize) -> TimeoutLogOdds,
    ) -> Option<ExpectedExchange> {
        let expected = ExpectedExchange::from_request(functions, Mode::Rtu, input.bytes())?;
        if (expected.resembles_response || expected.echoes_request) && last_answered == Some((expected.unit, expected.code)) {
            return None;
        }
        let (request_bytes, response_bytes) = (expected.request_bytes + CRC_BYTES, expected.response_bytes + CRC_BYTES);
        let (request, rest) = input.bytes().split_at_checked(request_bytes)?;
        let response = rest.get(..response_bytes)?;
        let is_familiar = self.search.model.is_familiar(expected.unit, expected.code, REQUEST);
        let is_answered = is_familiar
            && expected.is_answered_by(request, response)
            && input.holds_exchange(Mode::Rtu, request_bytes, response_bytes, request_timeout);
        if !is_answered || !crc_valid_at(rest, response_bytes) || !crc_valid_at(input.bytes(), request_bytes) {
            return None;
        }
        let is_certain = !expected.echoes_request || is_response(pause(request_bytes), input.has_times, rest, request_bytes);
        is_certain.then_some(expected)
    }

    /// Unit and function of the request that was answered last.
    pub fn last_answered(&self) -> Option<(u8, u8)> {
        let (request, _) = self.search.answerable().last_answered?;
        Some((request.unit, *request.pdu.first()?))
    }

    /// Learns from a request and its response, whose CRCs are valid. `echoes_request`: the two have the same bytes.
    #[inline]
    pub fn record_exchange(&mut self, request: &[u8], response: &[u8], echoes_request: bool) {
        self.search.model.learn_exchange(
            request,
            response,
            if echoes_request { RequestCopy::Unclear } else { RequestCopy::First },
        );
    }

    /// Log2 of the odds of the direction of the response, which has the same bytes as the request if `expected` says so.
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

    /// Brings the search up to date behind a run of such exchanges. `expected` is the last one, whose bytes have just been
    /// consumed, and `odds` are those of its response.
    pub fn sync_after_batch(&mut self, input: &Input, expected: &ExpectedExchange, odds: f32) {
        let lengths = [expected.request_bytes, expected.response_bytes].map(|length| length + CRC_BYTES);
        let (request, response) = input.consumed_bytes(lengths.iter().sum()).split_at(lengths[0]);
        self.last_was_damaged = false;
        self.search.sync_after_batch(request, response, input.offset(), odds);
    }
}

/// Whether the second of two equal frames is the response to the first and not a retry of it, by the pause between them or,
/// without times, because no third copy follows. `from_second` are the bytes from the second frame on.
pub(super) fn is_response(pause: TimeoutLogOdds, is_timed: bool, from_second: &[u8], length: usize) -> bool {
    pause <= RESPONSE_LOG_ODDS_BITS || (!is_timed && is_followed_by_copy(from_second, length) == Some(false))
}
