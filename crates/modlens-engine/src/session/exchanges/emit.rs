//! The end of the fast path that all framings share: the rows of a matched exchange, and what the session learns from it.

use crate::records::{PacketPair, Span};
use crate::session::bus::{learn_side, BusState};
use crate::session::exchanges::rows::{ExchangeRows, MatchedExchange};
use crate::session::exchanges::run::Run;
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::held_exchanges::ExchangeStart;
use crate::session::line::LineState;
use crate::session::Session;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;

/// Where the bytes of an exchange are in the arena, or will be put: first the request's, then the response's.
pub(super) struct ExchangePlaces {
    /// Its bytes as they were on the lines.
    pub wires: [Span; 2],
    /// The decoded PDUs, where the lines carry characters; else they are parts of the `wires`.
    pub pdus: Option<[Span; 2]>,
}

impl Session {
    /// Emits the rows of an exchange at the heads of its lines and consumes its bytes (`emit_timed`). `IN_PACKETS`: each of its
    /// frames is exactly a read with a time, on a bus with a clock.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The body of three loops: as a call, most of its time goes to passing the arguments.
    pub(super) fn emit_exchange<const IN_PACKETS: bool>(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        places: &ExchangePlaces,
        run: &mut Run,
    ) {
        let state = &mut self.buses[bus];
        let [client, server] = matched.lines;
        let request = consume::<IN_PACKETS>(&mut state.lines[client].1, matched.lengths[0], &run.config);
        let response = consume::<IN_PACKETS>(&mut state.lines[server].1, matched.lengths[1], &run.config);
        self.emit_timed(bus, matched, places, [request, response], run);
    }

    /// Emits the rows of an exchange, of which the bytes are consumed; `timings` say when and where its frames were. Decides
    /// nothing: the caller has matched the exchange, and there is no finding on it.
    ///
    /// The session then has the state in which the slow path would leave it: what the bus has learned (`learn_exchange`), the
    /// request's statistics, and the next numbers (one transaction, two frames). The run counts the exchange. Left to the
    /// caller are the statistics of the bus, which come once a run, the last response, which comes once a run or, in ASCII,
    /// with each exchange, and the framer.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub(super) fn emit_timed(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        places: &ExchangePlaces,
        [request, response]: [FrameTiming; 2],
        run: &mut Run,
    ) {
        let state = &mut self.buses[bus];
        let response_time = learn_exchange(state, matched, &request, &response).filter(|&ns| ns >= run.min_measurable_ns);
        let expected = &matched.expected;
        let key = expected.key();
        self.stats.record_exchange(state.counts, (key, matched.counters), [request.span(), response.span()], response_time);
        if run.is_compact {
            self.push_compact(bus, matched, places.wires[0].start, [&request, &response], response_time);
        } else {
            let lines = matched.lines.map(|line| self.buses[bus].lines[line].0);
            let rows = ExchangeRows {
                txn: self.next_txn,
                request_frame: self.next_frame,
                bus: bus as u32,
                lines,
                matched,
                request_wire: places.wires[0],
                response_wire: places.wires[1],
                request_timing: request,
                response_timing: response,
                response_time,
                recording_start: self.origin,
            };
            self.push_rows(&rows, places);
        }
        run.totals.exchanges += 1;
        run.totals.bytes += matched.lengths[0] + matched.lengths[1];
        self.next_txn += 1;
        self.next_frame += 2;
    }

    /// Appends an exchange in a packet or a line each to `held`, as a compact one, if transactions are wanted. `start`: where
    /// its bytes begin in the arena.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn push_compact(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        start: u32,
        [request, response]: [&FrameTiming; 2],
        response_time: Option<Ns>,
    ) {
        let Some(starts) = request.start.zip(response.start) else { return };
        if !self.wanted.transactions {
            return;
        }
        let mbap_id = matched.mbap_id.unwrap_or(0);
        let pair = PacketPair { starts: starts.into(), gap: request.gap, response_time, packet: request.origin, mbap_id };
        let (number, frame, recording_start, mode) = (self.next_txn, self.next_frame, self.origin, matched.mode);
        let of_run = ExchangeStart { bus: bus as u32, number, frame, recording_start, mode };
        let exchange = matched.expected.compact(start, matched.lengths, matched.transaction_confidence(), 0);
        self.held.exchanges.push(exchange, pair, &of_run);
    }

    /// Appends the rows of an exchange to the tables that are wanted: its two frames to the batch, and its transaction to
    /// `held`, as on the slow path.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn push_rows(&mut self, rows: &ExchangeRows<'_>, places: &ExchangePlaces) {
        let no_findings = Span { start: self.batch.codes.len() as u32, length: 0 };
        if self.wanted.frames {
            self.batch.frames.push(rows.frame(Direction::Request, no_findings));
            self.batch.frames.push(rows.frame(Direction::Response, no_findings));
        }
        if self.wanted.transactions {
            let expected = &rows.matched.expected;
            let pdus = places.pdus.unwrap_or_else(|| {
                let mode = rows.matched.mode;
                [
                    pdu_span(mode, places.wires[0], expected.request_bytes),
                    pdu_span(mode, places.wires[1], expected.response_bytes),
                ]
            });
            let points = self.buses[rows.bus as usize].profiles.of_unit(expected.unit);
            self.held.push(rows.transaction(points, pdus, no_findings));
        }
    }
}

/// Learns from an exchange what the recording's words for a sender mean, what pairing learns, and that its unit is known and was
/// paired. Returns the time from the end of the request to the start of the response; `None` without a clock.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
fn learn_exchange(state: &mut BusState, matched: &MatchedExchange, request: &FrameTiming, response: &FrameTiming) -> Option<Ns> {
    let MatchedExchange { expected, mbap_id, .. } = matched;
    learn_side(&mut state.side_votes, request.side, Direction::Request);
    learn_side(&mut state.side_votes, response.side, Direction::Response);
    let response_time = state.pairing.measurable_interval(request.end, response.start, response.clean_start);
    state.pairing.record_exchange(*mbap_id, expected.echoes_request, request.gap, response_time);
    state.note_paired(expected.unit);
    response_time
}

/// Returns the place of the PDU in the bytes of a binary frame, after its unit and, on TCP, its MBAP header. `length` is that of
/// unit and PDU, in bytes.
fn pdu_span(mode: Mode, wire: Span, length: usize) -> Span {
    let before = if mode == Mode::Tcp { MBAP_PREFIX_BYTES + 1 } else { 1 };
    Span { start: wire.start + before as u32, length: length as u32 - 1 }
}

/// Returns the places of a request that starts at this index of the arena, and of the response right after it. Lengths in bytes.
pub(super) fn adjacent_spans(start: usize, [request_length, response_length]: [usize; 2]) -> [Span; 2] {
    let span = |start: usize, length: usize| Span { start: start as u32, length: length as u32 };
    [span(start, request_length), span(start + request_length, response_length)]
}

/// Consumes the first `length` bytes of a line as a frame; returns when and where it was. The end of the frame before, which the
/// gap counts from, is that of the line, not that of `config`.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and `Session::emit_exchange` takes it apart at once.
fn consume<const IN_PACKETS: bool>(line: &mut LineState, length: usize, config: &TimingConfig) -> FrameTiming {
    let config = TimingConfig { last_end: line.last_end, ..*config };
    let frame = match line.input.first_read() {
        Some(read) if IN_PACKETS => FrameTiming::of_timed_read(&line.input, read, length, &config),
        _ => FrameTiming::of(&line.input, length, &config),
    };
    line.input.consume(length);
    line.last_end = frame.end.or(line.last_end);
    frame
}
