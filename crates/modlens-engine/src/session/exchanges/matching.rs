//! Whether a request and the bytes after it are an exchange: decided here for each framing, from their bytes and what is known of
//! the bus. Nothing is consumed.

use memchr::memchr;

use crate::confidence;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::request_memo::RequestMemo;
use crate::fast_path::rtu_exchange::{is_response, rtu_request_confidence, Answered, LastExchange};
use crate::fast_path::OpenRequests;
use crate::framer::ascii::MAX_MESSAGE_CHARACTERS;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::pairing::TimingModel;
use crate::records::NOT_REFUSED;
use crate::rtu_model::traffic_model::LearningRun;
use crate::session::profiles::Profiles;
use crate::stats::RequestPlace;
use crate::weights::{ANSWER_BY_ID_BITS, ANSWER_IN_TURN_BITS, CERTAIN_DIRECTION_BITS, LRC_CONFIDENCE_BITS, MBAP_CONFIDENCE_BITS};
use modlens_protocol::checksum::lrc;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::decode_pairs;
use modlens_protocol::mbap::{transaction_id, PREFIX_BYTES as MBAP_PREFIX_BYTES};
use modlens_protocol::Ns;

/// Where in a message the length is that its header announces (messaging on TCP/IP, 3.1.3); after it come unit and PDU.
pub(super) const LENGTH_AT: usize = 4;

/// Characters of an ASCII frame around unit and PDU: the colon, two of the LRC, CR and LF.
const ASCII_FRAMING_CHARACTERS: usize = 5;

/// A request and its response.
pub(super) struct MatchedExchange {
    /// The exchange as the request announces it; the response is the one expected, or a refusal.
    pub expected: ExpectedExchange,
    pub mode: Mode,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// Lengths of request and response on their lines, in bytes or, for ASCII, characters.
    pub lengths: [usize; 2],
    /// Log2 of the odds of the response's direction.
    pub odds: f32,
    /// Where the statistics count the request, if that is known.
    pub counters: Option<RequestPlace>,
    /// The exception code of a refusal, else 0.
    pub exception: u8,
}

/// Returns the log2 odds that request and response on a connection belong together.
pub(super) fn confidence_by_id() -> u8 {
    ANSWER_BY_ID_BITS.min(MBAP_CONFIDENCE_BITS)
}

impl MatchedExchange {
    /// Returns the log2 odds that request and response belong together: as pairing has them, but not above those of the frames.
    pub(super) fn transaction_confidence(&self) -> u8 {
        let pairing = if self.mbap_id.is_some() { ANSWER_BY_ID_BITS } else { ANSWER_IN_TURN_BITS };
        pairing.min(self.request_confidence()).min(self.response_bits())
    }

    /// Returns the confidence of the request, which is that of the mode's framer.
    pub(super) fn request_confidence(&self) -> u8 {
        match self.mode {
            Mode::Rtu => rtu_request_confidence(self.expected.echoes_request),
            Mode::Ascii => LRC_CONFIDENCE_BITS,
            Mode::Tcp => MBAP_CONFIDENCE_BITS,
        }
    }

    /// Returns what the direction of the response allows for its confidence.
    pub(super) fn response_bits(&self) -> u8 {
        if self.mode == Mode::Rtu {
            confidence::of_direction(self.odds)
        } else {
            u8::MAX
        }
    }
}

/// What a run of RTU exchanges has taken and learned so far.
#[derive(Default)]
pub(super) struct RtuRun {
    /// What its next request may be the response to.
    answered: Answered,
    /// Its last exchange; on other lines than RTU, too.
    pub last_exchange: Option<LastExchange>,
    /// What the framer has still to learn of it.
    pub learning: LearningRun,
}

impl RtuRun {
    /// Returns a run that has nothing to learn but its last exchange.
    pub(super) fn ended_by(last: LastExchange) -> Self {
        Self { last_exchange: Some(last), ..Self::default() }
    }

