//! The fast path of the session: whole exchanges, from the bytes to the rows.
//!
//! Most traffic is plain reads and writes that are answered at once. If nothing is open, a request of a familiar unit and
//! function keeps the limits of the specification, and just the response follows that it determines, then there is nothing
//! to search for, to pair or to find. The rows are those of the slow path, which every input takes that parts a request
//! from its response (`tests/properties.rs` compares the two).

mod ascii;
mod rows;

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::records::Span;
use crate::session::bus::learn_side;
use crate::session::bus::FROM_SERVER;
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::line::LineState;
use crate::session::Session;
use crate::stats::RequestKey;
use modlens_profiles::points::sunspec::may_begin_in;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::StandardLayout;
use modlens_protocol::mbap::HEADER as MBAP;
use modlens_protocol::Ns;

use rows::ExchangeRows;

/// A request and its response at the heads of their lines.
struct MatchedExchange {
    /// The exchange as the request announces it; the response is the one expected.
    expected: ExpectedExchange,
    mode: Mode,
    mbap_id: Option<u16>,
    /// Indices of the lines of request and response.
    lines: [usize; 2],
    /// Lengths of request and response on their lines, in bytes or, for ASCII, characters.
    lengths: [usize; 2],
}

impl Session {
    /// Emits exchanges at the heads of the lines of a bus, as long as there is no doubt about each.
    pub(super) fn routine(&mut self, bus: usize) {
        let state = &self.buses[bus];
        if state.clock_jumped || !state.pairing.is_idle() || !state.lines.iter().all(|(_, line)| line.is_settled()) {
            return;
        }
        match &state.lines[..] {
            [(_, line)] if line.framer.mode() == Mode::Rtu => self.routine_rtu(bus),
            [(_, line)] if line.framer.mode() == Mode::Ascii => self.routine_ascii(bus),
            [(first, line), _] if state.options.bus.network.is_some() && line.framer.mode() == Mode::Tcp => {
                let server_first = *first == FROM_SERVER;
                self.routine_tcp(bus, [usize::from(server_first), usize::from(!server_first)]);
            }
            _ => {}
        }
    }

    /// Emits the RTU exchanges at the head of the only line of a bus.
    fn routine_rtu(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        // Where frames are checked against a rule of silence, the statistics of silences need each frame by itself.
        if state.lines[0].1.input.timed && state.options.rule().is_some() {
            return;
        }
        let timing = state.timing_config(0);
        let min_measurable_ns = 2 * state.coarsest_resolution();
        let mut totals = BatchTotals::default();
        let mut last: Option<ExpectedExchange> = None;
        let mut last_answered = state.lines[0].1.framer.routine().and_then(|framer| framer.last_answered());
        let arena_start = self.batch.arena.len();
        loop {
            let state = &mut self.buses[bus];
            let line = &mut state.lines[0].1;
            let patience = if timing.has_clock { state.pairing.request_timeout() } else { Ns::MAX };
            let Some(framer) = line.framer.routine() else { break };
            let pause = |index| state.pairing.timing.timeout_log_odds(line.input.pause_before(index));
            let exchange = framer.next_exchange(&self.functions, &line.input, last_answered, patience, pause);
            let Some(expected) = exchange.filter(may_hold_no_map) else { break };
            let lengths @ [request_bytes, response_bytes] =
                [expected.request_bytes + CRC_BYTES, expected.response_bytes + CRC_BYTES];
            let (request, response) = line.input.bytes()[..request_bytes + response_bytes].split_at(request_bytes);
            if !state.profiles.take(&self.functions, request, expected.read_data(&response[..expected.response_bytes])) {
                break;
            }
            // From here on, the exchange changes the state of the session.
            framer.record_exchange(request, response, expected.echoes_request);
            let matched = MatchedExchange { expected, mode: Mode::Rtu, mbap_id: None, lines: [0, 0], lengths };
            // The bytes of all exchanges of this run are copied into the arena at its end, in one piece.
            let wires = adjacent_spans(arena_start + totals.bytes, matched.lengths);
            self.exchange(bus, &matched, wires, None, &timing, min_measurable_ns, &mut totals);
            last_answered = Some((expected.unit, expected.code));
            last = Some(expected);
        }
        let Some(last) = last else { return };
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        self.batch.arena.extend_from_slice(line.input.forgotten(totals.bytes));
        self.stats.record_batch(state.counts, Mode::Rtu, totals.exchanges, totals.bytes as u64);
        if let Some(framer) = line.framer.routine() {
            framer.sync_after_batch(&line.input, &last);
        }
        let response = &line.input.forgotten(last.response_bytes + CRC_BYTES)[..last.response_bytes];
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }

