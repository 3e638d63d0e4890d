//! The fast path on an RTU line: request and response follow each other on the only line of a bus.

use crate::confidence;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::request_memo::RequestMemo;
use crate::fast_path::rtu_exchange::{is_response, Answered, LastExchange};
use crate::framer::rtu::traffic_model::LearningRun;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::pairing::TimingModel;
use crate::session::bus::BusState;
use crate::session::exchanges::emit::{adjacent_spans, ExchangePlaces};
use crate::session::exchanges::rows::MatchedExchange;
use crate::session::exchanges::run::{BatchTotals, Run};
use crate::session::line::LineState;
use crate::session::profiles::Profiles;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

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
        run.is_compact = is_read_by_read && self.emits_compact_lines(bus);
        let state = &mut self.buses[bus];
        let answered_before = state.lines[0].1.framer.rtu_mut().map_or(Answered::default(), |framer| framer.answered());
        let mut last: Option<LastExchange> = None;
        let mut learning = LearningRun::default();
        let arena_start = self.batch.arena.len();
        loop {
            let answered = last.map_or(answered_before, LastExchange::answered);
            let state = &mut self.buses[bus];
            let request_timeout = run.request_timeout(state);
            let Some((matched, odds)) = next_exchange(state, &self.functions, &mut learning, request_timeout, answered) else {
                break;
            };
            // The bytes of all exchanges of this run are copied into the arena at its end, in one piece.
            let wires = adjacent_spans(arena_start + run.totals.bytes, matched.lengths);
            let places = ExchangePlaces { wires, pdus: None };
            if is_read_by_read {
                self.emit_exchange::<true>(bus, &matched, &places, &mut run);
            } else {
                self.emit_exchange::<false>(bus, &matched, &places, &mut run);
            }
            if matched.counters.is_none() {
                let state = &mut self.buses[bus];
                let wire = state.lines[0].1.input.consumed_bytes(matched.lengths.iter().sum());
                let request = &wire[..matched.lengths[0]];
                state.memo.keep(&mut self.stats, state.counts, request, &matched.expected);
            }
            last = Some(LastExchange { expected: matched.expected, odds });
        }
        if let Some(last) = last {
            self.batch.arena.extend_from_slice(self.buses[bus].lines[0].1.input.consumed_bytes(run.totals.bytes));
            if let Some(framer) = self.buses[bus].lines[0].1.framer.rtu_mut() {
                framer.learn_run(&mut learning);
            }
            self.end_rtu_run(bus, &run.totals, last);
        }
    }

    /// Does what is done once for a whole run, the exchanges of which have just been consumed; the arena ends with the last one.
    pub(super) fn end_rtu_run(&mut self, bus: usize, totals: &BatchTotals, last: LastExchange) {
        let state = &mut self.buses[bus];
        self.stats.record_batch(state.counts, Mode::Rtu, totals.exchanges, totals.bytes as u64);
        let [request_bytes, response_bytes] = last.expected.rtu_lengths();
        let start = self.batch.arena.len() - request_bytes - response_bytes;
        let (request, response) = self.batch.arena[start..].split_at(request_bytes);
        let line = &mut state.lines[0].1;
        if let Some(framer) = line.framer.rtu_mut() {
            framer.sync_after_batch(request, response, line.input.offset(), last.odds);
        }
        state.pairing.sync_after_batch(response[0], &response[1..last.expected.response_bytes]);
    }
}

/// Returns the exchange at the head of the only line of a bus, if it is in reads in which nothing else decides
/// (`Input::holds_exchange`), and `match_exchange` takes it.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_exchange(
    state: &mut BusState,
    functions: &Functions,
    learning: &mut LearningRun,
    request_timeout: Ns,
    answered: Answered,
) -> Option<(MatchedExchange, f32)> {
    let LineState { input, framer, .. } = &mut state.lines[0].1;
    let known = LineContext {
        framer: framer.rtu_mut()?,
        learning,
        reads: &state.memo,
        profiles: &mut state.profiles,
        timing: &state.pairing.timing,
        answered,
        has_times: input.has_times,
        has_proven_lines: false,
    };
    let has_place = |[request, response]: [usize; 2]| input.holds_exchange(Mode::Rtu, request, response, request_timeout);
    match_exchange(functions, known, input.bytes(), has_place, |index| input.pause_before(index))
}

/// What is known of an RTU line, by which a request and its response are matched.
pub(super) struct LineContext<'a> {
    pub framer: &'a mut RtuFramer,
    /// What the framer has still to learn of the run so far.
    pub learning: &'a mut LearningRun,
    pub reads: &'a RequestMemo,
    pub profiles: &'a mut Profiles,
    pub timing: &'a TimingModel,
    /// What came before.
    pub answered: Answered,
    /// Reads have times.
    pub has_times: bool,
    /// Request and response are a line of a log each, whose checksums the reader has found valid.
    pub has_proven_lines: bool,
}

/// Returns the exchange at the head of these bytes, if there is no doubt and no finding about it, with log2 of the odds of its
/// response's direction. The framer's model, which learns in a run, and the profile of its unit have learned from it then; its
/// bytes are not consumed.
///
/// `has_place` says whether a request and a response of these lengths are in reads in which nothing else decides, `silence` what
/// silence was before the byte at an index.
///
/// `None` where the framer has a doubt (`RtuFramer::is_certain`), where a self-describing register map may begin in it, and
/// where it would change the profile of its unit or give a finding there. Nothing is learned then.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
pub(super) fn match_exchange(
    functions: &Functions,
    line: LineContext<'_>,
    bytes: &[u8],
    has_place: impl Fn([usize; 2]) -> bool,
    silence: impl Fn(usize) -> Option<Ns>,
) -> Option<(MatchedExchange, f32)> {
    let LineContext { framer, timing, has_times, .. } = line;
    let known = line.reads.get(bytes);
    let expected = match known {
        Some(known) => known.expected,
        None => ExpectedExchange::from_request(functions, Mode::Rtu, bytes)?,
    };
    let counters = known.and_then(|known| known.counters);
    let lengths = expected.rtu_lengths();
    let checks = if line.has_proven_lines { [false; 2] } else { [known.is_none(), true] };
    let is_certain = has_place(lengths)
        && framer.is_certain(&expected, bytes, line.answered, checks, |second| {
            is_response(timing.timeout_log_odds(silence(lengths[0])), has_times, second, lengths[0])
        });
    if !is_certain {
        return None;
    }
    let (request, response) = bytes[..lengths[0] + lengths[1]].split_at(lengths[0]);
    if !line.profiles.learn_on_fast_path(functions, request, expected.read_data(&response[..expected.response_bytes])) {
        return None;
    }
    let pause_evidence = || {
        let silence = silence(lengths[0]);
        let (timeout, poll) = (timing.timeout_log_odds(silence), timing.poll_log_odds(silence));
        PauseEvidence { timeout, poll, ..PauseEvidence::default() }
    };
    if expected.echoes_request {
        framer.learn_run(line.learning);
    }
    let odds = framer.response_odds(&expected, has_times, pause_evidence);
    framer.learn_in_run(line.learning, request, response, expected.echoes_request);
    let response_bits = confidence::of_direction(odds);
    Some((MatchedExchange { expected, mode: Mode::Rtu, mbap_id: None, lines: [0, 0], lengths, response_bits, counters }, odds))
}
