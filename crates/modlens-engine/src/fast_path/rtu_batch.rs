//! The fast path on an RTU line: request and response follow each other on the only line of a bus.

use crate::confidence;
use crate::fast_path::emit::{adjacent_spans, may_hold_no_map, ExchangePlaces};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::known_reads::KnownReads;
use crate::fast_path::rows::MatchedExchange;
use crate::fast_path::rtu_exchange::Answered;
use crate::fast_path::run::{BatchTotals, Run};
use crate::framer::PauseEvidence;
use crate::session::bus::BusState;
use crate::session::Session;
use crate::stats::RequestKey;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// The last exchange of a run.
#[derive(Clone, Copy)]
pub(super) struct LastExchange {
    pub expected: ExpectedExchange,
    /// Log2 of the odds of its response's direction.
    pub odds: f32,
}

impl LastExchange {
    /// What a request behind it may be the response to.
    pub fn answered(self) -> Answered {
        Answered::by_exchange(self.expected.unit, self.expected.code)
    }
}

impl Session {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index. The run ends at the first that
    /// `match_exchange` does not take. `emit_exchanges` makes sure that nothing is open.
    ///
    /// Once at the end of the run, the arena gets all of its bytes, the statistics of the bus count it, and framer and pairing
    /// take over the last exchange. If there was none, nothing has changed. Nothing is done where frames are checked against a
    /// rule of silence: the statistics of silences need each frame by itself.
    pub(super) fn emit_rtu_exchanges(&mut self, bus: usize) {
        if self.emits_compact(bus) {
            self.emit_compact_rtu_exchanges(bus);
            return;
        }
        let state = &mut self.buses[bus];
        if state.lines[0].1.input.has_times && state.options.rule().is_some() {
            return;
        }
        let mut run = Run::new(state, 0);
        // Where reads have times, an exchange is exactly two of them (`Input::holds_exchange`).
        let is_read_by_read = run.has_clock() && state.lines[0].1.input.has_times;
        let answered_before = state.lines[0].1.framer.rtu_mut().map_or(Answered::default(), |framer| framer.answered());
        let mut last: Option<LastExchange> = None;
        let arena_start = self.batch.arena.len();
        loop {
            let answered = last.map_or(answered_before, LastExchange::answered);
            let state = &mut self.buses[bus];
            let request_timeout = run.request_timeout(state);
            let Some((matched, odds)) = match_exchange(state, &self.functions, request_timeout, answered) else { break };
            // The bytes of all exchanges of this run are copied into the arena at its end, in one piece.
            let wires = adjacent_spans(arena_start + run.totals.bytes, matched.lengths);
            let places = ExchangePlaces { wires, pdus: None };
            if is_read_by_read {
                self.emit_exchange::<true>(bus, &matched, &places, &mut run);
            } else {
                self.emit_exchange::<false>(bus, &matched, &places, &mut run);
            }
            if matched.counters.is_none() {
                self.keep_rtu_read(bus, &matched);
            }
            last = Some(LastExchange { expected: matched.expected, odds });
        }
        if let Some(last) = last {
            self.end_rtu_run(bus, &run.totals, last);
        }
    }

    /// Keeps what follows from the request of this exchange, which has just been consumed, if it is a plain read.
    fn keep_rtu_read(&mut self, bus: usize, matched: &MatchedExchange) {
        let state = &mut self.buses[bus];
        let [request_bytes, response_bytes] = matched.lengths;
        let request = &state.lines[0].1.input.consumed_bytes(request_bytes + response_bytes)[..request_bytes];
        let expected = matched.expected;
        if KnownReads::takes(request, &expected) {
            let key = RequestKey::plain(expected.unit, expected.code, expected.address, expected.quantity);
            state.known_reads.add(request, expected, self.stats.place_of(state.counts, key));
        }
    }

    /// Does what is done once for a whole run, the exchanges of which have just been consumed.
    pub(super) fn end_rtu_run(&mut self, bus: usize, totals: &BatchTotals, last: LastExchange) {
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        self.batch.arena.extend_from_slice(line.input.consumed_bytes(totals.bytes));
        self.stats.record_batch(state.counts, Mode::Rtu, totals.exchanges, totals.bytes as u64);
        if let Some(framer) = line.framer.rtu_mut() {
            framer.sync_after_batch(&line.input, &last.expected, last.odds);
        }
        let response_bytes = last.expected.response_bytes;
        let response = &line.input.consumed_bytes(response_bytes + CRC_BYTES)[..response_bytes];
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }
}

/// The exchange at the head of the only line of a bus, if there is no doubt and no finding about it, with log2 of the odds of its
/// response's direction. The framer's model and the profile of its unit have learned from it then; its bytes are not consumed.
///
/// `None` where the framer does not take it (`RtuFramer::takes`, with the same `request_timeout` in ns and `answered`), where a
/// self-describing register map may begin in it, and where it would change the profile of its unit or give a finding there.
/// Nothing is learned then.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn match_exchange(
    state: &mut BusState,
    functions: &Functions,
    request_timeout: Ns,
    answered: Answered,
) -> Option<(MatchedExchange, f32)> {
    let line = &mut state.lines[0].1;
    let framer = line.framer.rtu_mut()?;
    let timing = &state.pairing.timing;
    let bytes = line.input.bytes();
    let known = state.known_reads.get(bytes);
    let expected = match known {
        Some(known) => known.expected,
        None => ExpectedExchange::from_request(functions, Mode::Rtu, bytes).filter(may_hold_no_map)?,
    };
    let counters = known.and_then(|known| known.counters);
    let lengths = expected.rtu_lengths();
    let timeout_log_odds = |index| timing.timeout_log_odds(line.input.pause_before(index));
    if !framer.takes(&expected, &line.input, answered, known.is_none(), request_timeout, timeout_log_odds) {
        return None;
    }
    let (request, response) = bytes[..lengths[0] + lengths[1]].split_at(lengths[0]);
    if !state.profiles.learn_on_fast_path(functions, request, expected.read_data(&response[..expected.response_bytes])) {
        return None;
    }
    let pause_evidence = || {
        let silence = line.input.pause_before(lengths[0]);
        let (timeout, poll) = (timing.timeout_log_odds(silence), timing.poll_log_odds(silence));
        PauseEvidence { timeout, poll, ..PauseEvidence::default() }
    };
    let odds = framer.response_odds(&expected, line.input.has_times, pause_evidence);
    framer.record_exchange(request, response, expected.echoes_request);
    let response_bits = confidence::of_direction(odds);
    Some((MatchedExchange { expected, mode: Mode::Rtu, mbap_id: None, lines: [0, 0], lengths, response_bits, counters }, odds))
}
