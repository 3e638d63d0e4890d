//! The counters of one bus.

use std::collections::{BTreeMap, VecDeque};

use modlens_engine::records::{Batch, Bus, Connection, Exchange, ExchangeRun, Frame, Side};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::oddity::is_of_driver;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use super::before::Before;
use super::clean_units::CleanUnits;
use super::context::{Around, Context, GoodFrame, LEAST_ANSWER_BYTES};
use super::known_requests::RequestMemory;
use super::lists::Lists;
use super::network::{Connections, Counted};
use super::noise::NoiseRuns;
use super::rates::Rates;
use super::request::{RequestCounts, MAX_REQUESTS};
use super::runs::Runs;
use super::sample::Sample;
use super::symptoms::Symptoms;
use super::tally::Tally;
use super::told::Told;
use super::unit::UnitCounts;
use crate::observation::{
    is_swapped_answer, is_write, write_of_compact, written, FrameObservation, Observation, Outcome, RequestKey, DAMAGED_PARTS,
};
use modlens_engine::durations::Durations;

/// What is counted of a row depends on at most so many rows before it.
pub const WINDOW: usize = 64;

/// So many rows may be pending, for which numbers of 32 bits are enough.
const MAX_PENDING: u64 = 1 << 30;

/// What is known of a bus beforehand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BusFacts {
    /// It is a connection over a network.
    pub is_network: bool,
    /// The clock of its times.
    pub clock: Clock,
    /// The settings of the receiver, where they are known.
    pub line: Option<LineSettings>,
    /// Time of one character, where the line settings are known.
    pub char_ns: Option<Ns>,
    /// The framing.
    pub mode: Option<Mode>,
}

impl BusFacts {
    pub(super) fn learn(&mut self, row: &Bus) {
        self.is_network = row.network.is_some();
        self.clock = row.clock;
        self.line = row.line;
        self.char_ns = row.line.map(|line| line.char_ns());
    }
}

/// Frames, good and bad, of a bus.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameCounts {
    /// By verdict, in the order of `Verdict::ALL`.
    pub frames: [u64; 5],
    /// Bytes by verdict.
    pub bytes: [u64; 5],
    /// Bytes of frames with a right checksum that may be an accident of noise.
    pub unconfirmed_bytes: u64,
    /// First and last time.
    pub span: Option<(Ns, Ns)>,
    /// Frames with a single flipped bit.
    pub bit_flips: Tally,
    /// Frames in which another device transmitted, too.
    pub collisions: Tally,
    /// Requests heard twice.
    pub echoes: Tally,
    /// Frames with a pause inside.
    pub pauses: Tally,
    /// Bytes lost or doubled by the tap.
    pub lost: Tally,
    /// Damaged requests without a transaction, by the part that is damaged.
    pub request_parts: [Tally; DAMAGED_PARTS],
    /// How fast the bytes of good frames came.
    pub rates: Rates,
    /// Good frames of writes, and those shortly after them.
    pub behind_writes: u64,
    /// Frames without a finding that are not counted in the tallies yet.
    clean: u64,
}

/// The counters of one bus.
///
/// Exchanges that went well are pending until somebody asks (`settle`); two with something pending are not equal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BusContrast {
    /// What is known beforehand.
    pub facts: BusFacts,
    /// Frames.
    pub frames: FrameCounts,
    /// Noise.
    pub noise: NoiseRuns,
    /// Strays that no unit is near.
    pub strays: Tally,
    /// Requests that tell how the line works, and which of them failed.
    pub requests_seen: Tally,
    /// What odd transactions and bytes look like.
    pub symptoms: Symptoms,
    /// From requests without any answer to the next request.
    pub hasty: Durations,
    /// Answers that came after the next request.
    pub steps_behind: Tally,
    /// Runs of those.
    pub step_runs: Runs,
    /// By unit.
    pub units: BTreeMap<u8, UnitCounts>,
    /// By distinct request.
    pub requests: Sample<RequestKey, RequestCounts, MAX_REQUESTS>,
    /// TCP connections.
    pub connections: Connections,
    /// Writes to unit 0, which nobody answers.
    pub broadcasts: u64,
    /// A short recording is two lists one after the other.
    pub lists: Option<Lists>,
    /// Frames and transactions with a finding that is more than worth knowing.
    pub troubles: u64,
    /// Damaged frames that the program says it has received.
    pub received_damage: u64,
    /// A short recording holds nothing but requests to this unit that its program has received.
    pub heard: Option<u8>,
    /// What a short recording says.
    pub told: Option<Told>,
    pub(super) context: Context,
    /// The first rows, which are counted when it is known what came before.
    first_frames: VecDeque<FrameObservation>,
    first_transactions: VecDeque<Observation>,
    frames_seen: u64,
    pub(super) transactions_seen: u64,
    /// Frames and transactions that are pending.
    pub(super) pending: u64,
    pub(super) clean_units: CleanUnits,
    pub(super) known: RequestMemory,
}

