//! The fast path on an RTU line without a clock, for exchanges in short: a run of them in one loop over the bytes.
//!
//! It takes the exchanges that `rtu_batch` takes there, and leaves the session as that does. What follows from the bytes of a
//! request alone is found once: the requests of a poll cycle come again and again, byte by byte the same.

use crate::confidence;
use crate::fast_path::emit::{may_hold_no_map, BatchTotals};
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rows::rtu_transaction_confidence;
use crate::fast_path::rtu_batch::LastExchange;
use crate::fast_path::rtu_exchange::is_response;
use crate::framer::rtu::side::REQUEST;
use crate::framer::PauseEvidence;
use crate::records::{Exchange, ExchangeRun, Span};
use crate::session::Session;
use crate::stats::{RequestKey, RequestPlace};
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::framing::Mode;

/// Bytes of a plain read on the wire.
const READ_BYTES: usize = 8;

/// Places for requests, a power of two; a request that finds another one at its place takes it.
const PLACES: usize = 1024;

/// Reads that were found valid and unlike any response, with what follows from their bytes.
#[derive(Default)]
pub(crate) struct KnownReads(Vec<Option<KnownRead>>);

#[derive(Clone, Copy)]
struct KnownRead {
    bytes: [u8; READ_BYTES],
    expected: ExpectedExchange,
    counters: RequestPlace,
}

impl KnownReads {
    /// The place of a request: the highest bits of its product with an odd number without pattern.
    fn place(bytes: [u8; READ_BYTES]) -> usize {
        (u64::from_le_bytes(bytes).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - PLACES.ilog2())) as usize
    }

    #[inline]
    fn get(&self, bytes: &[u8]) -> Option<&KnownRead> {
        let head = bytes.first_chunk()?;
        self.0.get(Self::place(*head))?.as_ref().filter(|known| known.bytes == *head)
    }

    #[cold]
    fn add(&mut self, bytes: [u8; READ_BYTES], expected: ExpectedExchange, counters: RequestPlace) {
        self.0.resize(PLACES, None);
        self.0[Self::place(bytes)] = Some(KnownRead { bytes, expected, counters });
    }
}

impl Session {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index in short, until one does not qualify. The
    /// caller has made sure that `emits_in_short` holds, and that nothing is open.
    pub(super) fn emit_rtu_exchanges_in_short(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        let plain_bytes = line.input.plain_untimed_bytes(Mode::Rtu);
        let Some(framer) = line.framer.rtu_mut().filter(|_| plain_bytes > 0) else { return };
        let bytes = line.input.bytes();
        let (first, arena_start) = (self.batch.exchanges.len(), self.batch.arena.len());
        let mut answered = framer.last_answered();
        let mut last = None;
        let mut end = 0;
        loop {
            let rest = &bytes[end..];
            let known = state.known_reads.get(rest);
            let Some(expected) = known.map(|known| known.expected).or_else(|| {
                ExpectedExchange::from_request(&self.functions, Mode::Rtu, rest).filter(may_hold_no_map).filter(|expected| {
                    let is_like_response = expected.resembles_response || expected.echoes_request;
                    !(is_like_response && answered == Some((expected.unit, expected.code)))
                })
            }) else {
                break;
            };
            let lengths = [expected.request_bytes, expected.response_bytes].map(|length| length + CRC_BYTES);
            let both = lengths[0] + lengths[1];
            if end + both > plain_bytes {
                break;
            }
            let (request, answer) = rest.split_at(lengths[0]);
            let is_answered = framer.search.model.is_familiar(expected.unit, expected.code, REQUEST)
                && expected.is_answered_by(request, answer)
                && crc_valid_at(answer, lengths[1])
                && (known.is_some() || crc_valid_at(request, lengths[0]));
            let pause = || state.pairing.timing.timeout_log_odds(None);
            if !is_answered || (expected.echoes_request && !is_response(pause(), false, answer, lengths[0])) {
                break;
            }
            let evidence =
                || PauseEvidence { timeout: pause(), poll: state.pairing.timing.poll_log_odds(None), ..PauseEvidence::default() };
            let odds = framer.response_odds(&expected, false, evidence);
            framer.record_exchange(request, &answer[..lengths[1]], expected.echoes_request);
            state.pairing.record_exchange(expected.unit, None, expected.echoes_request, None, None);
            let key = RequestKey::plain(expected.unit, expected.code, expected.address, expected.quantity);
            match known.map(|known| known.counters) {
                Some(counters) => self.stats.record_exchange_at(state.counts, key, counters),
                None => {
                    self.stats.record_exchange(state.counts, key, [None; 2], None);
                    let unit = usize::from(expected.unit);
                    (state.known_units[unit], state.paired_units[unit]) = (true, true);
                    if let Some(bytes) = as_known_read(&expected, request) {
                        if let Some(counters) = self.stats.place_of(state.counts, key) {
                            state.known_reads.add(bytes, expected, counters);
                        }
                    }
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
            end += both;
        }
        let Some(last) = last else { return };
        let offset = line.input.offset();
        line.input.consume(end);
        let exchanges = self.batch.exchanges.len() - first;
        let run = Span { start: first as u32, length: exchanges as u32 };
        self.batch.exchange_runs.push(ExchangeRun {
            bus: bus as u32,
            number: self.next_txn,
            frame: self.next_frame,
            offset,
            exchanges: run,
        });
        self.next_txn += exchanges as u64;
        self.next_frame += 2 * exchanges as u64;
        self.end_rtu_run(bus, &BatchTotals { exchanges: exchanges as u64, bytes: end }, last);
    }
}

/// The bytes of a request that is a read and cannot be taken for a response.
fn as_known_read(expected: &ExpectedExchange, request: &[u8]) -> Option<[u8; READ_BYTES]> {
    let bytes = <[u8; READ_BYTES]>::try_from(request).ok()?;
    (!expected.echoes_request && !expected.resembles_response).then_some(bytes)
}