    pub(super) fn after(framer: Option<&mut RtuFramer>) -> Self {
        Self { answered: framer.map_or(Answered::default(), |framer| framer.answered()), ..Self::default() }
    }
}

/// What is known of an RTU line, by which a request and its response are matched.
pub(super) struct RtuContext<'a> {
    pub functions: &'a Functions,
    pub framer: &'a mut RtuFramer,
    pub run: &'a mut RtuRun,
    pub memo: &'a RequestMemo,
    pub profiles: &'a mut Profiles,
    pub timing: &'a TimingModel,
    /// Reads have times.
    pub has_times: bool,
    /// The reader has found the checksums of both valid.
    pub are_proven: bool,
}

/// Returns the exchange of the request at the head of these bytes. `after(lengths)` gives the bytes after the request; `None`
/// unless both frames are in reads that hold nothing else that decides; `silence` is the silence before the response.
///
/// `None` where the framer has a doubt (`RtuFramer::is_certain`), where the slow path would have something to report on the
/// request, and where it would change the profile of its unit or give a finding there. Nothing is learned then. Otherwise
/// the profile has learned from the exchange; the framer's model has learned a part, the rest waits for the end of the run.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
pub(super) fn match_rtu<'b>(
    line: RtuContext<'_>,
    bytes: &[u8],
    after: impl Fn([usize; 2]) -> Option<&'b [u8]>,
    silence: impl Fn(usize) -> Option<Ns>,
) -> Option<MatchedExchange> {
    let RtuContext { functions, framer, run, timing, has_times, .. } = line;
    let (expected, known) = line.memo.announced(functions, Mode::Rtu, bytes, bytes)?;
    let lengths = expected.rtu_lengths();
    let checks = if line.are_proven { [false; 2] } else { [known.is_none(), true] };
    let response = after(lengths)?;
    let is_certain = framer.is_certain(functions, &expected, [bytes, response], run.answered, checks, |second| {
        is_response(timing.timeout_log_odds(silence(lengths[0])), has_times, second, lengths[0])
    });
    if !is_certain {
        return None;
    }
    let (request, response) = (&bytes[..lengths[0]], &response[..lengths[1]]);
    if !line.profiles.learn_on_fast_path(functions, request, expected.read_data(&response[..expected.response_bytes])) {
        return None;
    }
    let pause_evidence = || {
        let silence = silence(lengths[0]);
        let (timeout, poll) = (timing.timeout_log_odds(silence), timing.poll_log_odds(silence));
        PauseEvidence { timeout, poll, ..PauseEvidence::default() }
    };
    if expected.echoes_request {
        framer.learn_run(&mut run.learning);
    }
    let odds = framer.response_odds(&expected, has_times, pause_evidence);
    framer.learn_in_run(&mut run.learning, request, response, expected.echoes_request);
    (run.answered, run.last_exchange) = (Answered::by_exchange(bytes), Some(LastExchange { expected, odds }));
    let counters = known.and_then(|known| known.counters);
    Some(MatchedExchange { expected, mode: Mode::Rtu, mbap_id: None, lengths, odds, counters, exception: NOT_REFUSED })
}