/// A request begins after a silence of 3.5 characters (serial line, 2.5.1.1), rounded down for the clock.
const SILENCE_CHARACTERS: Ns = 3;
/// A character at 115200 baud.
const LEAST_CHAR_NS: Ns = 95_000;
/// A request to read has so many bytes.
const REQUEST_BYTES: u32 = 8;

/// From the beginning of a request to that of one of another master, in halves of a character: its own eight, and a silence.
const HALF_CHARACTERS_APART: i64 = 17;

impl BusContrast {
    /// Answers that were not late and for which no request was seen.
    pub fn answers_alone(&self) -> u64 {
        let of_other_units = |unit: &UnitCounts| -> u64 { unit.answers_for.values().map(|tally| tally.failed).sum() };
        self.units.values().map(|unit| unit.second_answers.failed + of_other_units(unit)).sum()
    }

    /// Takes the next frame.
    pub(crate) fn frame(&mut self, mut seen: FrameObservation) {
        self.frames_seen += 1;
        let around = self.context.frame(&seen);
        if seen.place.number == 0 {
            seen.place.number = self.context.last_txn;
        }
        if self.first_frames.len() < WINDOW && self.frames_seen <= WINDOW as u64 {
            self.first_frames.push_back(seen);
        } else {
            self.count_frame(&seen, around);
        }
    }

    /// Takes the next frame if it is good, has no finding and no pauses inside; whether it was taken.
    #[inline]
    pub(crate) fn clean_frame(&mut self, batch: &Batch, row: &Frame) -> bool {
        let is_same_framing = self.facts.mode == Some(row.mode);
        let is_clean = row.verdict.is_good() && row.findings.length == 0 && row.pauses.count == 0 && is_same_framing;
        if !is_clean || self.frames_seen < WINDOW as u64 || self.context.may_be_foreign(row) || is_swapped_answer(batch, row) {
            return false;
        }
        self.context.note_sent(row.side, row.direction, row.number);
        self.frames_seen += 1;
        self.pending += 1;
        self.context.last_txn = row.txn.unwrap_or(self.context.last_txn);
        let sender = (row.direction, row.unit);
        let write = row.code.filter(|code| is_write(*code)).and_then(|_| written(batch, row));
        let good = GoodFrame::after(self.context.last_good, row.number, sender, row.mode, row.code, write);
        self.context.last_good = Some(good.at(row.last_origin));
        self.count_behind_write(good);
        self.frames.rates.count(row.direction, row.unit, row.pauses, self.facts.char_ns);
        self.frames.count_clean(row);
        true
    }