    /// Emits the exchanges at the head of a TCP connection, where each side has its own line and each message its own
    /// packet. `lines`: indices of the client's line and of the server's.
    fn routine_tcp(&mut self, bus: usize, lines: [usize; 2]) {
        let [client, server] = lines;
        let state = &mut self.buses[bus];
        let timing = state.timing_config(client);
        let min_measurable_ns = 2 * state.coarsest_resolution();
        let mut totals = BatchTotals::default();
        let mut last_response_bytes = None;
        loop {
            let state = &mut self.buses[bus];
            let (client_input, server_input) = (&state.lines[client].1.input, &state.lines[server].1.input);
            let Some((header, request)) = client_input.bytes().split_first_chunk::<MBAP>() else { break };
            let Some(expected) = ExpectedExchange::from_request(&self.functions, Mode::Tcp, request).filter(may_hold_no_map)
            else {
                break;
            };
            let lengths = [MBAP + expected.request_bytes, MBAP + expected.response_bytes];
            let packets = client_input.packet(lengths[0]).zip(server_input.packet(lengths[1]));
            let Some(((requested_at, next_request_at), (answered_at, _))) = packets else { break };
            // The response comes behind the request, in time, and before the next request.
            let is_in_turn = requested_at < answered_at
                && answered_at - requested_at < state.pairing.request_timeout()
                && next_request_at.is_none_or(|time| time > answered_at);
            // A packet always has all of its bytes.
            let (request, response) = (&request[..expected.request_bytes], &server_input.bytes()[..lengths[1]]);
            let id = [header[0], header[1]];
            let has_header = |mbap: &[u8], length: usize| *mbap == [id[0], id[1], 0, 0, 0, length as u8];
            let are_framed = has_header(header, expected.request_bytes) && has_header(&response[..MBAP], expected.response_bytes);
            let response = &response[MBAP..];
            if !(is_in_turn && are_framed && expected.is_answered_by(request, response)) {
                break;
            }
            if !state.profiles.take(&self.functions, request, expected.read_data(response)) {
                break;
            }
            let mbap_id = Some(u16::from_be_bytes(id));
            let matched = MatchedExchange { expected, mode: Mode::Tcp, mbap_id, lines, lengths };
            let wires = [0, 1].map(|at| self.batch.keep(&state.lines[lines[at]].1.input.bytes()[..lengths[at]]));
            self.exchange(bus, &matched, wires, None, &timing, min_measurable_ns, &mut totals);
            last_response_bytes = Some(expected.response_bytes);
        }
        let Some(response_bytes) = last_response_bytes else { return };
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, Mode::Tcp, totals.exchanges, totals.bytes as u64);
        let response = state.lines[server].1.input.forgotten(response_bytes);
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }

    /// Emits the rows of an exchange at the heads of its lines and consumes its bytes; pairing and statistics learn from it.
    ///
    /// `wires`: the places of its bytes in the arena, where they are already or will be put. `pdus`: the places of the
    /// decoded PDUs, where the lines carry characters. Response times below `min_measurable_ns` are left out.
    #[inline(always)]
    #[allow(clippy::inline_always, clippy::too_many_arguments)] // The body of three loops: as a call, most of its time goes to passing the arguments.
    fn exchange(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        wires: [Span; 2],
        pdus: Option<[Span; 2]>,
        timing: &TimingConfig,
        min_measurable_ns: Ns,
        totals: &mut BatchTotals,
    ) {
        let state = &mut self.buses[bus];
        let MatchedExchange { expected, mode, mbap_id, lines: [client, server], lengths } = matched;
        let request_moment = consume(&mut state.lines[*client].1, lengths[0], timing);
        let response_moment = consume(&mut state.lines[*server].1, lengths[1], timing);
        learn_side(&mut state.side_votes, request_moment.side, Direction::Request);
        learn_side(&mut state.side_votes, response_moment.side, Direction::Response);
        let response_time =
            state.pairing.measurable_interval(request_moment.end, response_moment.start, response_moment.clean_start);
        state.pairing.record_exchange(expected.unit, *mbap_id, expected.echoes_request, response_time);
        let unit = usize::from(expected.unit);
        (state.known_units[unit], state.paired_units[unit]) = (true, true);
        let rows = ExchangeRows {
            txn: self.next_txn,
            request_frame: self.next_frame,
            bus: bus as u32,
            lines: [state.lines[*client].0, state.lines[*server].0],
            matched,
            request_wire: wires[0],
            response_wire: wires[1],
            request_moment,
            response_moment,
            response_time: response_time.filter(|&ns| ns >= min_measurable_ns),
            recording_start: self.origin,
        };
        let spans = [request_moment.span(), response_moment.span()];
        let key = RequestKey::plain(expected.unit, expected.code, expected.address, expected.quantity);
        self.stats.record_exchange(state.counts, key, spans, rows.response_time);
        totals.exchanges += 1;
        totals.bytes += lengths[0] + lengths[1];
        self.next_txn += 1;
        self.next_frame += 2;
        let no_findings = Span { start: self.batch.codes.len() as u32, length: 0 };
        if self.wanted.frames {
            self.batch.frames.push(rows.frame(Direction::Request, no_findings));
            self.batch.frames.push(rows.frame(Direction::Response, no_findings));
        }
        if self.wanted.transactions {
            let binary_pdus =
                || [pdu_span(*mode, wires[0], expected.request_bytes), pdu_span(*mode, wires[1], expected.response_bytes)];
            let points = state.profiles.of(expected.unit);
            self.held.push(rows.transaction(points, pdus.unwrap_or_else(binary_pdus), no_findings));
        }
    }
}

