//! Exchanges at the head of the only line of a bus, one after the other, as rows: RTU and ASCII.

use crate::input::Input;
use crate::session::bus::{declared_direction, BusState};
use crate::session::decoder::Decoder;
use crate::session::exchanges::emit::{adjacent_spans, ExchangePlaces};
use crate::session::exchanges::matching::{match_ascii, match_rtu, MatchedExchange, RtuContext, RtuRun};
use crate::session::exchanges::run::{BatchTotals, ExchangeEnd, Run};
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::line::LineState;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap;
use modlens_protocol::Ns;

impl Decoder {
    /// Emits the exchanges at the head of the only line of the bus with this index, until one does not match. `emit_exchanges`
    /// makes sure that nothing is open.
    ///
    /// Once at the end of the run, the statistics of the bus count it, and framer and pairing take over the last exchange. If
    /// there was none, nothing has changed. Nothing is done on a timed RTU line whose settings or silences are known
    /// (`silence_rule`): each silence is counted, frame by frame.
    pub(super) fn emit_heads(&mut self, bus: usize, mode: Mode) {
        let state = &mut self.buses[bus];
        let has_times = state.lines[0].1.input.has_times;
        if mode == Mode::Rtu && has_times && state.options.silence_rule().is_some() {
            return;
        }
        let mut adus = std::mem::take(&mut self.adus);
        let mut run = Run::new(state, 0);
        if mode == Mode::Rtu && run.has_clock() && has_times {
            run.form = self.form_of_messages(bus);
        }
        let mut rtu = RtuRun::after(self.buses[bus].lines[0].1.framer.rtu_mut());
        loop {
            let state = &mut self.buses[bus];
            let timeout = run.request_timeout(state);
            let matched = match mode {
                Mode::Rtu => next_rtu(state, &self.functions, &mut rtu, timeout),
                _ => next_ascii(state, &self.functions, timeout, &mut adus),
            };
            let Some(matched) = matched else { break };
            let line = &mut state.lines[0].1;
            let wire = self.batch.store(&line.input.bytes()[..matched.lengths[0] + matched.lengths[1]]);
            let wires = adjacent_spans(wire.start as usize, matched.lengths);
            let timings = matched.lengths.map(|length| consume(line, length, &run.config));
            let pdus = (mode == Mode::Ascii).then(|| adus.each_ref().map(|adu| self.batch.store(&adu[1..])));
            self.emit_exchange(bus, &matched, &ExchangePlaces { wires, pdus }, timings, &mut run);
            if mode == Mode::Ascii {
                self.buses[bus].pairing.sync_after_batch((self.next_txn - 1, None), adus[1][0], &adus[1][1..]);
            }
        }
        self.adus = adus;
        if run.totals.exchanges > 0 {
            self.end_run(bus, mode, &run.totals, (&mut rtu, ExchangeEnd::newest(&self.batch, self.next_txn)));
        }
    }

    /// Does what is done once for a whole run, the exchanges of which are consumed; the last one ends there. Of ASCII
    /// `run.last_exchange` is `None`, and nothing is learned here.
    pub(super) fn end_run(&mut self, bus: usize, mode: Mode, totals: &BatchTotals, (run, end): (&mut RtuRun, ExchangeEnd)) {
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, mode, totals.exchanges, totals.bytes as u64);
        state.begins_inside = false;
        let Some(last) = run.last_exchange else { return };
        let line = &mut state.lines[0].1;
        let lengths = last.expected.rtu_lengths();
        let response_length = if mode == Mode::Rtu { lengths[1] } else { last.expected.response_bytes };
        let (before, response) = self.batch.arena[..end.arena].split_at(end.arena - response_length);
        if let Some(framer) = line.framer.rtu_mut().filter(|_| mode == Mode::Rtu) {
            framer.learn_run(&mut run.learning);
            let request = &before[before.len() - lengths[0]..];
            framer.sync_after_batch(request, response, line.input.offset(), last.odds);
        }
        let id = before.last_chunk().filter(|_| mode == Mode::Tcp).map(mbap::transaction_id);
        state.pairing.sync_after_batch((end.txn, id), response[0], &response[1..last.expected.response_bytes]);
    }
}

/// Returns the RTU exchange at the head of the only line of a bus, if it is in reads in which nothing else decides.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_rtu(state: &mut BusState, functions: &Functions, run: &mut RtuRun, timeout: Ns) -> Option<MatchedExchange> {
    let LineState { input, framer, .. } = &mut state.lines[0].1;
    let (memo, profiles, timing) = (&state.memo, &mut state.profiles, &state.pairing.timing);
    let (framer, has_times) = (framer.rtu_mut()?, input.has_times);
    let known = RtuContext { functions, framer, run, memo, profiles, timing, has_times, are_proven: false };
    let after = |[request, response]: [usize; 2]| {
        input.holds_exchange(Mode::Rtu, request, response, timeout).then(|| &input.bytes()[request..])
    };
    match_rtu(known, input.bytes(), after, |index| input.pause_before(index))
}

/// Returns the ASCII exchange there, under the same conditions; a response that equals its request must not be declared otherwise
/// by the recording, nor must the silence before it fit a timeout better. Last, the profile of its unit learns from it.
fn next_ascii(state: &mut BusState, functions: &Functions, timeout: Ns, adus: &mut [Vec<u8>; 2]) -> Option<MatchedExchange> {
    let input = &state.lines[0].1.input;
    let matched = match_ascii(functions, input.bytes(), adus)?;
    let [request, response] = matched.lengths;
    let is_certain = input.holds_exchange(Mode::Ascii, request, response, timeout)
        && !(matched.expected.echoes_request && may_be_retry(state, input, request))
        && state.profiles.learn_on_fast_path(functions, &adus[0], matched.expected.read_data(&adus[1]));
    is_certain.then_some(matched)
}

/// Returns whether a response that equals its request, which has this many characters, may be a retry of it: the recording declares
/// one of the two otherwise, or the silence between them fits a timeout better than a response time.
fn may_be_retry(state: &BusState, input: &Input, request_length: usize) -> bool {
    let declared = |index| input.read(index).and_then(|read| read.side).map(|side| declared_direction(state.side_votes, side));
    declared(0) == Some(Direction::Response)
        || declared(request_length) == Some(Direction::Request)
        || state.pairing.timing.timeout_log_odds(input.pause_before(request_length)) > 0.0
}

/// Consumes the first `length` bytes of a line as a frame; returns when and where it was. The end of the frame before, which the
/// gap counts from, is that of the line, not that of `config`.
#[inline]
fn consume(line: &mut LineState, length: usize, config: &TimingConfig) -> FrameTiming {
    let config = TimingConfig { last_end: line.last_end, ..*config };
    let frame = FrameTiming::of(&line.input, length, &config);
    line.input.consume(length);
    line.last_end = frame.end.or(line.last_end);
    frame
}
