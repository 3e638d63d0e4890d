//! A run of compact exchanges on an RTU line without a clock, one behind the other: how each is decided, and what is learned of
//! it at once.

use crate::confidence;
use crate::fast_path::emit::may_hold_no_map;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::known_reads::{KnownRead, KnownReads};
use crate::fast_path::rows::rtu_transaction_confidence;
use crate::fast_path::rtu_exchange::{is_response, Answered};
use crate::framer::rtu::traffic_model::LearningRun;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::pairing::Pairing;
use crate::records::Exchange;
use crate::session::profiles::{Lesson, Profiles};
use crate::stats::{RequestPlace, Stats};
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

/// What is known of a bus, and learns from each exchange.
pub(super) struct Known<'a> {
    pub functions: &'a Functions,
    pub framer: &'a mut RtuFramer,
    pub pairing: &'a mut Pairing,
    pub reads: &'a mut KnownReads,
    pub profiles: &'a mut Profiles,
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
        loop {
            let (start, rest) = ((arena_start + self.bytes) as u32, &bytes[self.bytes..]);
            if let Some((read, counters)) = next_known_read(known.framer, known.reads, rest) {
                let KnownRead { bytes: request, expected, settled, .. } = read;
                let lesson = known.profiles.learn_unsettled(*settled, known.functions, || of_points(expected, rest));
                if lesson == Some(Lesson::Refused) {
                    break;
                }
                known.stats.record_exchange_at(known.counts, expected.key(), counters);
                known.framer.learn_in_run(&mut self.learned, request, &rest[request.len()..], false);
                self.first_requests += 1;
                exchanges.push(expected.compact(start, expected.rtu_lengths(), of_reads, 0));
                self.pass(expected, CERTAIN_DIRECTION_BITS);
                if lesson == Some(Lesson::Settled) {
                    let request = *request;
                    known.reads.settle(request, known.profiles.generation());
                }
                continue;
            }
            let answered = self.last.map_or(answered_before, |(at, _)| Answered::by_exchange(bytes[at], bytes[at + 1]));
            let Some(decided) = next_exchange(&known, rest, answered, pause) else { break };
            if !known.profiles.are_none() && !known.learn_points(&decided, rest) {
                break;
            }
            exchanges.push(self.take_decided(&mut known, &decided, rest, start, pause));
        }
        known.framer.learn_run(&mut self.learned);
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
    /// Learns what the profile of its unit learns from an exchange at the head of these bytes. `false`, with nothing learned, if
    /// the profile may have something to say to it.
    #[inline(never)]
    fn learn_points(&mut self, Decided { expected, exception }: &Decided, bytes: &[u8]) -> bool {
        if *exception != 0 {
            return self.profiles.pass_over_refusal(expected.unit, expected.code);
        }
        let (request, block) = of_points(expected, bytes);
        self.profiles.learn_block(self.functions, request, block) != Lesson::Refused
    }

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

/// What a profile learns from: the request at the head of these bytes, which begins with the unit, and the data of its response,
/// if it reads.
#[inline]
fn of_points<'a>(expected: &ExpectedExchange, bytes: &'a [u8]) -> (&'a [u8], Option<&'a [u8]>) {
    let (request, response) = bytes.split_at(expected.rtu_lengths()[0]);
    (request, expected.read_data(&response[..expected.response_bytes]))
}

/// The read at the head of these bytes and the place of its counters, if both are known and its response follows without doubt:
/// then `next_exchange` would give the same.
#[inline(always)]
#[allow(clippy::inline_always)] // Asked of every exchange.
fn next_known_read<'a>(framer: &RtuFramer, reads: &'a KnownReads, bytes: &[u8]) -> Option<(&'a KnownRead, RequestPlace)> {
    let read = reads.get(bytes)?;
    let counters = read.counters?;
    // Its request is valid, and no response: nothing else of the line decides.
    framer.is_certain(&read.expected, bytes, Answered::default(), [false, true], |_| true).then_some((read, counters))
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
