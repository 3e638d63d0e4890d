//! The fast path on an RTU line without a clock, for exchanges in short: a run of them in one loop over the bytes.
//!
//! It takes the exchanges that `rtu_batch` takes there, and leaves the session as that does. What follows from the bytes of a
//! request alone is found once: the requests of a poll cycle come again and again, byte by byte the same.

use crate::confidence;
use crate::fast_path::emit::{may_hold_no_map, BatchTotals};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::known_reads::KnownReads;
use crate::fast_path::rows::rtu_transaction_confidence;
use crate::fast_path::rtu_batch::LastExchange;
use crate::fast_path::rtu_exchange::is_response;
use crate::framer::rtu::side::REQUEST;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::records::{Exchange, ExchangeRun, Span};
use crate::session::Session;
use crate::stats::{RequestKey, RequestPlace};
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::direction::TimeoutLogOdds;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

impl Session {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index in short, until one does not qualify. The
    /// caller has made sure that `emits_in_short` holds, and that nothing is open.
    pub(super) fn emit_rtu_exchanges_in_short(&mut self, bus: usize) {
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
        let mut answered = framer.last_answered();
        let mut last = None;
        let mut end = 0;
        while let Some((expected, counters)) =
            next_exchange(&self.functions, framer, &state.known_reads, &bytes[end..], plain - end, answered, evidence.timeout)
        {
            let lengths = [expected.request_bytes, expected.response_bytes].map(|length| length + CRC_BYTES);
            let (request, answer) = bytes[end..end + lengths[0] + lengths[1]].split_at(lengths[0]);
            let odds = framer.response_odds(&expected, false, || evidence);
            framer.record_exchange(request, answer, expected.echoes_request);
            state.pairing.record_exchange(expected.unit, None, expected.echoes_request, None, None);
            let key = RequestKey::plain(expected.unit, expected.code, expected.address, expected.quantity);
            if let Some(counters) = counters {
                self.stats.record_exchange_at(state.counts, key, counters);
            } else {
                self.stats.record_exchange(state.counts, (key, None), [None; 2], None);
                let unit = usize::from(expected.unit);
                (state.known_units[unit], state.paired_units[unit]) = (true, true);
                if KnownReads::takes(request, &expected) {
                    state.known_reads.add(request, expected, self.stats.place_of(state.counts, key));
                }
            }
            self.batch.exchanges.push(Exchange {
                start: (arena_start + end) as u32,
                lengths: lengths.map(|length| length as u16),
                address: expected.address,
                quantity: expected.quantity,
                unit: expected.unit,
                function: expected.code,
                confidence: rtu_transaction_confidence(expected.echoes_request, confidence::of_direction(odds)),
            });
            answered = Some((expected.unit, expected.code));
            last = Some(LastExchange { expected, odds });
            end += lengths[0] + lengths[1];
        }
        if let Some(last) = last {
            self.end_run_in_short(bus, first, end, last);
        }
    }

    /// Consumes the bytes of a run, of which `last` is the last exchange, and does what is done once for all of it. `first` is the
    /// index of its first exchange in the batch.
    fn end_run_in_short(&mut self, bus: usize, first: usize, bytes: usize, last: LastExchange) {
        let input = &mut self.buses[bus].lines[0].1.input;
        let offset = input.offset();
        input.consume(bytes);
        let count = self.batch.exchanges.len() - first;
        let exchanges = Span { start: first as u32, length: count as u32 };
        let (number, frame) = (self.next_txn, self.next_frame);
        self.batch.exchange_runs.push(ExchangeRun { bus: bus as u32, number, frame, offset, exchanges });
        self.next_txn += count as u64;
        self.next_frame += 2 * count as u64;
        self.end_rtu_run(bus, &BatchTotals { exchanges: count as u64, bytes }, last);
    }
}

/// The exchange at the head of these bytes, of which the first `plain` are in one read without times and marks, if
/// `RtuFramer::next_exchange` would take it, too; with the place of its request's counters, if the request is known. `answered`:
/// unit and function of the exchange before; `pause`: what an unknown silence says for a timeout.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_exchange(
    functions: &Functions,
    framer: &RtuFramer,
    known_reads: &KnownReads,
    bytes: &[u8],
    plain: usize,
    answered: Option<(u8, u8)>,
    pause: TimeoutLogOdds,
) -> Option<(ExpectedExchange, Option<RequestPlace>)> {
    let known = known_reads.get(bytes);
    let expected = match known {
        Some(known) => known.expected,
        None => ExpectedExchange::from_request(functions, Mode::Rtu, bytes).filter(may_hold_no_map)?,
    };
    let is_like_response = expected.resembles_response || expected.echoes_request;
    if is_like_response && answered == Some((expected.unit, expected.code)) {
        return None;
    }
    let [request_bytes, answer_bytes] = [expected.request_bytes, expected.response_bytes].map(|length| length + CRC_BYTES);
    if request_bytes + answer_bytes > plain {
        return None;
    }
    let (request, answer) = bytes.split_at(request_bytes);
    let is_answered = framer.search.model.is_familiar(expected.unit, expected.code, REQUEST)
        && expected.is_answered_by(request, answer)
        && crc_valid_at(answer, answer_bytes)
        && (known.is_some() || crc_valid_at(request, request_bytes));
    let is_certain = is_answered && (!expected.echoes_request || is_response(pause, false, answer, request_bytes));
    is_certain.then(|| (expected, known.and_then(|known| known.counters)))
}
