//! A run of compact exchanges on an RTU line without a clock, one behind the other: how each is decided, and what is learned of
//! it at once.

use crate::confidence;
use crate::fast_path::emit::may_hold_no_map;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::known_reads::KnownReads;
use crate::fast_path::rows::rtu_transaction_confidence;
use crate::fast_path::rtu_exchange::{is_response, Answered};
use crate::framer::rtu::side::REQUEST;
use crate::framer::rtu::traffic_model::LearningRun;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::pairing::Pairing;
use crate::records::Exchange;
use crate::stats::{RequestKey, RequestPlace, Stats};
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

/// What is known of a bus, and learns from each exchange.
pub(super) struct Known<'a> {
    pub functions: &'a Functions,
    pub framer: &'a mut RtuFramer,
    pub pairing: &'a mut Pairing,
    pub reads: &'a mut KnownReads,
    /// Units that took part in a good frame, and those in a paired transaction.
    pub units: [&'a mut [bool; 256]; 2],
    pub stats: &'a mut Stats,
    /// Index of the bus in the statistics.
    pub counts: usize,
}

/// What a run has taken so far.
#[derive(Default)]
pub(super) struct CompactRun {
    /// Bytes of its exchanges.
    pub bytes: usize,
    /// Requests whose response may not have the same bytes.
    pub first_requests: u32,
    pub refusals: u32,
    /// The last exchange: where its request begins, and log2 of the odds of its response's direction.
    pub last: Option<(usize, f32)>,
    learned: LearningRun,
}

/// An exchange as it was decided.
struct Decided {
    expected: ExpectedExchange,
    /// Of a refusal, else 0.
    exception: u8,
}

impl CompactRun {
    /// Takes exchanges at the head of these bytes, which are in one read without times and marks, until one does not qualify, and
    /// appends them to `exchanges`. Their bytes will begin at `arena_start` in the arena.
    pub(super) fn take(&mut self, mut known: Known<'_>, bytes: &[u8], arena_start: usize, exchanges: &mut Vec<Exchange>) {
        let timing = &known.pairing.timing;
        let pause = PauseEvidence {
            timeout: timing.timeout_log_odds(None),
            poll: timing.poll_log_odds(None),
            ..PauseEvidence::default()
        };
        let answered_before = known.framer.answered();
        let of_reads = rtu_transaction_confidence(false, u8::MAX);
        known.framer.search.model.begin_run(&mut self.learned);
        loop {
            self.take_known_reads(&mut known, bytes, (arena_start, answered_before), of_reads, exchanges);
            let (start, rest) = ((arena_start + self.bytes) as u32, &bytes[self.bytes..]);
            let answered = answered_behind(self.last.map(|(at, _)| at), bytes, answered_before);
            let Some(decided) = next_exchange(&known, rest, answered, pause) else { break };
            exchanges.push(self.take_decided(&mut known, &decided, rest, start, pause));
        }
        known.framer.learn_run(&mut self.learned);
    }

    /// Takes the reads at the head of these bytes that are known by all of their bytes, and whose response follows without doubt,
    /// as `next_exchange` would one by one.
    #[inline]
    fn take_known_reads(
        &mut self,
        known: &mut Known<'_>,
        bytes: &[u8],
        (arena_start, answered_before): (usize, Answered),
        confidence: u8,
        exchanges: &mut Vec<Exchange>,
    ) {
        let model = &mut known.framer.search.model;
        let mut counts = known.stats.exchange_counts(known.counts);
        let mut rest = &bytes[self.bytes..];
        let mut left = self.learned.left();
        let mut last: Option<(usize, RequestKey, RequestPlace)> = None;
        let answered = |last: Option<usize>| answered_behind(last.or(self.last.map(|(at, _)| at)), bytes, answered_before);
        while left > 0 {
            let Some((request, behind)) = rest.split_first_chunk() else { break };
            let Some(read) = known.reads.next(*request) else { break };
            let (Some(counters), expected) = (read.counters, &read.expected) else { break };
            let length = expected.response_bytes + CRC_BYTES;
            let is_answered = behind.len() >= length
                && !(expected.resembles_response && answered(last.map(|(at, ..)| at)).may_be_again(expected))
                && model.is_familiar(expected.unit, expected.code, REQUEST)
                && expected.is_answered_by(request, behind)
                && crc_valid_at(behind, length);
            if !is_answered {
                break;
            }
            let at = bytes.len() - rest.len();
            exchanges.push(expected.compact((arena_start + at) as u32, expected.rtu_lengths(), confidence, 0));
            counts.count(counters);
            model.learn_request(&read.identity, request);
            last = Some((at, expected.key(), counters));
            rest = &behind[length..];
            left -= 1;
        }
        if let Some((at, key, counters)) = last {
            counts.note_last(key, counters);
            self.last = Some((at, CERTAIN_DIRECTION_BITS));
            self.bytes = bytes.len() - rest.len();
            let taken = self.learned.left() - left;
            self.learned.count_reads(taken);
            self.first_requests += taken;
        }
    }

