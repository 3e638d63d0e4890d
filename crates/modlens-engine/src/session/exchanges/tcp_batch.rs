//! The fast path on a TCP connection: each side has its own line, and each message has its own packet.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::request_memo::RequestMemo;
use crate::fast_path::OpenRequests;
use crate::session::bus::BusState;
use crate::session::exchanges::emit::ExchangePlaces;
use crate::session::exchanges::rows::MatchedExchange;
use crate::session::exchanges::run::Run;
use crate::session::profiles::Profiles;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Where in a message the length is that its header announces (messaging on TCP/IP, 3.1.3); after it come unit and PDU.
pub(super) const LENGTH_AT: usize = 4;

/// Returns the exchange at the heads of the two lines of a connection, with the times of its two packets, if both are plain, the
/// client's next packet comes after the response, and `match_packets` takes it. `lines`: indices of the client's line and of the
/// server's. Nothing is consumed.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn match_exchange(
    state: &mut BusState,
    functions: &Functions,
    open: &OpenRequests,
    lines: [usize; 2],
) -> Option<(MatchedExchange, [Ns; 2])> {
    let [client, server] = lines.map(|line| &state.lines[line].1.input);
    let ((asked, requested_at), (answered, answered_at)) = (client.first_packet()?, server.first_packet()?);
    let (bytes, times) = ([asked, answered], [requested_at, answered_at]);
    if client.second_read_time().is_some_and(|time| time <= answered_at) {
        return None;
    }
    let known = ConnectionContext { reads: &state.memo, profiles: &mut state.profiles, open };
    Some((match_packets(functions, known, bytes, times, lines)?, times))
}

/// What is known of a connection, by which a request and its response are matched.
pub(super) struct ConnectionContext<'a> {
    pub reads: &'a RequestMemo,
    pub profiles: &'a mut Profiles,
    pub open: &'a OpenRequests,
}

/// Returns the exchange of which these are the packets of the client and of the server, and these their times, if there is no doubt
/// and no finding about it.
///
/// `None` unless the request is a plain read or write in which no self-describing register map can begin, requests that are
/// still outstanding stay as they are (`OpenRequests::are_left_by`), the response comes after the request, within the request
/// time-out, both headers have the same transaction identifier and the right length, and the response is the
/// expected one. Last, the profile of the unit learns the data read; if that would change the profile or give a finding,
/// it learns nothing, and the result is `None`: the slow path does it. Nothing else is changed.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
pub(super) fn match_packets(
    functions: &Functions,
    of_bus: ConnectionContext<'_>,
    [asked, answered]: [&[u8]; 2],
    [requested_at, answered_at]: [Ns; 2],
    lines: [usize; 2],
) -> Option<MatchedExchange> {
    let (header, request) = asked.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let (response_header, response) = answered.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let known = of_bus.reads.get(&asked[LENGTH_AT..]);
    let expected = match known {
        Some(known) => known.expected,
        None => ExpectedExchange::from_request(functions, Mode::Tcp, request)?,
    };
    let id =
        of_bus.open.undoubted_id(&expected, ([header, response_header], [request, response]), [requested_at, answered_at])?;
    if !expected.is_answered_by(request, response) {
        return None;
    }
    let counters = known.and_then(|known| known.counters);
    let lengths = [asked.len(), answered.len()];
    let is_settled = of_bus.profiles.learn_on_fast_path(functions, request, expected.read_data(response));
    let (mode, mbap_id, response_bits) = (Mode::Tcp, Some(id), u8::MAX);
    is_settled.then_some(MatchedExchange { expected, mode, mbap_id, lines, lengths, response_bits, counters })
}