    /// Takes the frames of a run of compact exchanges.
    pub(super) fn compact_frames(&mut self, run: &ExchangeRun, exchanges: &[Exchange]) {
        if exchanges.is_empty() {
            return;
        }
        let numbered = exchanges.iter().zip(run.number..).zip((run.frame..).step_by(2));
        let mut rest = 0;
        for ((row, txn), frame) in numbered.clone() {
            if self.frames_seen >= WINDOW as u64 {
                break;
            }
            rest += 1;
            self.frame(FrameObservation::of_compact(txn, frame, Direction::Request, row));
            self.frame(FrameObservation::of_compact(txn, frame + 1, Direction::Response, row));
        }
        let count = exchanges.len() as u64;
        let in_bulk = &exchanges[rest..];
        let bytes = in_bulk.iter().map(|row| u64::from(row.lengths[0]) + u64::from(row.lengths[1])).sum();
        self.frames_seen += 2 * in_bulk.len() as u64;
        self.pending += in_bulk.len() as u64;
        self.frames.count_compact(2 * in_bulk.len() as u64, bytes);
        self.facts.mode = Some(Mode::Rtu);
        self.context.last_txn = run.number + count - 1;
        let mut good = self.context.last_good;
        for (at, row) in in_bulk.iter().enumerate() {
            for (frame, direction) in [Direction::Request, Direction::Response].into_iter().enumerate() {
                let number = run.frame + 2 * (rest + at) as u64 + frame as u64;
                let write = is_write(row.function).then_some(row).map(write_of_compact);
                let next = GoodFrame::after(good, number, (direction, Some(row.unit)), Mode::Rtu, Some(row.function), write);
                self.count_behind_write(next);
                good = Some(next);
            }
        }
        self.context.last_good = good;
    }

    /// Forgets what could be found again: requests have been left out, or rows came that are not in the memory of answers.
    pub(super) fn forget(&mut self) {
        self.known.clear(self.context.recent.count());
    }

    /// Ends a batch.
    pub(super) fn end_batch(&mut self) {
        if self.pending > MAX_PENDING {
            self.settle();
        }
    }

    /// Counts what is pending, before anything is shown or merged.
    pub(super) fn settle(&mut self) {
        if std::mem::take(&mut self.pending) == 0 {
            return;
        }
        self.frames.settle();
        self.settle_requests();
        self.clean_units.all_pending().for_each(|(unit, pending)| self.units.entry(unit).or_default().settle(pending));
    }

    /// Counts what is pending of all requests.
    pub(super) fn settle_requests(&mut self) {
        (0..self.known.len()).for_each(|index| self.settle_request(index));
    }