/// Returns the exchange of which these are the packets of the client and of the server, and these their times, if there is no doubt
/// and no finding about it; `takes_refusals`: or if the server refuses the request, on a bus without profiles.
///
/// `None` unless the slow path has nothing to report on the request, requests that are still outstanding stay as they are
/// (`OpenRequests::stay_open_across`), both headers have the same transaction identifier and the right length, and the response is
/// the expected one. Last, the profile of the unit learns the data read; if that would change the profile or give a finding,
/// it learns nothing, and the result is `None`. Nothing else is changed.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
pub(super) fn match_tcp(
    functions: &Functions,
    (memo, profiles, open): (&RequestMemo, &mut Profiles, &OpenRequests),
    [asked, answered]: [&[u8]; 2],
    times: [Ns; 2],
    takes_refusals: bool,
) -> Option<MatchedExchange> {
    let (header, request) = asked.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let (response_header, response) = answered.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let (mut expected, known) = memo.announced(functions, Mode::Tcp, &asked[LENGTH_AT..], request)?;
    let refusal = if takes_refusals { expected.refused_by(response) } else { None };
    let mut counters = known.and_then(|known| known.counters);
    if refusal.is_some() {
        (expected, counters) = (expected.refused(), None);
    }
    let id = transaction_id(header);
    let is_whole = request.len() == expected.request_bytes && response.len() == expected.response_bytes;
    let is_answered = is_whole
        && open.stay_open_across(id, times)
        && mbap_prefix(*header) == mbap_prefix(framed(id, expected.request_bytes))
        && mbap_prefix(*response_header) == mbap_prefix(framed(id, expected.response_bytes))
        && (refusal.is_some()
            || expected.is_answered_by(request, response)
                && profiles.learn_on_fast_path(functions, request, expected.read_data(response)));
    let (lengths, exception) = ([asked.len(), answered.len()], refusal.unwrap_or(NOT_REFUSED));
    let (mode, mbap_id, odds) = (Mode::Tcp, Some(id), CERTAIN_DIRECTION_BITS);
    is_answered.then_some(MatchedExchange { expected, mode, mbap_id, lengths, odds, counters, exception })
}

/// Returns the exchange at the head of these characters. `adus` gets unit and PDU of the request and of its response; if there is
/// none, their content means nothing.
///
/// `None` if the messages are not all there, valid and clean, if the slow path would have something to report on the request, or
/// if that may be a response itself.
pub(super) fn match_ascii(functions: &Functions, text: &[u8], adus: &mut [Vec<u8>; 2]) -> Option<MatchedExchange> {
    let [request, response] = adus;
    let request_length = 2 + memchr(b'\r', &text[..text.len().min(MAX_MESSAGE_CHARACTERS)])?;
    let expected = decode_clean(text, request_length, request)
        .then(|| ExpectedExchange::from_request(functions, Mode::Ascii, request))?
        .filter(|expected| !expected.resembles_response)?;
    let response_length = ASCII_FRAMING_CHARACTERS + 2 * expected.response_bytes;
    let is_whole = request.len() == expected.request_bytes && decode_clean(&text[request_length..], response_length, response);
    let (lengths, odds) = ([request_length, response_length], CERTAIN_DIRECTION_BITS);
    (is_whole && expected.is_answered_by(request, response)).then_some(MatchedExchange {
        expected,
        mode: Mode::Ascii,
        mbap_id: None,
        lengths,
        odds,
        counters: None,
        exception: NOT_REFUSED,
    })
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

/// Returns unit and PDU of a packet that is a plain read or write and nothing else.
pub(super) fn plain_request<'a>(functions: &Functions, packet: &'a [u8]) -> Option<&'a [u8]> {
    let (header, request) = packet.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let expected = ExpectedExchange::from_request(functions, Mode::Tcp, request)?;
    let is_whole = request.len() == expected.request_bytes && header[2..] == [0, 0, 0, request.len() as u8];
    is_whole.then_some(request)
}

/// Returns the MBAP header in front of the unit (messaging on TCP/IP, 3.1.3): identifier, protocol 0, and the number of bytes of
/// unit and PDU, which is less than 256 for every plain read or write.
#[inline]
fn framed(id: u16, length: usize) -> [u8; MBAP_PREFIX_BYTES] {
    let [high, low] = id.to_be_bytes();
    [high, low, 0, 0, 0, length as u8]
}

/// Returns such a header as one number, which is faster to compare.
#[inline]
fn mbap_prefix(header: [u8; MBAP_PREFIX_BYTES]) -> u64 {
    let mut number = [0; 8];
    number[..MBAP_PREFIX_BYTES].copy_from_slice(&header);
    u64::from_le_bytes(number)
}
