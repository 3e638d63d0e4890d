//! The end of the fast path that all framings share: the rows of a matched exchange, and what the session learns from it.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rows::{ExchangeRows, MatchedExchange};
use crate::records::Span;
use crate::session::bus::learn_side;
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::line::LineState;
use crate::session::Session;
use crate::stats::RequestKey;
use modlens_profiles::points::sunspec::may_begin_in;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::StandardLayout;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;

impl Session {
    /// Emits the rows of an exchange at the heads of its lines and consumes its bytes. Decides nothing: the caller has matched
    /// the exchange, and there is no finding on it.
    ///
    /// The session then has the state in which the slow path would leave it: what the recording's words for a sender mean,
    /// pairing, the unit as known and paired, the request's statistics, and the next numbers (one transaction, two frames).
    /// `totals` counts the exchange. What is learned once for a whole run (statistics of the bus, last response) is left to
    /// the caller, and so is the framer. Rows are made only of the tables that are wanted; a transaction row goes to `held`,
    /// as on the slow path.
    ///
    /// `wires`: the places of its bytes in the arena, where they are already or will be put. `pdus`: the places of the
    /// decoded PDUs, where the lines carry characters; else they are parts of the `wires`. Response times below
    /// `min_measurable_ns` are left out of row and statistics. Without a clock there are no times.
    #[inline(always)]
    #[allow(clippy::inline_always, clippy::too_many_arguments)] // The body of three loops: as a call, most of its time goes to passing the arguments.
    pub(super) fn emit_exchange(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        wires: [Span; 2],
        pdus: Option<[Span; 2]>,
        config: &TimingConfig,
        min_measurable_ns: Ns,
        totals: &mut BatchTotals,
    ) {
        let state = &mut self.buses[bus];
        let MatchedExchange { expected, mode, mbap_id, lines: [client, server], lengths, .. } = matched;
        let request_timing = consume(&mut state.lines[*client].1, lengths[0], config);
        let response_timing = consume(&mut state.lines[*server].1, lengths[1], config);
        learn_side(&mut state.side_votes, request_timing.side, Direction::Request);
        learn_side(&mut state.side_votes, response_timing.side, Direction::Response);
        let response_time =
            state.pairing.measurable_interval(request_timing.end, response_timing.start, response_timing.clean_start);
        state.pairing.record_exchange(expected.unit, *mbap_id, expected.echoes_request, request_timing.gap, response_time);
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
            request_timing,
            response_timing,
            response_time: response_time.filter(|&ns| ns >= min_measurable_ns),
            recording_start: self.origin,
        };
        let spans = [request_timing.span(), response_timing.span()];
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
            let points = state.profiles.of_unit(expected.unit);
            self.held.push(rows.transaction(points, pdus.unwrap_or_else(binary_pdus), no_findings));
        }
    }
}

/// What one run of the fast path has emitted: the exchanges, and their bytes on all lines.
#[derive(Default)]
pub(super) struct BatchTotals {
    pub exchanges: u64,
    pub bytes: usize,
}

/// Whether no self-describing register map (`points::sunspec`) can begin in the registers that are read. If one can, the
/// exchange has to take the slow path, which looks for the map.
pub(super) fn may_hold_no_map(expected: &ExpectedExchange) -> bool {
    expected.kind != StandardLayout::ReadRegisters || !may_begin_in(expected.address, usize::from(expected.quantity))
}

/// The place of the PDU in the bytes of a binary frame. `length` is that of unit and PDU.
fn pdu_span(mode: Mode, wire: Span, length: usize) -> Span {
    let before = if mode == Mode::Tcp { MBAP_PREFIX_BYTES + 1 } else { 1 };
    Span { start: wire.start + before as u32, length: length as u32 - 1 }
}

/// The places of a request that starts here in the arena, and of the response behind it.
pub(super) fn adjacent_spans(start: usize, [request_length, response_length]: [usize; 2]) -> [Span; 2] {
    let span = |start: usize, length: usize| Span { start: start as u32, length: length as u32 };
    [span(start, request_length), span(start + request_length, response_length)]
}

/// Consumes the first bytes of a line as a frame; returns when and where it was.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and `Session::emit_exchange` takes it apart at once.
fn consume(line: &mut LineState, length: usize, config: &TimingConfig) -> FrameTiming {
    let frame = FrameTiming::of(&line.input, length, &TimingConfig { last_end: line.last_end, ..*config });
    line.input.consume(length);
    line.last_end = frame.end.or(line.last_end);
    frame
}
