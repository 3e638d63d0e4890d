//! The fast path on an ASCII line (serial line specification, 2.5.2).

use memchr::memchr;

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::framer::ascii::MAX_MESSAGE_CHARACTERS;
use crate::session::bus::{declared_direction, BusState};
use crate::session::exchanges::emit::{adjacent_spans, ExchangePlaces};
use crate::session::exchanges::rows::MatchedExchange;
use crate::session::exchanges::run::Run;
use crate::session::Session;
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::decode_pairs;
use modlens_protocol::Ns;

/// Characters around unit and PDU: the colon, two of the LRC, CR and LF.
const FRAMING_CHARACTERS: usize = 5;

/// Characters of a frame whose unit and PDU have so many bytes.
fn frame_characters(bytes: usize) -> usize {
    FRAMING_CHARACTERS + 2 * bytes
}

/// Decodes a frame of `length` characters into unit and PDU. False if it is not valid, or if a finding is due on it, as
/// there is on lower-case digits.
fn decode_clean(text: &[u8], length: usize, adu: &mut Vec<u8>) -> bool {
    adu.clear();
    let Some(([b':', digits @ ..], b"\r\n")) = text.get(..length).and_then(|text| text.split_last_chunk()) else { return false };
    // Without a branch for each digit.
    let is_upper_case = digits.iter().fold(true, |all, digit| all & !digit.is_ascii_lowercase());
    let is_valid = is_upper_case && digits.len() % 2 == 0 && decode_pairs(digits, adu) && lrc(adu) == 0;
    adu.pop();
    is_valid
}

/// Returns the exchange at the head of the only line of a bus, if there is no doubt and no finding about it. `adus` gets unit and
/// PDU of the request and of its response; if there is none, their content means nothing. `request_timeout` in nanoseconds.
///
/// `None` unless both messages are there and valid, the request is a plain read or write that cannot be a response, a
/// self-describing register map cannot begin in it, the response is the expected one, and marks, records and times agree
/// (`Input::holds_exchange`). A response that equals its request must not be declared otherwise by the recording, nor must the
/// silence before it fit a timeout better. Last, the profile of the unit learns the data read; if that would change the
/// profile or give a finding, it learns nothing, and the result is `None`: the slow path does it. Nothing else is changed,
/// and nothing is consumed.
fn match_exchange(
    state: &mut BusState,
    functions: &Functions,
    request_timeout: Ns,
    adus: &mut [Vec<u8>; 2],
) -> Option<MatchedExchange> {
    let input = &state.lines[0].1.input;
    let (expected, lengths) = decode_exchange(functions, input.bytes(), adus)?;
    if !input.holds_exchange(Mode::Ascii, lengths[0], lengths[1], request_timeout) {
        return None;
    }
    if expected.echoes_request && may_be_retry(state, lengths[0]) {
        return None;
    }
    let [request, response] = adus;
    let is_settled = state.profiles.learn_on_fast_path(functions, request, expected.read_data(response));
    let (mode, response_bits) = (Mode::Ascii, u8::MAX);
    is_settled.then_some(MatchedExchange { expected, mode, mbap_id: None, lines: [0, 0], lengths, response_bits, counters: None })
}

/// Returns a plain read or write that cannot be a response, and the response that it determines, at the head of these characters,
/// with the lengths of both in characters; `adus` gets unit and PDU of both. `None` if the messages are not all there, valid and
/// clean, or if a self-describing register map may begin in them.
fn decode_exchange(functions: &Functions, text: &[u8], adus: &mut [Vec<u8>; 2]) -> Option<(ExpectedExchange, [usize; 2])> {
    let [request, response] = adus;
    let request_length = 2 + memchr(b'\r', &text[..text.len().min(MAX_MESSAGE_CHARACTERS)])?;
    let expected = decode_clean(text, request_length, request)
        .then(|| ExpectedExchange::from_request(functions, Mode::Ascii, request))?
        .filter(|expected| !expected.resembles_response)?;
    let response_length = frame_characters(expected.response_bytes);
    let is_whole = request.len() == expected.request_bytes && decode_clean(&text[request_length..], response_length, response);
    (is_whole && expected.is_answered_by(request, response)).then_some((expected, [request_length, response_length]))
}

/// Returns whether a response that equals its request, which has this many characters, may be a retry of it: the recording declares
/// one of the two otherwise, or the silence between them fits a timeout better than a response time.
fn may_be_retry(state: &BusState, request_length: usize) -> bool {
    let input = &state.lines[0].1.input;
    let declared = |index| input.read(index).and_then(|read| read.side).map(|side| declared_direction(state.side_votes, side));
    declared(0) == Some(Direction::Response)
        || declared(request_length) == Some(Direction::Request)
        || state.pairing.timing.timeout_log_odds(input.pause_before(request_length)) > 0.0
}

impl Session {
    /// Emits the ASCII exchanges at the head of the only line of the bus with this index, until one does not match.
    ///
    /// Each is copied into the arena, as characters and as decoded PDUs, and emitted; pairing keeps its response as the last
    /// one. The statistics of the bus count the whole run at its end. The ASCII framer has nothing to learn from a frame.
    pub(super) fn emit_ascii_exchanges(&mut self, bus: usize) {
        let mut adus = std::mem::take(&mut self.adus);
        let mut run = Run::new(&mut self.buses[bus], 0);
        loop {
            let state = &mut self.buses[bus];
            let request_timeout = run.request_timeout(state);
            let Some(matched) = match_exchange(state, &self.functions, request_timeout, &mut adus) else { break };
            let wire = &state.lines[0].1.input.bytes()[..matched.lengths[0] + matched.lengths[1]];
            let wires = adjacent_spans(self.batch.store(wire).start as usize, matched.lengths);
            let pdus = Some(adus.each_ref().map(|adu| self.batch.store(&adu[1..])));
            self.emit_exchange::<false>(bus, &matched, &ExchangePlaces { wires, pdus }, &mut run);
            let response = &adus[1];
            self.buses[bus].pairing.sync_after_batch(response[0], &response[1..]);
        }
        self.adus = adus;
        if run.totals.exchanges > 0 {
            self.stats.record_batch(self.buses[bus].counts, Mode::Ascii, run.totals.exchanges, run.totals.bytes as u64);
        }
    }
}