    /// Counts what is pending of a request, before anything else is counted of it; of its unit it stays pending.
    pub(super) fn settle_request(&mut self, index: usize) {
        let known = self.known.at(index);
        if known.pending.good == 0 {
            return;
        }
        let (key, slot, pending) = (known.key(), known.slot, known.pending.take());
        self.clean_units.of(key.unit).by_function.add(key.function, u64::from(pending.good));
        if let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &key)) {
            counts.count_clean(&pending);
        }
        if let Some((before, pairs)) = pending.pairs() {
            self.count_pairs(key, slot, before, pairs);
        }
    }

    /// Counts how often exchanges that went well came right after others.
    pub(super) fn count_pairs(&mut self, key: RequestKey, slot: Option<u16>, before: RequestKey, pairs: u32) {
        self.clean_units.of(key.unit).by_previous.add(before.unit, pairs.into());
        if let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &key)) {
            if before == key {
                // A request sent again says nothing about the order of requests.
                counts.repeated += u64::from(pairs);
            } else {
                counts.count_pairs(before, pairs);
            }
        }
    }

    /// Takes the next transaction.
    pub(crate) fn transaction(&mut self, mut seen: Observation) {
        self.transactions_seen += 1;
        self.context.complete(&mut seen);
        // What two lines call received, or sent, the one is no echo of the other.
        seen.is_own_echo &= !self.has_same_sender(seen.request_frame, seen.response_frame);
        if let Some(key) = seen.key().filter(|_| seen.data.length > 0) {
            self.known.note(key, self.context.recent.next_number(), seen.data.head);
        }
        if self.first_transactions.len() < WINDOW && self.transactions_seen <= WINDOW as u64 {
            self.context.transaction(&mut seen);
            self.first_transactions.push_back(seen);
        } else {
            let before = self.context.before(seen.key(), seen.starts[0]);
            self.context.transaction(&mut seen);
            self.count_transaction(&seen, before);
        }
    }

    /// The unit to which all frames are requests that were received.
    fn heard(&self) -> Option<u8> {
        let unit = self.first_frames.front()?.unit?;
        let is_heard =
            |frame: &FrameObservation| frame.side == Some(Side::Received) && frame.is_read_request() && frame.unit == Some(unit);
        self.first_frames.iter().all(is_heard).then_some(unit)
    }

    /// Whether two of the first frames were sent by the same one, as the recording says.
    fn has_same_sender(&self, one: u64, other: u64) -> bool {
        let side_of = |number: u64| self.first_frames.iter().find(|frame| frame.number == number)?.side;
        side_of(one).is_some_and(|side| side_of(other) == Some(side))
    }

    /// Whether the recording ends with a request whose answer may have come later.
    pub fn ends_open(&self) -> bool {
        self.context.is_open()
    }

    /// Takes a connection that is over.
    pub(crate) fn connection(&mut self, row: &Connection, before: Counted) {
        (self.facts.is_network, self.facts.clock) = (true, row.clock);
        self.connections.count(row, before);
    }

    /// Takes what has come of a connection that is still open.
    pub(crate) fn open_connection(&mut self, row: &Connection, before: Counted, now: Ns) {
        (self.facts.is_network, self.facts.clock) = (true, row.clock);
        self.connections.count_open(row, before, now);
    }

    /// With the first rows counted, as if nothing came before them.
    pub(super) fn completed(&self) -> Self {
        let mut all = Self { facts: self.facts.clone(), ..Self::default() };
        // A bus that has already counted everything it takes.
        (all.frames_seen, all.transactions_seen) = (WINDOW as u64, WINDOW as u64);
        all.merge(self);
        if self.frames_seen <= WINDOW as u64 && self.transactions_seen <= WINDOW as u64 && !self.facts.is_network {
            all.lists = Lists::of(&self.first_frames, &self.first_transactions);
            all.heard = self.heard();
        }
        if self.transactions_seen <= WINDOW as u64 {
            all.told = Told::of(&self.first_transactions, all.facts.mode);
        }
        all
    }

    /// Adds the part after this one.
    pub(super) fn merge(&mut self, later: &Self) {
        self.settle();
        if later.pending > 0 {
            let mut settled = later.clone();
            settled.settle();
            return self.merge(&settled);
        }
        later.first_frames.iter().for_each(|seen| self.frame(seen.clone()));
        later.first_transactions.iter().for_each(|seen| self.transaction(seen.clone()));
        self.frames_seen += later.frames_seen - later.first_frames.len() as u64;
        self.transactions_seen += later.transactions_seen - later.first_transactions.len() as u64;
        // Where all of them were replayed, the context is already that after them.
        let all_replayed = later.transactions_seen == later.first_transactions.len() as u64;
        self.context.follow(&later.context, !all_replayed);
        self.frames.merge(&later.frames);
        self.noise.merge(&later.noise);
        self.strays.merge(&later.strays);
        self.received_damage += later.received_damage;
        self.troubles += later.troubles;
        self.connections.merge(&later.connections);
        self.requests_seen.merge(&later.requests_seen);
        self.symptoms.merge(&later.symptoms);
        self.hasty.merge(&later.hasty);
        self.broadcasts += later.broadcasts;
        self.steps_behind.merge(&later.steps_behind);
        self.step_runs.merge(&later.step_runs);
        for (unit, more) in &later.units {
            self.units.entry(*unit).or_default().merge(more);
        }
        self.requests.merge(&later.requests, RequestCounts::merge);
        self.facts = BusFacts { mode: later.facts.mode.or(self.facts.mode), ..later.facts.clone() };
        self.forget();
    }

    fn count_frame(&mut self, seen: &FrameObservation, around: Around) {
        let attached = around.attached;
        self.troubles += u64::from(seen.findings.has_trouble());
        self.facts.mode = Some(seen.mode);
        self.frames.count(seen);
        self.count_line_errors(seen);
        if let Some(behind_write) = around.burst {
            self.noise.by_write[usize::from(behind_write)] += 1;
            let write = self.context.last_good.and_then(|good| good.write());
            if let Some(write) = write.filter(|_| behind_write) {
                self.noise.after_writes.count_burst(write);
            }
        }
        if let Some((_, Some(unit))) = attached.filter(|_| around.is_doubled) {
            self.units.entry(unit).or_default().doubled.count(true, seen.place);
        }
        if seen.verdict.is_good() {
            if let Some(good) = self.context.last_good {
                self.count_behind_write(good);
            }
            self.symptoms.lone_layout(seen);
            if seen.is_swapped {
                self.symptoms.swapped_checksum(seen);
            }
            if around.is_foreign {
                self.symptoms.foreign_request(seen);
            }
            if around.is_other_framing {
                self.symptoms.other_framing(seen);
            }
            self.frames.rates.count(seen.direction, seen.unit, seen.pauses, self.facts.char_ns);
            self.count_pause(seen);
            return;
        }
        self.received_damage += u64::from(seen.side == Some(Side::Received) && seen.length >= LEAST_ANSWER_BYTES);
        self.noise.count(seen, attached.is_some_and(|(direction, _)| direction == Direction::Request));
        let is_answer =
            seen.length >= LEAST_ANSWER_BYTES && attached.is_some_and(|(direction, _)| direction == Direction::Request);
        // On Modbus/TCP, only what begins with a header is taken for the answer of a transaction.
        if seen.txn.is_none() && (!is_answer || seen.mode == Mode::Tcp) {
            self.symptoms.frame(seen, attached.and_then(|(_, unit)| unit), around.is_behind_header);
        }
        if let (Some((Direction::Response, Some(unit))), true) = (attached, self.may_be_spoiled_request(seen)) {
            self.units.entry(unit).or_default().spoiled_after.count(true, seen.place);
        }
        if seen.length < LEAST_ANSWER_BYTES && seen.txn.is_none() {
            match attached {
                Some((direction, Some(unit))) => {
                    let side = usize::from(direction != Direction::Request);
                    self.units.entry(unit).or_default().strays[side].count(true, seen.place);
                }
                _ => self.strays.count(true, seen.place),
            }
        }
    }

    /// Whether these are a few bytes of no transaction, after a silence, and no more than a request has: what is left of one.
    fn may_be_spoiled_request(&self, seen: &FrameObservation) -> bool {
        let silence = SILENCE_CHARACTERS * self.facts.char_ns.unwrap_or(LEAST_CHAR_NS);
        let is_apart = seen.gap.is_some_and(|gap| gap >= silence);
        let is_of_driver = seen.bytes.iter().all(|byte| is_of_driver(*byte));
        seen.mode == Mode::Rtu && seen.txn.is_none() && is_apart && seen.length <= REQUEST_BYTES && !is_of_driver
    }

    /// Counts a frame with parity or framing errors.
    fn count_line_errors(&mut self, seen: &FrameObservation) {
        if let (true, Some(unit)) = (seen.findings.has(Finding::LineError), seen.unit) {
            let side = usize::from(seen.direction != Direction::Request);
            self.units.entry(unit).or_default().line_errors[side].count(true, seen.place);
        }
    }

    /// Counts the pauses inside a frame, with the unit that it was from or to.
    fn count_pause(&mut self, seen: &FrameObservation) {
        let side = match seen.direction {
            _ if seen.pauses.count == 0 => return,
            Direction::Request => 0,
            Direction::Response => 1,
            Direction::Unknown => return,
        };
        if let Some(unit) = seen.unit {
            self.units.entry(unit).or_default().pauses[side].count(seen.pauses, seen.place);
        }
    }

    /// Counts a good frame that belongs to a write, or follows one.
    #[inline]
    fn count_behind_write(&mut self, good: GoodFrame) {
        if good.is_behind_write() {
            self.frames.behind_writes += 1;
            if let Some(write) = good.write() {
                self.noise.after_writes.count_frame(write);
            }
        }
    }

    fn count_transaction(&mut self, seen: &Observation, before: Before) {
        self.symptoms.transaction(seen, before);
        self.troubles += u64::from(seen.findings.has_trouble());
        // Requests without any silence between them were read late, both at once: no second master hits the very end of a frame.
        let least = HALF_CHARACTERS_APART * self.facts.char_ns.unwrap_or(0) / 2;
        if let Some(after) = before.hasty.filter(|after| *after > least) {
            self.hasty.add(after);
        }
        if seen.outcome == Outcome::Good {
            if seen.is_step_behind {
                self.steps_behind.count(true, seen.place);
            }
            self.step_runs.count(seen.is_step_behind);
        }
        self.broadcasts += u64::from(seen.outcome == Outcome::Unknown);
        if seen.outcome.counts() {
            self.requests_seen.count(seen.outcome.is_failure(), seen.place);
        }
        let unit = self.units.entry(seen.unit).or_default();
        if let Some(pending) = self.clean_units.open(seen.unit) {
            unit.settle_order(pending);
        }
        unit.count(seen, before);
        if let Some((unit, place, waited, needed)) = before.overtaken {
            self.units.entry(unit).or_default().overtaken.count(place, waited, needed);
        }
        let Some(key) = seen.key().filter(|_| seen.outcome.counts()) else { return };
        if let Some(index) = self.known.find(key.number()) {
            self.settle_request(index);
        }
        if let Some(counts) = self.requests.entry(key.hash(), key) {
            counts.count(seen, before);
        }
    }
}