/// What one run of the fast path has emitted: the exchanges, and their bytes on all lines.
#[derive(Default)]
struct BatchTotals {
    exchanges: u64,
    bytes: usize,
}

/// Whether no self-describing register map (`points::sunspec`) can begin in the registers that are read. If one can, the
/// exchange has to take the slow path, which looks for the map.
fn may_hold_no_map(expected: &ExpectedExchange) -> bool {
    expected.kind != StandardLayout::ReadRegisters || !may_begin_in(expected.address, usize::from(expected.quantity))
}

/// The place of the PDU in the bytes of a binary frame. `length` is that of unit and PDU.
fn pdu_span(mode: Mode, wire: Span, length: usize) -> Span {
    let before = if mode == Mode::Tcp { MBAP + 1 } else { 1 };
    Span { start: wire.start + before as u32, length: length as u32 - 1 }
}

/// The places of a request that starts here in the arena, and of the response behind it.
fn adjacent_spans(start: usize, [request_length, response_length]: [usize; 2]) -> [Span; 2] {
    let span = |start: usize, length: usize| Span { start: start as u32, length: length as u32 };
    [span(start, request_length), span(start + request_length, response_length)]
}

/// Consumes the first bytes of a line as a frame; returns when and where it was.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and `Session::exchange` takes it apart at once.
fn consume(line: &mut LineState, length: usize, timing: &TimingConfig) -> FrameTiming {
    let moment = FrameTiming::of(&line.input, length, &TimingConfig { last_end: line.last_end, ..*timing });
    line.input.consume(length);
    line.last_end = moment.end.or(line.last_end);
    moment
}
