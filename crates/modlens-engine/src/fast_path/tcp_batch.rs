//! The fast path on a TCP connection: each side has its own line, and each message has its own packet.

use crate::fast_path::emit::{may_hold_no_map, ExchangePlaces, Run};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rows::MatchedExchange;
use crate::input::Input;
use crate::session::bus::BusState;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;

/// The exchange at the heads of the two lines of a connection, with the times of its two packets, if there is no doubt and no
/// finding about it. `lines`: indices of the client's line and of the server's.
///
/// `None` unless the request is a plain read or write in which no self-describing register map can begin, requests that are
/// still outstanding stay as they are (`Pairing::leaves_open_requests`), request and
/// response are a packet each that has a time, the response comes behind the request, within the request time-out and before
/// the client's next packet, both headers have the same transaction identifier and the right length, and the response is the
/// expected one. Last, the profile of the unit learns the data read; if that would change the profile or give a finding,
/// it learns nothing, and the result is `None`: the slow path does it. Nothing else is changed, and nothing is consumed.
#[inline]
fn match_exchange(state: &mut BusState, functions: &Functions, lines: [usize; 2]) -> Option<(MatchedExchange, [Ns; 2])> {
    let [client, server] = lines.map(|line| &state.lines[line].1.input);
    let (header, request) = client.bytes().split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let expected = ExpectedExchange::from_request(functions, Mode::Tcp, request).filter(may_hold_no_map)?;
    let lengths = [expected.request_bytes, expected.response_bytes].map(|length| MBAP_PREFIX_BYTES + length);
    let times = packet_times(state, [client, server], lengths)?;
    // A packet always has all of its bytes.
    let request = &request[..expected.request_bytes];
    let (response_header, response) = server.bytes()[..lengths[1]].split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let id = u16::from_be_bytes([header[0], header[1]]);
    if !state.pairing.leaves_open_requests(id, times) {
        return None;
    }
    let are_framed =
        *header == mbap_prefix(id, expected.request_bytes) && *response_header == mbap_prefix(id, expected.response_bytes);
    if !(are_framed && expected.is_answered_by(request, response)) {
        return None;
    }
    let is_settled = state.profiles.learn_on_fast_path(functions, request, expected.read_data(response));
    let (mode, mbap_id, response_bits) = (Mode::Tcp, Some(id), u8::MAX);
    is_settled.then_some((MatchedExchange { expected, mode, mbap_id, lines, lengths, response_bits }, times))
}

/// The times of the packets at the heads of client and server, if they have exactly these lengths and come in turn: the response
/// later than the request, less than the request time-out later, and before the client's next packet, if that is there.
#[inline]
fn packet_times(state: &BusState, [client, server]: [&Input; 2], lengths: [usize; 2]) -> Option<[Ns; 2]> {
    let (requested_at, next_request_at) = client.whole_packet(lengths[0])?;
    let (answered_at, _) = server.whole_packet(lengths[1])?;
    let is_in_turn = requested_at < answered_at
        && answered_at - requested_at < state.pairing.request_timeout(true)
        && next_request_at.is_none_or(|time| time > answered_at);
    is_in_turn.then_some([requested_at, answered_at])
}

/// The MBAP header in front of the unit (messaging on TCP/IP, 3.1.3): identifier, protocol 0, and the number of bytes of unit and
/// PDU, which is less than 256 for every plain read or write.
#[inline]
fn mbap_prefix(id: u16, length: usize) -> [u8; MBAP_PREFIX_BYTES] {
    let [high, low] = id.to_be_bytes();
    [high, low, 0, 0, 0, length as u8]
}

impl Session {
    /// Emits the exchanges at the head of a TCP connection, the bus with this index, until one does not match. `lines`: indices
    /// of the client's line and of the server's.
    ///
    /// Each is copied into the arena, with its MBAP headers, and emitted. Once at the end of the run, the statistics of the
    /// bus count it and pairing keeps the last response. If there was none, nothing is counted. The framer of a connection has
    /// nothing to learn from a frame.
    pub(super) fn emit_tcp_exchanges(&mut self, bus: usize, lines: [usize; 2]) {
        let [client, server] = lines;
        let mut run = Run::new(&mut self.buses[bus], client);
        let mut last_response_bytes = None;
        loop {
            let state = &mut self.buses[bus];
            let Some((matched, times)) = match_exchange(state, &self.functions, lines) else { break };
            state.connection.note_exchange(self.next_txn, matched.mbap_id, times, &state.pairing);
            let wires = [0, 1].map(|at| self.batch.store(&state.lines[lines[at]].1.input.bytes()[..matched.lengths[at]]));
            self.emit_exchange(bus, &matched, &ExchangePlaces { wires, pdus: None }, &mut run);
            last_response_bytes = Some(matched.expected.response_bytes);
        }
        let Some(response_bytes) = last_response_bytes else { return };
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, Mode::Tcp, run.totals.exchanges, run.totals.bytes as u64);
        let response = state.lines[server].1.input.consumed_bytes(response_bytes);
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }
}
