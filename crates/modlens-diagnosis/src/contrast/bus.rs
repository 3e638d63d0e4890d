//! The counters of one bus.

use std::collections::{BTreeMap, VecDeque};

use modlens_engine::records::{Bus, Connection, Exchange, ExchangeRun, Frame};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use super::before::Before;
use super::clean_units::CleanUnits;
use super::network::Connections;
use super::noise::NoiseRuns;
use super::recall::Recall;
use super::recent::RecentAnswers;
use super::request::{RequestCounts, MAX_REQUESTS};
use super::sample::Sample;
use super::tally::{Place, Tally};
use super::unit::UnitCounts;
use crate::clean::Clean;
use crate::observation::{response_part, Data, FrameObservation, Observation, Outcome, RequestKey, Shift, DAMAGED_PARTS};

/// What is counted of a row depends on at most so many rows before it.
pub const WINDOW: usize = 64;

/// A write is remembered for so many transactions.
const WRITE_MEMORY: usize = 4;

/// Runs of damage and noise are remembered until their transactions come.
const MAX_RUNS: usize = 1024;

/// The last transactions whose data may come again as the answer to another request.
const COMPARED: usize = 12;

/// Behind a silence, the data of so many transactions are compared with those in front of it.
const BEHIND_SILENCE: usize = 24;

/// Registers that differ by less than this may be the next value of the same series.
const FAR: u32 = 64;

/// Shorter answers are alike by accident.
const LEAST_COMPARED_BYTES: u16 = 4;

/// Fewer bytes than these behind a request are strays, not an answer.
const LEAST_ANSWER_BYTES: u32 = 3;

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
    /// Frames without a finding that are not counted in the tallies yet.
    clean: u64,
}

/// A run of damaged frames and noise behind a good frame.
#[derive(Clone, Debug, PartialEq)]
struct BadRun {
    length: u32,
    bytes: Vec<u8>,
}

/// The last request that could be read.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PreviousRequest {
    key: RequestKey,
    /// Of the key.
    hash: u64,
    /// Whether it failed, or one since.
    failed: bool,
    /// Requests since that could not be read.
    age: usize,
}

/// The good answer to the last request.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PreviousAnswer {
    unit: u8,
    place: Place,
    requested: Ns,
    came: Ns,
}

/// Behind so many requests that cannot be read, the one before is forgotten.
const MAX_AGE: usize = 8;

/// What the next rows need to know of those before.
#[derive(Clone, Debug, Default, PartialEq)]
struct Context {
    /// Number of the last good frame, who sent it, and its unit.
    last_good: Option<(u64, Direction, Option<u8>)>,
    /// Number of the last transaction of a frame.
    last_txn: u64,
    /// Damage and noise by the number of the good frame before.
    bad_runs: BTreeMap<u64, BadRun>,
    /// Unit and silence of the last transaction.
    previous: Option<(u8, bool)>,
    /// Whether it failed.
    previous_failed: bool,
    /// The good answer before, on a network.
    previous_answer: Option<PreviousAnswer>,
    /// The last request that could be read, and whether it failed, or one since.
    previous_request: Option<PreviousRequest>,
    /// The last transactions.
    recent: RecentAnswers,
    /// Transactions since the last one without an answer, if they are few.
    since_silence: Option<usize>,
    /// Transactions since the last write, if they are few.
    since_write: Option<usize>,
}

/// The counters of one bus.
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
    /// By unit.
    pub units: BTreeMap<u8, UnitCounts>,
    /// By distinct request.
    pub requests: Sample<RequestKey, RequestCounts, MAX_REQUESTS>,
    /// TCP connections.
    pub connections: Connections,
    context: Context,
    /// The first rows, which are counted when it is known what came before.
    first_frames: VecDeque<FrameObservation>,
    first_transactions: VecDeque<Observation>,
    frames_seen: u64,
    transactions_seen: u64,
    /// Whether something is pending.
    is_pending: bool,
    clean_units: CleanUnits,
    recall: Recall,
}

