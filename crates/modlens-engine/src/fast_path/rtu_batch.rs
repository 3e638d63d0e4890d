//! The fast path on an RTU line: request and response follow each other on the only line of a bus.

use crate::fast_path::emit::{adjacent_spans, may_hold_no_map, BatchTotals};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rows::MatchedExchange;
use crate::framer::PauseEvidence;
use crate::session::Session;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

impl Session {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index. The run ends at the first that does
    /// not match, in which a self-describing register map may begin, or that would change the profile of its unit or give a
    /// finding there. `emit_exchanges` makes sure that nothing is open.
    ///
    /// For each exchange, the framer's model learns the two frames and `emit_exchange` does the rest. Once at the end of the
    /// run, the arena gets all of its bytes, the statistics of the bus count it, and framer and pairing take over the last
    /// exchange. If there was none, nothing has changed.
    pub(super) fn emit_rtu_exchanges(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        // Where frames are checked against a rule of silence, the statistics of silences need each frame by itself.
        if state.lines[0].1.input.has_times && state.options.rule().is_some() {
            return;
        }
        let config = state.timing_config(0);
        let min_measurable_ns = 2 * state.coarsest_resolution();
        let mut totals = BatchTotals::default();
        let mut last_exchange: Option<(ExpectedExchange, f32)> = None;
        let mut last_answered = state.lines[0].1.framer.rtu_mut().and_then(|framer| framer.last_answered());
        let arena_start = self.batch.arena.len();
        loop {
            let state = &mut self.buses[bus];
            let line = &mut state.lines[0].1;
            let request_timeout = if config.has_clock { state.pairing.request_timeout(false) } else { Ns::MAX };
            let Some(framer) = line.framer.rtu_mut() else { break };
            let pause = |index| state.pairing.timing.timeout_log_odds(line.input.pause_before(index));
            let exchange = framer.next_exchange(&self.functions, &line.input, last_answered, request_timeout, pause);
            let Some(expected) = exchange.filter(may_hold_no_map) else { break };
            let lengths @ [request_bytes, response_bytes] =
                [expected.request_bytes + CRC_BYTES, expected.response_bytes + CRC_BYTES];
            let (request, response) = line.input.bytes()[..request_bytes + response_bytes].split_at(request_bytes);
            if !state.profiles.learn_quietly(&self.functions, request, expected.read_data(&response[..expected.response_bytes])) {
                break;
            }
            let evidence = || {
                let (timing, silence) = (&state.pairing.timing, line.input.pause_before(request_bytes));
                let (timeout, poll) = (timing.timeout_log_odds(silence), timing.poll_log_odds(silence));
                PauseEvidence { timeout, poll, ..PauseEvidence::default() }
            };
            let odds = framer.response_odds(&expected, line.input.has_times, evidence);
            // From here on, the exchange changes the state of the session.
            framer.record_exchange(request, response, expected.echoes_request);
            let matched =
                MatchedExchange { expected, mode: Mode::Rtu, mbap_id: None, lines: [0, 0], lengths, response_bits: odds as u8 };
            // The bytes of all exchanges of this run are copied into the arena at its end, in one piece.
            let wires = adjacent_spans(arena_start + totals.bytes, matched.lengths);
            self.emit_exchange(bus, &matched, wires, None, &config, min_measurable_ns, &mut totals);
            last_answered = Some((expected.unit, expected.code));
            last_exchange = Some((expected, odds));
        }
        let Some((last_exchange, odds)) = last_exchange else { return };
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        self.batch.arena.extend_from_slice(line.input.consumed_bytes(totals.bytes));
        self.stats.record_batch(state.counts, Mode::Rtu, totals.exchanges, totals.bytes as u64);
        if let Some(framer) = line.framer.rtu_mut() {
            framer.sync_after_batch(&line.input, &last_exchange, odds);
        }
        let response_bytes = last_exchange.response_bytes;
        let response = &line.input.consumed_bytes(response_bytes + CRC_BYTES)[..response_bytes];
        state.pairing.sync_after_batch(response[0], &response[1..]);
    }
}