    /// Leaves behind an exchange, of which the direction of the response has these odds.
    #[inline]
    fn pass(&mut self, expected: &ExpectedExchange, odds: f32) {
        self.last = Some((self.bytes, odds));
        self.bytes += expected.rtu_lengths().iter().sum::<usize>();
    }

    /// Takes an exchange at the head of these bytes that is no read known by all of its bytes; `start` as above.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Called once.
    fn take_decided(
        &mut self,
        known: &mut Known<'_>,
        Decided { expected, exception }: &Decided,
        bytes: &[u8],
        start: u32,
        pause: PauseEvidence,
    ) -> Exchange {
        let (request, response) = bytes.split_at(expected.rtu_lengths()[0]);
        let odds = if expected.echoes_request && *exception == 0 {
            known.framer.learn_turns(&mut self.learned);
            known.framer.response_odds(expected, false, || pause)
        } else {
            CERTAIN_DIRECTION_BITS
        };
        known.framer.learn_in_run(&mut self.learned, request, response, expected.echoes_request);
        self.first_requests += u32::from(!expected.echoes_request);
        self.pass(expected, odds);
        known.note_unit(expected.unit);
        if *exception == 0 {
            known.count_unknown(request, *expected);
        } else {
            known.stats.record_refusal(known.counts, (expected.key(), *exception), None, None);
            self.refusals += 1;
        }
        let confidence = rtu_transaction_confidence(expected.echoes_request, confidence::of_direction(odds));
        expected.compact(start, expected.rtu_lengths(), confidence, *exception)
    }
}

impl Known<'_> {
    /// Notes that a unit has answered.
    fn note_unit(&mut self, unit: u8) {
        self.units.iter_mut().for_each(|units| units[usize::from(unit)] = true);
        self.pairing.note_answering(unit);
    }

    /// Counts an exchange whose request was not known, and keeps what follows from that if there is room for its counters.
    #[inline(never)]
    fn count_unknown(&mut self, request: &[u8], expected: ExpectedExchange) {
        let key = expected.key();
        let Some(counters) = self.stats.place_of(self.counts, key) else {
            self.stats.record_exchange_without_place(self.counts, key);
            return;
        };
        self.stats.record_exchange_at(self.counts, key, counters);
        if KnownReads::takes(request, &expected) {
            self.reads.add(request, expected, Some(counters));
        }
    }
}

/// What a request may be the response to, behind an exchange at this index.
fn answered_behind(last: Option<usize>, bytes: &[u8], answered_before: Answered) -> Answered {
    last.map_or(answered_before, |at| Answered::by_exchange(bytes[at], bytes[at + 1]))
}

/// The exchange at the head of these bytes, if `RtuFramer::next_exchange` would take it, too, or if it is refused without a
/// doubt. `answered`: what came before; `pause`: what an unknown silence says.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_exchange(known: &Known<'_>, bytes: &[u8], answered: Answered, pause: PauseEvidence) -> Option<Decided> {
    let expected = ExpectedExchange::from_request(known.functions, Mode::Rtu, bytes).filter(may_hold_no_map)?;
    let request_bytes = expected.rtu_lengths()[0];
    let is_followed_by_response = |second: &[u8]| is_response(pause.timeout, false, second, request_bytes);
    if known.framer.is_certain(&expected, bytes, answered, [true; 2], is_followed_by_response) {
        return Some(Decided { expected, exception: 0 });
    }
    let exception = known.framer.refusal_of(&expected, bytes, answered)?;
    Some(Decided { expected: expected.refused(), exception })
}