impl BusContrast {
    /// Takes the next frame.
    pub(crate) fn frame(&mut self, mut seen: FrameObservation) {
        self.frames_seen += 1;
        let attached = self.context.frame(&seen);
        if seen.place.number == 0 {
            seen.place.number = self.context.last_txn;
        }
        if self.first_frames.len() < WINDOW && self.frames_seen <= WINDOW as u64 {
            self.first_frames.push_back(seen);
        } else {
            self.count_frame(&seen, attached);
        }
    }

    /// Takes the next frame if it is good, has no finding and no pauses inside; whether it was taken.
    #[inline]
    pub(crate) fn clean_frame(&mut self, row: &Frame) -> bool {
        let is_clean = row.verdict.is_good() && row.findings.length == 0 && row.pauses.count == 0;
        if !is_clean || self.frames_seen < WINDOW as u64 {
            return false;
        }
        (self.frames_seen, self.is_pending) = (self.frames_seen + 1, true);
        self.context.last_txn = row.txn.unwrap_or(self.context.last_txn);
        self.context.last_good = Some((row.number, row.direction, row.unit));
        self.facts.mode = Some(row.mode);
        self.frames.count_clean(row);
        true
    }

    /// Takes the frames of a run of compact exchanges.
    pub(super) fn compact_frames(&mut self, run: &ExchangeRun, exchanges: &[Exchange]) {
        let Some(last) = exchanges.last() else { return };
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
        self.is_pending = true;
        self.frames.count_compact(2 * in_bulk.len() as u64, bytes);
        self.facts.mode = Some(Mode::Rtu);
        self.context.last_txn = run.number + count - 1;
        self.context.last_good = Some((run.frame + 2 * count - 1, Direction::Response, Some(last.unit)));
    }

    /// Takes the next transaction, an exchange that went well.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Its argument is large, and would be written and read again for each exchange.
    pub(crate) fn clean(&mut self, seen: &Clean) {
        if self.transactions_seen < WINDOW as u64 || !self.count_clean(seen) {
            self.transaction(seen.observation());
        }
    }