/// Returns the exchange of which these are the packets of the client and of the server, if that refuses the request without a
/// doubt, on a bus without profiles; with the exception code. What is asked of it is what `match_packets` asks.
#[cold]
pub(super) fn match_refusal(
    functions: &Functions,
    of_bus: ConnectionContext<'_>,
    [asked, answered]: [&[u8]; 2],
    times: [Ns; 2],
) -> Option<(MatchedExchange, u8)> {
    let (header, request) = asked.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let (response_header, response) = answered.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let expected = ExpectedExchange::from_request(functions, Mode::Tcp, request)?.refused();
    let exception = expected.refused_by(response)?;
    let id = of_bus.open.undoubted_id(&expected, ([header, response_header], [request, response]), times)?;
    let (lines, lengths) = ([0, 1], [asked.len(), answered.len()]);
    let (mode, mbap_id, response_bits, counters) = (Mode::Tcp, Some(id), u8::MAX, None);
    Some((MatchedExchange { expected, mode, mbap_id, lines, lengths, response_bits, counters }, exception))
}

impl OpenRequests {
    /// Returns the transaction identifier of an exchange whose two packets have these headers and, after them, unit and PDU;
    /// `None` if their lengths or headers are not the expected ones, the response is out of its time, or a request that is still
    /// outstanding would not stay as it is.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub(super) fn undoubted_id(
        &self,
        expected: &ExpectedExchange,
        ([header, response_header], [request, response]): ([&[u8; MBAP_PREFIX_BYTES]; 2], [&[u8]; 2]),
        [requested_at, answered_at]: [Ns; 2],
    ) -> Option<u16> {
        let id = u16::from_be_bytes([header[0], header[1]]);
        let is_whole = request.len() == expected.request_bytes && response.len() == expected.response_bytes;
        let is_in_turn = requested_at < answered_at && answered_at - requested_at < self.request_timeout;
        if !(is_whole && is_in_turn && self.are_left_by(id, [requested_at, answered_at])) {
            return None;
        }
        let are_framed = mbap_prefix(*header) == mbap_prefix(framed(id, expected.request_bytes))
            && mbap_prefix(*response_header) == mbap_prefix(framed(id, expected.response_bytes));
        are_framed.then_some(id)
    }
}

/// Unit and PDU of a packet that is a plain read or write and nothing else.
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

/// Such a header as one number, which is faster to compare.
#[inline]
fn mbap_prefix(header: [u8; MBAP_PREFIX_BYTES]) -> u64 {
    let mut number = [0; 8];
    number[..MBAP_PREFIX_BYTES].copy_from_slice(&header);
    u64::from_le_bytes(number)
}

impl Session {
    /// Emits the exchanges at the head of a TCP connection, the bus with this index, until one does not match. `lines`: indices
    /// of the client's line and of the server's. A connection without a clock is left to the slow path.
    ///
    /// Each is copied into the arena, with its MBAP headers, and emitted. Once at the end of the run, the statistics of the
    /// bus count it and pairing keeps the last response. If there was none, nothing is counted. The framer of a connection has
    /// nothing to learn from a frame.
    pub(super) fn emit_tcp_exchanges(&mut self, bus: usize, lines: [usize; 2]) {
        let [client, server] = lines;
        let mut run = Run::new(&mut self.buses[bus], client);
        run.is_compact = self.emits_compact_packets(bus);
        let Some(open) = self.buses[bus].pairing.open_requests().filter(|_| run.has_clock()) else { return };
        let mut last_response_bytes = None;
        loop {
            let state = &mut self.buses[bus];
            let Some((matched, times)) = match_exchange(state, &self.functions, &open, lines) else { break };
            state.connection.note_exchange(self.next_txn, Status::Ok, matched.mbap_id, times, &state.pairing);
            let [asked, answered] = [0, 1].map(|at| &state.lines[lines[at]].1.input.bytes()[..matched.lengths[at]]);
            let wires = [self.batch.store(asked), self.batch.store(answered)];
            self.emit_exchange::<true>(bus, &matched, &ExchangePlaces { wires, pdus: None }, &mut run);
            if matched.counters.is_none() {
                let state = &mut self.buses[bus];
                let asked = state.lines[client].1.input.consumed_bytes(matched.lengths[0]);
                state.memo.keep(&mut self.stats, state.counts, &asked[LENGTH_AT..], &matched.expected);
            }
            last_response_bytes = Some(matched.expected.response_bytes);
        }
        let Some(response_bytes) = last_response_bytes else { return };
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, Mode::Tcp, run.totals.exchanges, run.totals.bytes as u64);
        let response = state.lines[server].1.input.consumed_bytes(response_bytes);
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }
}