impl FrameCounts {
    fn count(&mut self, seen: &FrameObservation) {
        self.settle();
        self.count_size(seen.verdict as usize, seen.length, seen.place.time);
        let has = |finding| seen.findings.has(finding);
        if seen.verdict.is_good() && has(Finding::Unconfirmed) {
            self.unconfirmed_bytes += u64::from(seen.length);
        }
        self.bit_flips.count(has(Finding::BitFlip), seen.place);
        self.collisions.count(has(Finding::Collision), seen.place);
        self.echoes.count(has(Finding::LocalEcho), seen.place);
        self.pauses.count(has(Finding::GapInFrame), seen.place);
        if let Some(part) = seen.damage {
            self.request_parts.iter_mut().enumerate().for_each(|(at, tally)| tally.count(at == part as usize, seen.place));
        }
        self.lost.count(has(Finding::LostBytes) || has(Finding::DuplicateByte), seen.place);
    }

    #[inline]
    fn count_clean(&mut self, row: &Frame) {
        self.clean += 1;
        self.count_size(row.verdict as usize, row.wire.length, row.start);
    }

    fn count_compact(&mut self, frames: u64, bytes: u64) {
        self.clean += frames;
        self.frames[Verdict::Ok as usize] += frames;
        self.bytes[Verdict::Ok as usize] += bytes;
    }