    /// Counts an exchange that went well; false, and nothing is done, where more is to be noted than that it did.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn count_clean(&mut self, seen: &Clean) -> bool {
        let hash = seen.hash;
        let slot = self.recall.slot(&mut self.requests, seen.key, hash);
        let is_read = seen.data.length > 0;
        if is_read && self.context.is_odd(seen, self.recall.age(hash)) {
            return false;
        }
        let clean = self.clean_units.of(seen.key.unit);
        if !clean.is_open {
            clean.is_open = self.units.entry(seen.key.unit).or_default().takes_clean();
            if !clean.is_open {
                return false;
            }
        }
        (self.transactions_seen, self.is_pending) = (self.transactions_seen + 1, true);
        let before = self.context.before(Some(seen.key), seen.starts[0]);
        clean.count(seen.key.function, &before);
        let has_times = seen.place.time.is_some() || seen.gap.is_some() || seen.response_time.is_some();
        if has_times || seen.starts[1].is_some() || before.previous.is_some_and(|(_, was_silent)| was_silent) {
            self.units.entry(seen.key.unit).or_default().count_clean_times(*seen, before);
        }
        self.requests_seen.count_good(1);
        if let Some(counts) = slot.and_then(|slot| self.requests.at(slot, &seen.key)) {
            counts.count_clean(seen, before.request);
        }
        if let Some((unit, place, waited, needed)) = before.overtaken {
            self.units.entry(unit).or_default().overtaken.count(place, waited, needed);
        }
        self.recall.note(is_read.then_some(hash));
        self.context.follow_clean(seen);
        true
    }

    /// Forgets what could be found anew: requests have been left out, or rows came that are not in the memory of answers.
    pub(super) fn forget(&mut self) {
        self.recall = Recall::default();
    }

    /// Counts what is pending, before anything is shown or merged.
    pub(super) fn settle(&mut self) {
        if !std::mem::take(&mut self.is_pending) {
            return;
        }
        self.frames.settle();
        self.clean_units.take().for_each(|(unit, pending)| self.units.entry(unit).or_default().settle(pending));
        self.requests.values_mut().for_each(RequestCounts::settle);
    }

    /// Takes the next transaction.
    pub(crate) fn transaction(&mut self, mut seen: Observation) {
        self.transactions_seen += 1;
        self.context.complete(&mut seen);
        self.recall.note(seen.key().filter(|_| seen.data.length > 0).map(RequestKey::hash));
        if self.first_transactions.len() < WINDOW && self.transactions_seen <= WINDOW as u64 {
            self.context.transaction(&mut seen);
            self.first_transactions.push_back(seen);
        } else {
            let before = self.context.before(seen.key(), seen.starts[0]);
            self.context.transaction(&mut seen);
            self.count_transaction(&seen, before);
        }
    }

    /// Takes a connection that is over.
    pub(crate) fn connection(&mut self, row: &Connection) {
        (self.facts.is_network, self.facts.clock) = (true, row.clock);
        self.connections.count(row);
    }

    /// With the first rows counted, as if nothing came before them.
    pub(super) fn completed(&self) -> Self {
        let mut all = Self { facts: self.facts.clone(), ..Self::default() };
        // A bus that has already counted everything it takes.
        (all.frames_seen, all.transactions_seen) = (WINDOW as u64, WINDOW as u64);
        all.merge(self);
        all
    }

    /// Adds the part behind this one.
    pub(super) fn merge(&mut self, later: &Self) {
        later.first_frames.iter().for_each(|seen| self.frame(seen.clone()));
        later.first_transactions.iter().for_each(|seen| self.transaction(seen.clone()));
        self.frames_seen += later.frames_seen - later.first_frames.len() as u64;
        self.transactions_seen += later.transactions_seen - later.first_transactions.len() as u64;
        // Where all of them were replayed, the context is already that behind them.
        let all_replayed = later.transactions_seen == later.first_transactions.len() as u64;
        self.context.follow(&later.context, !all_replayed);
        self.frames.merge(&later.frames);
        self.noise.merge(&later.noise);
        self.strays.merge(&later.strays);
        self.connections.merge(&later.connections);
        self.requests_seen.merge(&later.requests_seen);
        for (unit, more) in &later.units {
            self.units.entry(*unit).or_default().merge(more);
        }
        self.requests.merge(&later.requests, RequestCounts::merge);
        self.facts = BusFacts { mode: later.facts.mode.or(self.facts.mode), ..later.facts.clone() };
        self.forget();
        self.settle();
    }

    fn count_frame(&mut self, seen: &FrameObservation, attached: Option<(Direction, Option<u8>)>) {
        self.facts.mode = Some(seen.mode);
        self.frames.count(seen);
        if seen.verdict.is_good() {
            self.count_pause(seen);
            return;
        }
        self.noise.count(seen, attached.is_some_and(|(direction, _)| direction == Direction::Request));
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

    fn count_transaction(&mut self, seen: &Observation, before: Before) {
        if seen.outcome.counts() {
            self.requests_seen.count(seen.outcome.is_failure(), seen.place);
        }
        let unit = self.units.entry(seen.unit).or_default();
        if let Some(pending) = self.clean_units.pending(seen.unit) {
            unit.settle_order(pending);
        }
        unit.count(seen, before);
        if let Some((unit, place, waited, needed)) = before.overtaken {
            self.units.entry(unit).or_default().overtaken.count(place, waited, needed);
        }
        let Some(key) = seen.key().filter(|_| seen.outcome.counts()) else { return };
        if let Some(counts) = self.requests.entry(key.hash(), key) {
            counts.count(seen, before);
        }
    }
}

/// How far the first two registers of two answers are apart.
fn distance(one: Data, other: Data) -> u32 {
    one.head.iter().zip(other.head).map(|(one, other)| u32::from(one.abs_diff(other))).sum()
}

/// Values so near to each other come about by accident once in 2 to the power of this.
fn bits(one: Data, other: Data) -> u32 {
    let registers = usize::from(one.length / 2).min(2);
    let near = |at: usize| 16u32.saturating_sub((2 * u32::from(one.head[at].abs_diff(other.head[at])) + 1).ilog2());
    (0..registers).map(near).sum()
}

impl FrameCounts {
    fn count(&mut self, seen: &FrameObservation) {
        self.settle();
        self.count_size(seen.verdict as usize, seen.length, seen.place.time);
        let has = |finding| seen.findings.has(finding);
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
    }
}

