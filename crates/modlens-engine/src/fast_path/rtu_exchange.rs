//! The fast path of the RTU framer for whole exchanges: a request and its response are taken in one step.
//!
//! Each exchange has to leave the framer in exactly the state in which `Rtu::next` would leave it behind the two frames.

use crate::framer::exchange::Exchange;
use crate::framer::rtu::certain::{third_copy, SURELY_AN_ANSWER};
use crate::framer::rtu::side::REQUEST;
use crate::framer::rtu::traffic_model::RequestCopy;
use crate::framer::rtu::Rtu;
use crate::input::Input;
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::direction::Pause;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

impl Rtu {
    /// The exchange at the head of the input, if there is no doubt about it: its unit and function are familiar, and its
    /// request and its response follow each other with valid CRCs, in one read without times or within `patience`.
    ///
    /// May be called only while nothing is open (`Framer::settled`). `last_answered`: unit and function of the exchange
    /// before; `pause`: the log2 odds timeout : response of the silence before a byte.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
    pub fn exchange(
        &self,
        functions: &Functions,
        input: &Input,
        last_answered: Option<(u8, u8)>,
        patience: Ns,
        pause: impl Fn(usize) -> Pause,
    ) -> Option<Exchange> {
        let expected = Exchange::of(functions, Mode::Rtu, input.bytes())?;
        if expected.ambiguous && last_answered == Some((expected.unit, expected.code)) {
            return None;
        }
        let (request_bytes, response_bytes) = (expected.asked + CRC_BYTES, expected.answered + CRC_BYTES);
        let (request, rest) = input.bytes().split_at_checked(request_bytes)?;
        let response = rest.get(..response_bytes)?;
        let is_familiar = self.search.model.familiar(expected.unit, expected.code, REQUEST);
        let is_answered = is_familiar
            && expected.is_answered(request, response)
            && input.holds_exchange(Mode::Rtu, request_bytes, response_bytes, patience);
        if !is_answered || !crc_valid_at(rest, response_bytes) || !crc_valid_at(input.bytes(), request_bytes) {
            return None;
        }
        let is_certain = !expected.mirrored || is_response(pause(request_bytes), input.timed, rest, request_bytes);
        is_certain.then_some(expected)
    }

    /// Unit and function of the request that was answered last.
    pub fn before(&self) -> Option<(u8, u8)> {
        let (request, _) = self.search.answerable().last_answered?;
        Some((request.unit, *request.pdu.first()?))
    }

    /// Learns from a request and its response, whose CRCs are valid. `mirrored`: the two have the same bytes.
    #[inline]
    pub fn again(&mut self, request: &[u8], response: &[u8], mirrored: bool) {
        self.search.model.learn_exchange(request, response, if mirrored { RequestCopy::Unclear } else { RequestCopy::First });
    }

    /// Brings the search up to date behind a run of such exchanges. `expected` is the last one, whose bytes have just been
    /// consumed.
    pub fn resume(&mut self, input: &Input, expected: &Exchange) {
        let lengths = [expected.asked, expected.answered].map(|length| length + CRC_BYTES);
        let (request, response) = input.forgotten(lengths.iter().sum()).split_at(lengths[0]);
        self.last_was_damaged = false;
        self.search.sync_after_batch(request, response, input.offset());
    }
}

/// Whether the second of two equal frames is the response to the first and not a retry of it, by the pause between them or,
/// without times, because no third copy follows. `from_second` are the bytes from the second frame on.
fn is_response(pause: Pause, is_timed: bool, from_second: &[u8], length: usize) -> bool {
    pause <= SURELY_AN_ANSWER || (!is_timed && third_copy(from_second, length) == Some(false))
}
