//! The counters of one bus.

mod frames;

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, VecDeque};

use modlens_engine::records::{Bus, Connection, Side};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{Mode, Verdict as FrameVerdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use super::before::Before;
use super::clean_units::CleanUnits;
use super::context::Context;
use super::followed::Followed;
use super::frame_counts::FrameCounts;
use super::known_requests::RequestMemory;
use super::lists::Lists;
use super::network::{Connections, Counted};
use super::noise::NoiseRuns;
use super::odd_run::{overhears, OddRun};
use super::request::{RequestCounts, MAX_REQUESTS};
use super::runs::Runs;
use super::sample::Sample;
use super::symptoms::Symptoms;
use super::tally::Tally;
use super::told::Told;
use super::unit::UnitCounts;
use crate::observation::{FrameObservation, Observation, Outcome, RequestKey};
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
    /// Whether it is a serial line, as far as its frames tell.
    pub fn is_line(&self) -> bool {
        !self.is_network && self.mode != Some(Mode::Tcp)
    }

    pub(super) fn learn(&mut self, row: &Bus) {
        self.is_network = row.network.is_some();
        self.clock = row.clock;
        self.line = row.line;
        self.char_ns = row.line.map(|line| line.char_ns());
    }
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
    /// The program of a short recording sends answers: it is a unit, or a gateway.
    pub is_unit: bool,
    /// What a short recording says.
    pub told: Option<Told>,
    /// In a short recording, an answer and its request are in one run of bytes that the program has received, and it has sent none.
    pub overhears: bool,
    /// In a short recording, the first run of bytes of no frame that is long enough for one.
    pub odd_run: Option<OddRun>,
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
/// From the beginning of a request to that of one of another master, in halves of a character: its own eight, and a silence.
const HALF_CHARACTERS_APART: i64 = 17;

impl BusContrast {
    /// Answers that were not late and for which no request was seen.
    pub fn answers_alone(&self) -> u64 {
        let of_other_units = |unit: &UnitCounts| -> u64 { unit.answers_for.values().map(|tally| tally.failed).sum() };
        self.units.values().map(|unit| unit.second_answers.failed + of_other_units(unit)).sum()
    }

    /// Whether it has no times, no answers and no request twice: frames that somebody quotes side by side, and no recording of a line.
    pub(crate) fn is_quoted(&self) -> bool {
        let requests = self.requests.sorted();
        let is_silent = |unit: &UnitCounts| unit.failures.total == unit.silent.failed;
        let is_single = |counts: &RequestCounts| counts.good == 0 && counts.bad.failed <= 1;
        let is_all_silent = self.answers_alone() == 0 && self.units.values().all(is_silent);
        self.facts.clock == Clock::None
            && requests.len() > 1
            && is_all_silent
            && requests.iter().all(|(_, counts)| is_single(counts))
            && self.frames.bytes.iter().sum::<u64>() == self.frames.bytes_of(FrameVerdict::Ok)
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
            let before = self.context.before(seen.key(), seen.bus, seen.starts[0], seen.gap);
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
    pub(super) fn completed(self) -> Self {
        let mut all = Self { facts: self.facts.clone(), ..Self::default() };
        // A bus that has already counted everything it takes.
        (all.frames_seen, all.transactions_seen) = (WINDOW as u64, WINDOW as u64);
        if self.frames_seen <= WINDOW as u64 && self.transactions_seen <= WINDOW as u64 && !self.facts.is_network {
            all.lists = Lists::of(&self.first_frames, &self.first_transactions);
            all.heard = self.heard();
            all.overhears = overhears(&self.first_frames);
            all.odd_run = OddRun::of(&self.first_frames);
            let is_answer = |frame: &FrameObservation| frame.side == Some(Side::Sent) && frame.direction == Direction::Response;
            all.is_unit = self.first_frames.iter().any(|frame| frame.verdict.is_good() && is_answer(frame));
        }
        let few = (self.transactions_seen <= WINDOW as u64).then(|| self.first_transactions.clone());
        all.merge(self);
        all.told = few.and_then(|few| Told::of(&few, all.facts.mode));
        all
    }

    /// Adds the part after this one.
    pub(super) fn merge(&mut self, mut later: Self) {
        self.settle();
        later.settle();
        let replayed = (later.first_frames.len() as u64, later.first_transactions.len() as u64);
        later.first_frames.into_iter().for_each(|seen| self.frame(seen));
        later.first_transactions.into_iter().for_each(|seen| self.transaction(seen));
        self.frames_seen += later.frames_seen - replayed.0;
        self.transactions_seen += later.transactions_seen - replayed.1;
        // Where all of them were replayed, the context is already that after them.
        let all_replayed = later.transactions_seen == replayed.1;
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
        for (unit, more) in later.units {
            match self.units.entry(unit) {
                Entry::Vacant(none) => drop(none.insert(more)),
                Entry::Occupied(mut own) => own.get_mut().merge(&more),
            }
        }
        self.requests.merge(later.requests, RequestCounts::merge);
        self.facts = BusFacts { mode: later.facts.mode.or(self.facts.mode), ..later.facts };
        self.forget();
    }

    /// Counts what followed the answer to a request.
    pub(super) fn count_followed(&mut self, asked: RequestKey, number: u64, followed: Followed) {
        let slot = self.known.find(asked.number()).and_then(|index| self.known.at(index).slot).map(usize::from);
        let counts = match slot {
            Some(slot) if self.requests.at(slot, &asked).is_some() => self.requests.at(slot, &asked),
            _ => self.requests.entry(asked.hash(), asked),
        };
        if let Some(counts) = counts {
            counts.followed.count(number, followed);
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
        if let Some((asked, number, followed)) = before.followed {
            self.count_followed(asked, number, followed);
        }
        if let Some((asked, after)) = seen.intruder {
            let unit = self.units.entry(asked.unit).or_default();
            unit.intruding.count(true, seen.place);
            unit.intruding_after.add(after);
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