impl Context {
    /// Notes a frame. For damage or noise: who sent the good frame before, and its unit.
    fn frame(&mut self, seen: &FrameObservation) -> Option<(Direction, Option<u8>)> {
        self.last_txn = seen.txn.unwrap_or(self.last_txn);
        if seen.verdict.is_good() {
            self.last_good = Some((seen.number, seen.direction, seen.unit));
            return None;
        }
        let (number, direction, unit) = self.last_good?;
        let run = self.bad_runs.entry(number).or_insert_with(|| BadRun { length: 0, bytes: Vec::new() });
        run.length += seen.length;
        run.bytes.extend_from_slice(&seen.bytes);
        if self.bad_runs.len() > MAX_RUNS {
            self.bad_runs.pop_first();
        }
        Some((direction, unit))
    }

    /// An unanswered request behind which an answer's worth of damage came was answered, if badly.
    fn complete(&self, seen: &mut Observation) {
        let Some(run) = self.bad_runs.get(&seen.request_frame).filter(|run| run.length >= LEAST_ANSWER_BYTES) else { return };
        if seen.outcome == Outcome::Garbled {
            seen.lengths[1] = run.length;
        }
        if seen.outcome != Outcome::Silent {
            return;
        }
        seen.outcome = Outcome::Garbled;
        seen.damage = Some(response_part(&run.bytes, seen.unit, seen.function, &[]));
        let head = run.bytes.len().min(seen.request_head.len());
        seen.is_own_echo = run.bytes[..head] == seen.request_head[..head];
        seen.lengths[1] = run.length;
    }

    /// What came before a request with this key and start.
    #[inline]
    fn before(&self, key: Option<RequestKey>, start: Option<Ns>) -> Before {
        // A request sent again, and one behind bytes that could not be read, say nothing about the order of requests.
        let request = self.previous_request.filter(|before| before.age == 0 && Some(before.key) != key);
        let request = request.map(|before| (before.hash, before.failed));
        let overtaken = self.previous_answer.zip(start).filter(|(before, start)| before.came > *start);
        let overtaken = overtaken
            .map(|(before, start)| (before.unit, before.place, start - before.requested, before.came - before.requested));
        let written = self.since_write.is_some();
        let asked = self.previous_request.map(|before| before.key);
        Before { previous: self.previous, failed: self.previous_failed, written, request, overtaken, asked }
    }

    fn transaction(&mut self, seen: &mut Observation) {
        self.compare(seen);
        self.previous_answer = match (seen.outcome, seen.starts) {
            (Outcome::Good | Outcome::Refused, [Some(requested), Some(came)]) => {
                Some(PreviousAnswer { unit: seen.unit, place: seen.place, requested, came })
            }
            _ => None,
        };
        if seen.outcome.counts() {
            self.previous = Some((seen.unit, seen.outcome == Outcome::Silent));
            self.previous_failed = seen.outcome.is_failure();
            let failed = seen.outcome.is_failure();
            self.previous_request = match (seen.key(), self.previous_request) {
                (Some(key), _) => Some(PreviousRequest { key, hash: key.hash(), failed, age: 0 }),
                (None, Some(before)) if before.age < MAX_AGE => {
                    Some(PreviousRequest { failed: before.failed || failed, age: before.age + 1, ..before })
                }
                (None, _) => None,
            };
        } else if seen.is_read_of_all() {
            self.previous = Some((seen.unit, true));
        }
        self.note_write(seen.writes);
    }

    #[inline]
    fn note_write(&mut self, writes: bool) {
        self.since_write = match self.since_write {
            _ if writes => Some(1),
            Some(count) if count < WRITE_MEMORY => Some(count + 1),
            _ => None,
        };
    }

    /// Notes an exchange that went well and whose data are not odd.
    #[inline]
    fn follow_clean(&mut self, seen: &Clean) {
        self.remember(Some(seen.key).filter(|_| seen.data.length > 0), seen.data);
        self.note_silence(false);
        self.previous_answer = match seen.starts {
            [Some(requested), Some(came)] => Some(PreviousAnswer { unit: seen.key.unit, place: seen.place, requested, came }),
            _ => None,
        };
        (self.previous, self.previous_failed) = (Some((seen.key.unit, false)), false);
        self.previous_request = Some(PreviousRequest { key: seen.key, hash: seen.hash, failed: false, age: 0 });
        self.note_write(seen.writes);
    }

