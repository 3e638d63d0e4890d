//! A run of compact exchanges on an RTU line without a clock, one after the other: how each is decided, and what is learned of
//! it at once.

use crate::confidence;
use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::request_memo::RequestMemo;
use crate::fast_path::rtu_exchange::{is_response, rtu_transaction_confidence, Answered};
use crate::framer::rtu::search::SURE_SILENCE_SHARE;
use crate::framer::rtu::RtuFramer;
use crate::framer::PauseEvidence;
use crate::pairing::Pairing;
use crate::records::{Exchange, NOT_REFUSED};
use crate::rtu_model::side::REQUEST;
use crate::rtu_model::traffic_model::LearningRun;
use crate::session::profiles::{LearnOutcome, Profiles};
use crate::stats::{RequestKey, Stats};
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::checksum::crc_valid_at;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

/// What is known of a bus, and learns from each exchange.
pub(super) struct RunContext<'a> {
    pub functions: &'a Functions,
    pub framer: &'a mut RtuFramer,
    pub pairing: &'a mut Pairing,
    pub reads: &'a mut RequestMemo,
    pub profiles: &'a mut Profiles,
    /// Units that took part in a good frame, and those in a paired transaction.
    pub units: [&'a mut [bool; 256]; 2],
    pub stats: &'a mut Stats,
    /// Index of the bus in the statistics.
    pub counts: usize,
}

/// The bytes of a run, which are in one read without times and marks, and what came before them.
pub(super) struct RunBytes<'a> {
    pub bytes: &'a [u8],
    /// Where they will begin in the arena.
    pub arena_start: usize,
    answered_before: Answered,
    /// What an unknown silence says.
    pause: PauseEvidence,
}

impl<'a> RunBytes<'a> {
    pub(super) fn new(known: &RunContext<'_>, bytes: &'a [u8], arena_start: usize) -> Self {
        let timing = &known.pairing.timing;
        let pause = PauseEvidence {
            timeout: timing.timeout_log_odds(None),
            poll: timing.poll_log_odds(None),
            ..PauseEvidence::default()
        };
        Self { bytes, arena_start, answered_before: known.framer.answered(), pause }
    }

    /// What a request may be the response to, after an exchange at this index.
    #[inline]
    fn answered_after(&self, last: Option<usize>) -> Answered {
        last.map_or(self.answered_before, |at| Answered::by_exchange(&self.bytes[at..]))
    }
}

/// What a run has taken so far.
#[derive(Default)]
pub(super) struct CompactRun {
    /// Bytes of its exchanges.
    pub length: usize,
    /// Requests whose normal response has the same bytes, refused ones included.
    pub mirrored: u32,
    pub refusals: u32,
    /// Where the request of the last exchange begins.
    pub last: Option<usize>,
    /// Where the response of the last exchange has the bytes of its request: the share of requests that its unit does not answer.
    silence_share: Option<f32>,
    learned: LearningRun,
}

/// An exchange as it was decided.
struct Decided {
    expected: ExpectedExchange,
    /// Of a refusal, else 0.
    exception: u8,
}

impl CompactRun {
    /// Takes exchanges at the head of these bytes until one does not qualify, and appends them to `exchanges`. Gives log2 of the
    /// odds of the direction of the last response.
    pub(super) fn take(&mut self, mut known: RunContext<'_>, block: &RunBytes<'_>, exchanges: &mut Vec<Exchange>) -> f32 {
        known.framer.search.model.begin_run(&mut self.learned);
        loop {
            self.take_remembered_reads(&mut known, block, exchanges);
            let (rest, answered) = (&block.bytes[self.length..], block.answered_after(self.last));
            let Some(decided) = next_exchange(&known, rest, answered, block.pause) else { break };
            let outcome = known.learn_points(&decided, rest);
            if outcome == LearnOutcome::Refused {
                break;
            }
            exchanges.push(self.take_decided(&mut known, &decided, block));
            if outcome == LearnOutcome::Settled && !known.profiles.are_none() {
                known.reads.settle(rest, known.profiles.generation());
            }
        }
        known.framer.learn_run(&mut self.learned);
        self.silence_share.map_or(CERTAIN_DIRECTION_BITS, |share| known.framer.mirrored_response_odds(share, block.pause))
    }

    /// Takes the reads that come next and are known by all of their bytes, and whose response follows without doubt, as
    /// `next_exchange` and `take_decided` would one by one; not those of which a profile may have something to learn.
    fn take_remembered_reads(&mut self, known: &mut RunContext<'_>, block: &RunBytes<'_>, exchanges: &mut Vec<Exchange>) {
        let (model, profiles) = (&mut known.framer.search.model, known.profiles.generation());
        let mut counts = known.stats.exchange_counts(known.counts);
        let (mut rest, mut last, most) = (&block.bytes[self.length..], self.last, self.learned.left());
        let mut taken = 0;
        while taken < most {
            let Some((request, after)) = rest.split_first_chunk() else { break };
            let Some(read) = known.reads.next(*request) else { break };
            let (Some(counters), length) = (read.counters, usize::from(read.exchange.lengths[1])) else { break };
            let is_answered = after.len() >= length
                && read.settled == profiles
                && !(read.expected.resembles_response && block.answered_after(last).may_be_answered_by(known.functions, rest))
                && model.is_familiar(read.exchange.unit, read.exchange.function, REQUEST)
                && read.expected.is_answered_by(request, after)
                && crc_valid_at(after, length);
            if !is_answered {
                break;
            }
            let at = block.bytes.len() - rest.len();
            exchanges.push(Exchange { start: (block.arena_start + at) as u32, ..read.exchange });
            counts.count(counters);
            model.learn_request(&read.identity, request);
            last = Some(at);
            rest = &after[length..];
            taken += 1;
        }
        if let Some(exchange) = exchanges.last().filter(|_| taken > 0) {
            counts.note_last(key_of(exchange));
            (self.last, self.silence_share) = (last, None);
            self.length = block.bytes.len() - rest.len();
            self.learned.count(taken, taken);
        }
    }

