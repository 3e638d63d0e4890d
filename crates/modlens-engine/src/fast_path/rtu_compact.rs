//! The fast path on an RTU line without a clock, for compact exchanges: a run of them in one loop over the bytes.
//!
//! It takes the exchanges that `rtu_batch` takes there, and leaves the session as that does. What follows from the bytes of a
//! request alone is found once: the requests of a poll cycle come again and again, byte by byte the same. Of these only what
//! differs from one to the next is learned at once, the rest at the end of a run of them.

use crate::confidence;
use crate::fast_path::emit::may_hold_no_map;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::known_reads::{KnownRead, KnownReads};
use crate::fast_path::rows::rtu_transaction_confidence;
use crate::fast_path::rtu_batch::LastExchange;
use crate::fast_path::rtu_exchange::is_response;
use crate::fast_path::run::BatchTotals;
use crate::framer::rtu::traffic_model::LearningRun;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::records::{Exchange, ExchangeRun, Span};
use crate::session::Session;
use crate::stats::{RequestKey, RequestPlace};
use modlens_protocol::direction::TimeoutLogOdds;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

impl Session {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index as compact exchanges, until one does not qualify. The
    /// caller has made sure that `emits_compact` holds, and that nothing is open.
    ///
    /// The framer learns the units, functions and requests of a run one by one, and what is the same of all exchanges at once.
    pub(super) fn emit_compact_rtu_exchanges(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        let plain = line.input.plain_untimed_bytes(Mode::Rtu);
        let Some(framer) = line.framer.rtu_mut().filter(|_| plain > 0) else { return };
        let (bytes, timing) = (line.input.bytes(), &state.pairing.timing);
        let evidence = PauseEvidence {
            timeout: timing.timeout_log_odds(None),
            poll: timing.poll_log_odds(None),
            ..PauseEvidence::default()
        };
        let (first, arena_start) = (self.batch.exchanges.len(), self.batch.arena.len());
        let answered_before = framer.last_answered();
        let mut run = LearningRun::default();
        let (mut end, mut first_requests) = (0, 0);
        // Where the last request begins, and log2 of the odds of its response's direction.
        let mut last: Option<(usize, f32)> = None;
        loop {
            let known = next_known_read(framer, &state.known_reads, &bytes[end..], plain - end);
            let unknown;
            let (expected, counters) = if let Some((read, counters)) = known {
                (&read.expected, Some(counters))
            } else {
                let answered = last.map_or(answered_before, |(at, _)| Some((bytes[at], bytes[at + 1])));
                let next = next_exchange(&self.functions, framer, &bytes[end..], plain - end, answered, evidence.timeout);
                let Some(next) = next else { break };
                unknown = next;
                (&unknown, None)
            };
            let lengths = expected.rtu_lengths();
            let (request, response) = bytes[end..end + lengths[0] + lengths[1]].split_at(lengths[0]);
            if expected.echoes_request {
                framer.learn_run(&mut run);
            }
            let odds = framer.response_odds(expected, false, || evidence);
            framer.learn_in_run(&mut run, request, response, expected.echoes_request);
            first_requests += u64::from(!expected.echoes_request);
            self.batch.exchanges.push(Exchange {
                start: (arena_start + end) as u32,
                lengths: lengths.map(|length| length as u16),
                address: expected.address,
                quantity: expected.quantity,
                unit: expected.unit,
                function: expected.code,
                confidence: rtu_transaction_confidence(expected.echoes_request, confidence::of_direction(odds)),
                exception: 0,
            });
            let key = RequestKey::plain(expected.unit, expected.code, expected.address, expected.quantity);
            if let Some(counters) = counters {
                self.stats.record_exchange_at(state.counts, key, counters);
            } else {
                self.stats.record_exchange(state.counts, (key, None), [None; 2], None);
                let unit = usize::from(expected.unit);
                (state.known_units[unit], state.paired_units[unit]) = (true, true);
                state.pairing.note_answering(expected.unit);
                let expected = *expected;
                state.known_reads.keep(&mut self.stats, state.counts, request, &expected);
            }
            last = Some((end, odds));
            end += lengths[0] + lengths[1];
        }
        let Some((at, odds)) = last else { return };
        framer.learn_run(&mut run);
        let exchanges = (self.batch.exchanges.len() - first) as u64;
        state.pairing.record_untimed_exchanges(exchanges, first_requests);
        let expected = ExpectedExchange::from_request(&self.functions, Mode::Rtu, &bytes[at..]).expect("it was matched");
        self.end_compact_run(bus, first, end, LastExchange { expected, odds });
    }

    /// Consumes the bytes of a run, of which `last` is the last exchange, and does what is done once for all of it. `first` is the
    /// index of its first exchange in the batch.
    fn end_compact_run(&mut self, bus: usize, first: usize, bytes: usize, last: LastExchange) {
        let input = &mut self.buses[bus].lines[0].1.input;
        let offset = input.offset();
        input.consume(bytes);
        self.batch.arena.extend_from_slice(input.consumed_bytes(bytes));
        let count = self.batch.exchanges.len() - first;
        let exchanges = Span { start: first as u32, length: count as u32 };
        let (number, frame) = (self.next_txn, self.next_frame);
        self.batch.exchange_runs.push(ExchangeRun { bus: bus as u32, number, frame, offset, exchanges, packets: None });
        self.next_txn += count as u64;
        self.next_frame += 2 * count as u64;
        self.end_rtu_run(bus, &BatchTotals { exchanges: count as u64, bytes }, last);
    }
}

/// The read at the head of these bytes, of which the first `plain` are in one read without times and marks, and the place of its
/// counters, if both are known and its response follows without doubt: then `next_exchange` would give the same.
#[inline(always)]
#[allow(clippy::inline_always)] // Asked of every exchange.
fn next_known_read<'a>(
    framer: &RtuFramer,
    known_reads: &'a KnownReads,
    bytes: &[u8],
    plain: usize,
) -> Option<(&'a KnownRead, RequestPlace)> {
    let read = known_reads.get(bytes)?;
    let counters = read.counters?;
    // Its request is valid, and no response: nothing else of the line decides.
    let is_certain = read.expected.rtu_lengths().iter().sum::<usize>() <= plain
        && framer.is_certain(&read.expected, bytes, None, [false, true], |_| true);
    is_certain.then_some((read, counters))
}

/// The exchange at the head of these bytes, of which the first `plain` are in one read without times and marks, if
/// `RtuFramer::next_exchange` would take it, too. `answered`: unit and function of the exchange before; `pause`: what an unknown
/// silence says for a timeout.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_exchange(
    functions: &Functions,
    framer: &RtuFramer,
    bytes: &[u8],
    plain: usize,
    answered: Option<(u8, u8)>,
    pause: TimeoutLogOdds,
) -> Option<ExpectedExchange> {
    let expected = ExpectedExchange::from_request(functions, Mode::Rtu, bytes).filter(may_hold_no_map)?;
    let [request_bytes, response_bytes] = expected.rtu_lengths();
    let is_certain = request_bytes + response_bytes <= plain
        && framer.is_certain(&expected, bytes, answered, [true; 2], |second| is_response(pause, false, second, request_bytes));
    is_certain.then_some(expected)
}