    /// Whether the data of an exchange that went well may be those of another request, or go on with its values. `age` is
    /// how many transactions back its request was answered last, as far as that is known.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As `BusContrast::clean`.
    fn is_odd(&self, seen: &Clean, age: Option<u64>) -> bool {
        let own = match age {
            Some(age) => self.recent.at_age(age as usize),
            None => self.recent.last_of(seen.key),
        };
        let is_far = own.is_some_and(|(_, own)| distance(own, seen.data) >= FAR);
        let is_behind_silence = own.is_some() && self.since_silence.is_some();
        (is_far && self.is_of_another(seen.key, seen.data)) || (is_behind_silence && self.shift(seen.key, seen.data).is_some())
    }

    /// Compares the data with those of the transactions before.
    fn compare(&mut self, seen: &mut Observation) {
        let key = seen.key().filter(|_| seen.data.length > 0);
        if let Some(key) = key {
            seen.is_of_another = self.is_of_another(key, seen.data);
            seen.shift = self.shift(key, seen.data);
        }
        self.remember(key, seen.data);
        self.note_silence(matches!(seen.outcome, Outcome::Silent | Outcome::NotSeen));
    }

    #[inline]
    fn remember(&mut self, key: Option<RequestKey>, data: Data) {
        self.recent.push(key.map(|key| (key, data)));
    }

    #[inline]
    fn note_silence(&mut self, is_silent: bool) {
        self.since_silence = match self.since_silence {
            _ if is_silent => Some(0),
            Some(count) if count < BEHIND_SILENCE => Some(count + 1),
            _ => None,
        };
    }

    /// Whether the data are those that another request was answered with a moment ago, and far from its own.
    fn is_of_another(&self, key: RequestKey, data: Data) -> bool {
        if data.length < LEAST_COMPARED_BYTES || data.is_plain() {
            return false;
        }
        let mut others = self.recent.newest_first().take(COMPARED).flatten();
        let is_alike = others.any(|(other, others)| others.opening == data.opening && other.unit == key.unit && other != key);
        let own = || self.recent.newest_first().flatten().find(|(other, _)| *other == key);
        is_alike && own().is_some_and(|(_, own)| distance(own, data) >= FAR)
    }

    /// Shortly behind a silence: whether the values go on as those of the request before did in front of it.
    fn shift(&self, key: RequestKey, data: Data) -> Option<Shift> {
        let since = self.since_silence?;
        let before = self.previous_request.map(|before| before.key).filter(|before| before.unit == key.unit && *before != key)?;
        let in_front = || self.recent.newest_first().skip(since + 1).flatten();
        let last_of = |key: RequestKey| in_front().find(|(other, _)| *other == key).map(|(_, data)| data);
        let (own, others) = (last_of(key)?, last_of(before)?);
        if own.length != data.length || others.length != data.length || distance(own, data) < FAR {
            return None;
        }
        if distance(others, data) * 8 >= distance(own, data) {
            return (distance(others, data) >= FAR).then_some(Shift::Elsewhere);
        }
        Some(Shift::ToRequestBefore(bits(others, data)))
    }

    /// What the rows after a later part need to know.
    fn follow(&mut self, later: &Self, with_transactions: bool) {
        self.last_good = later.last_good.or(self.last_good);
        self.last_txn = later.last_txn.max(self.last_txn);
        if with_transactions {
            self.previous_failed = if later.previous.is_some() { later.previous_failed } else { self.previous_failed };
            self.previous = later.previous.or(self.previous);
            self.previous_request = later.previous_request.or(self.previous_request);
            self.since_write = later.since_write;
            self.since_silence = later.since_silence;
            self.previous_answer = later.previous_answer;
            self.recent.clone_from(&later.recent);
        }
        for (number, run) in &later.bad_runs {
            self.bad_runs.insert(*number, run.clone());
        }
        while self.bad_runs.len() > MAX_RUNS {
            self.bad_runs.pop_first();
        }
    }
}