    #[inline]
    fn count_size(&mut self, verdict: usize, length: u32, time: Option<Ns>) {
        self.frames[verdict] += 1;
        self.bytes[verdict] += u64::from(length);
        if let Some(time) = time {
            let (first, last) = self.span.unwrap_or((time, time));
            self.span = Some((first.min(time), last.max(time)));
        }
    }

    /// Counts the clean frames in the tallies.
    fn settle(&mut self) {
        let clean = std::mem::take(&mut self.clean);
        for tally in [&mut self.bit_flips, &mut self.collisions, &mut self.echoes, &mut self.pauses, &mut self.lost] {
            tally.count_good(clean);
        }
    }

    fn merge(&mut self, later: &Self) {
        self.frames.iter_mut().zip(later.frames).for_each(|(own, more)| *own += more);
        self.bytes.iter_mut().zip(later.bytes).for_each(|(own, more)| *own += more);
        self.unconfirmed_bytes += later.unconfirmed_bytes;
        self.span = match (self.span, later.span) {
            (Some(own), Some(more)) => Some((own.0.min(more.0), own.1.max(more.1))),
            (own, more) => own.or(more),
        };
        self.bit_flips.merge(&later.bit_flips);
        self.collisions.merge(&later.collisions);
        self.request_parts.iter_mut().zip(&later.request_parts).for_each(|(own, more)| own.merge(more));
        self.echoes.merge(&later.echoes);
        self.pauses.merge(&later.pauses);
        self.lost.merge(&later.lost);
        self.behind_writes += later.behind_writes;
        self.rates.merge(&later.rates);
    }
}