    /// Returns the upper bound of the confidence of an exchange whose response equals its request; `u8::MAX` for no bound. It
    /// follows from what was learned before this exchange.
    #[inline]
    fn mirrored_bits(&mut self, known: &mut RunContext<'_>, block: &RunBytes<'_>, unit: u8) -> u8 {
        known.framer.learn_answers(&mut self.learned);
        let share = known.framer.search.silence_share(unit);
        self.silence_share = Some(share);
        if share <= SURE_SILENCE_SHARE {
            return u8::MAX;
        }
        confidence::of_direction(known.framer.mirrored_response_odds(share, block.pause))
    }

    /// Takes the next exchange, which `next_exchange` has decided. Its request may be in the memo, since
    /// `take_remembered_reads` leaves some reads.
    fn take_decided(
        &mut self,
        known: &mut RunContext<'_>,
        Decided { expected, exception }: &Decided,
        block: &RunBytes<'_>,
    ) -> Exchange {
        let lengths = expected.rtu_lengths();
        let (request, response_and_more) = block.bytes[self.length..].split_at(lengths[0]);
        self.silence_share = None;
        // A refusal does not equal its request, but keeps `echoes_request`: the normal response would.
        let is_mirrored = expected.echoes_request && *exception == NOT_REFUSED;
        let response_bits = if is_mirrored { self.mirrored_bits(known, block, expected.unit) } else { u8::MAX };
        known.framer.learn_in_run(&mut self.learned, request, response_and_more, expected.echoes_request);
        self.mirrored += u32::from(expected.echoes_request);
        let start = (block.arena_start + self.length) as u32;
        self.last = Some(self.length);
        self.length += lengths[0] + lengths[1];
        known.note_unit(expected.unit);
        if *exception == NOT_REFUSED {
            known.count_unknown(request, *expected);
        } else {
            known.stats.record_refusal(known.counts, (expected.key(), *exception), None, None);
            self.refusals += 1;
        }
        expected.compact(start, lengths, rtu_transaction_confidence(expected.echoes_request, response_bits), *exception)
    }
}

impl RunContext<'_> {
    /// Learns what the profile of its unit learns from an exchange at the head of these bytes.
    fn learn_points(&mut self, Decided { expected, exception }: &Decided, bytes: &[u8]) -> LearnOutcome {
        if self.profiles.are_none() {
            return LearnOutcome::Settled;
        }
        if *exception != NOT_REFUSED {
            return if self.profiles.pass_over_refusal(expected.unit, expected.code) {
                LearnOutcome::Learned
            } else {
                LearnOutcome::Refused
            };
        }
        let (request, block) = of_points(expected, bytes);
        self.profiles.learn_block(self.functions, request, block)
    }

    /// Notes that a unit has answered.
    #[inline]
    fn note_unit(&mut self, unit: u8) {
        self.units.iter_mut().for_each(|units| units[usize::from(unit)] = true);
        self.pairing.note_answering(unit);
    }

    /// Counts an exchange that was not taken from the memo. Puts its request into the memo, in place of an older entry of the
    /// same bytes, if it is a plain read and there is room for its counters.
    fn count_unknown(&mut self, request: &[u8], expected: ExpectedExchange) {
        let mut counts = self.stats.exchange_counts(self.counts);
        let counters = counts.count_request(expected.key());
        counts.note_last(expected.key());
        if counters.is_some() && RequestMemo::takes(request, &expected) {
            self.reads.add(request, expected, counters);
        }
    }
}

/// What the statistics know the request of an exchange by.
#[inline]
fn key_of(exchange: &Exchange) -> RequestKey {
    RequestKey::plain(exchange.unit, exchange.function, exchange.address, exchange.quantity)
}

/// What a profile learns from: the request at the head of these bytes, which begins with the unit, and the data of its response,
/// if it reads.
fn of_points<'a>(expected: &ExpectedExchange, bytes: &'a [u8]) -> (&'a [u8], Option<&'a [u8]>) {
    let (request, response) = bytes.split_at(expected.rtu_lengths()[0]);
    (request, expected.read_data(&response[..expected.response_bytes]))
}

/// Returns the exchange at the head of these bytes, if it is unambiguous, whether answered or refused. `answered`: what came
/// before; `pause`: what an unknown silence says.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
fn next_exchange(known: &RunContext<'_>, bytes: &[u8], answered: Answered, pause: PauseEvidence) -> Option<Decided> {
    let expected = ExpectedExchange::from_request(known.functions, Mode::Rtu, bytes)?;
    let request_bytes = expected.rtu_lengths()[0];
    let is_followed_by_response = |second: &[u8]| is_response(pause.timeout, false, second, request_bytes);
    let rest = bytes.get(request_bytes..)?;
    if known.framer.is_certain(known.functions, &expected, [bytes, rest], answered, [true; 2], is_followed_by_response) {
        return Some(Decided { expected, exception: NOT_REFUSED });
    }
    let exception = known.framer.refusal_of(known.functions, &expected, bytes, answered)?;
    Some(Decided { expected: expected.refused(), exception })
}
