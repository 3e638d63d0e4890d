//! The fast path on a TCP connection: each side has its own line, and each message has its own packet.

use crate::fast_path::emit::{may_hold_no_map, BatchTotals};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rows::MatchedExchange;
use crate::session::bus::BusState;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;

/// The exchange at the heads of the two lines of a connection, with the times of its two packets, if there is no doubt and no
/// finding about it. `lines`: indices of the client's line and of the server's.
///
/// `None` unless the request is a plain read or write in which no self-describing register map can begin, request and
/// response are a packet each that has a time, the response comes behind the request, within the request time-out and before
/// the client's next packet, both headers have the same transaction identifier and the right length, and the response is the
/// expected one. Last, the profile of the unit learns the data read; if that would change the profile or give a finding,
/// it learns nothing, and the result is `None`: the slow path does it. Nothing else is changed, and nothing is consumed.
#[inline]
fn match_exchange(state: &mut BusState, functions: &Functions, lines: [usize; 2]) -> Option<(MatchedExchange, [Ns; 2])> {
    let [client, server] = lines.map(|line| &state.lines[line].1.input);
    let (header, request) = client.bytes().split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let expected = ExpectedExchange::from_request(functions, Mode::Tcp, request).filter(may_hold_no_map)?;
    let lengths = [MBAP_PREFIX_BYTES + expected.request_bytes, MBAP_PREFIX_BYTES + expected.response_bytes];
    let (requested_at, next_request_at) = client.whole_packet(lengths[0])?;
    let (answered_at, _) = server.whole_packet(lengths[1])?;
    // The response comes behind the request, in time, and before the next request.
    let is_in_turn = requested_at < answered_at
        && answered_at - requested_at < state.pairing.request_timeout(true)
        && next_request_at.is_none_or(|time| time > answered_at);
    // A packet always has all of its bytes.
    let (request, response) = (&request[..expected.request_bytes], &server.bytes()[..lengths[1]]);
    let id = [header[0], header[1]];
    let has_header = |mbap: &[u8], length: usize| *mbap == [id[0], id[1], 0, 0, 0, length as u8];
    let are_framed =
        has_header(header, expected.request_bytes) && has_header(&response[..MBAP_PREFIX_BYTES], expected.response_bytes);
    let response = &response[MBAP_PREFIX_BYTES..];
    if !(is_in_turn && are_framed && expected.is_answered_by(request, response)) {
        return None;
    }
    let is_settled = state.profiles.learn_quietly(functions, request, expected.read_data(response));
    let mbap_id = Some(u16::from_be_bytes(id));
    let response_bits = u8::MAX;
    let matched = MatchedExchange { expected, mode: Mode::Tcp, mbap_id, lines, lengths, response_bits };
    is_settled.then_some((matched, [requested_at, answered_at]))
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
        let state = &mut self.buses[bus];
        let config = state.timing_config(client);
        let min_measurable_ns = 2 * state.coarsest_resolution();
        let mut totals = BatchTotals::default();
        let mut last_response_bytes = None;
        loop {
            let state = &mut self.buses[bus];
            let Some((matched, times)) = match_exchange(state, &self.functions, lines) else { break };
            state.connection.note_exchange(self.next_txn, matched.mbap_id, times, &state.pairing);
            let wires = [0, 1].map(|at| self.batch.store(&state.lines[lines[at]].1.input.bytes()[..matched.lengths[at]]));
            self.emit_exchange(bus, &matched, wires, None, &config, min_measurable_ns, &mut totals);
            last_response_bytes = Some(matched.expected.response_bytes);
        }
        let Some(response_bytes) = last_response_bytes else { return };
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, Mode::Tcp, totals.exchanges, totals.bytes as u64);
        let response = state.lines[server].1.input.consumed_bytes(response_bytes);
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }
}
