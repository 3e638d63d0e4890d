//! The counters of one bus.

use std::collections::{BTreeMap, VecDeque};

use modlens_engine::records::{Bus, Connection};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use super::before::Before;
use super::network::Connections;
use super::noise::NoiseRuns;
use super::request::RequestCounts;
use super::sample::Sample;
use super::tally::{Place, Tally};
use super::unit::UnitCounts;
use crate::observation::{response_part, Data, FrameObservation, Observation, Outcome, RequestKey, Shift, DAMAGED_PARTS};

/// What is counted of a row depends on at most so many rows before it.
pub const WINDOW: usize = 64;

/// Requests that are counted one by one.
const MAX_REQUESTS: usize = 1024;

/// A write is remembered for so many transactions.
const WRITE_MEMORY: usize = 4;

/// Runs of damage and noise are remembered until their transactions come.
const MAX_RUNS: usize = 1024;

/// Transactions that are remembered with their data.
const RECENT: usize = 48;

/// The last ones of them, whose data may come again as the answer to another request.
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
    /// Times are times of day.
    pub is_utc: bool,
    /// Time of one character, where the line settings are known.
    pub char_ns: Option<Ns>,
    /// The framing.
    pub mode: Option<Mode>,
}

impl BusFacts {
    pub(super) fn learn(&mut self, row: &Bus) {
        self.is_network = row.network.is_some();
        self.is_utc = row.clock == Clock::Utc;
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
    /// The last transactions: to which request data came, and which.
    recent: VecDeque<Option<(RequestKey, Data)>>,
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

    /// Takes the next transaction.
    pub(crate) fn transaction(&mut self, mut seen: Observation) {
        self.transactions_seen += 1;
        self.context.complete(&mut seen);
        if self.first_transactions.len() < WINDOW && self.transactions_seen <= WINDOW as u64 {
            self.context.transaction(&mut seen);
            self.first_transactions.push_back(seen);
        } else {
            let before = self.context.before(&seen);
            self.context.transaction(&mut seen);
            self.count_transaction(&seen, before);
        }
    }

    /// Takes a connection that is over.
    pub(crate) fn connection(&mut self, row: &Connection) {
        (self.facts.is_network, self.facts.is_utc) = (true, row.clock == Clock::Utc);
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
        self.units.entry(seen.unit).or_default().count(seen, before);
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
        let verdict = seen.verdict as usize;
        self.frames[verdict] += 1;
        self.bytes[verdict] += u64::from(seen.length);
        if let Some(time) = seen.place.time {
            let (first, last) = self.span.unwrap_or((time, time));
            self.span = Some((first.min(time), last.max(time)));
        }
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

    fn before(&self, seen: &Observation) -> Before {
        // A request sent again, and one behind bytes that could not be read, say nothing about the order of requests.
        let request = self.previous_request.filter(|before| before.age == 0 && Some(before.key) != seen.key());
        let request = request.map(|before| (before.key.hash(), before.failed));
        let overtaken = self.previous_answer.zip(seen.starts[0]).filter(|(before, start)| before.came > *start);
        let overtaken = overtaken
            .map(|(before, start)| (before.unit, before.place, start - before.requested, before.came - before.requested));
        let written = self.since_write.is_some();
        Before { previous: self.previous, failed: self.previous_failed, written, request, overtaken }
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
                (Some(key), _) => Some(PreviousRequest { key, failed, age: 0 }),
                (None, Some(before)) if before.age < MAX_AGE => {
                    Some(PreviousRequest { failed: before.failed || failed, age: before.age + 1, ..before })
                }
                (None, _) => None,
            };
        } else if seen.is_read_of_all() {
            self.previous = Some((seen.unit, true));
        }
        self.since_write = match self.since_write {
            _ if seen.writes => Some(1),
            Some(count) if count < WRITE_MEMORY => Some(count + 1),
            _ => None,
        };
    }

    /// Compares the data with those of the transactions before.
    fn compare(&mut self, seen: &mut Observation) {
        let key = seen.key().filter(|_| seen.data.length > 0);
        if let Some(key) = key {
            seen.is_of_another = self.is_of_another(key, seen.data);
            seen.shift = self.shift(key, seen.data);
        }
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(key.map(|key| (key, seen.data)));
        self.since_silence = match self.since_silence {
            _ if matches!(seen.outcome, Outcome::Silent | Outcome::NotSeen) => Some(0),
            Some(count) if count < BEHIND_SILENCE => Some(count + 1),
            _ => None,
        };
    }

    /// Whether the data are those that another request was answered with a moment ago, and far from its own.
    fn is_of_another(&self, key: RequestKey, data: Data) -> bool {
        if data.length < LEAST_COMPARED_BYTES || data.is_plain() {
            return false;
        }
        let mut others = self.recent.iter().rev().take(COMPARED).flatten();
        let is_alike =
            others.any(|(other, others)| others.head_hash == data.head_hash && other.unit == key.unit && *other != key);
        let own = || self.recent.iter().rev().flatten().find(|(other, _)| *other == key);
        is_alike && own().is_some_and(|(_, own)| distance(*own, data) >= FAR)
    }

    /// Shortly behind a silence: whether the values go on as those of the request before did in front of it.
    fn shift(&self, key: RequestKey, data: Data) -> Option<Shift> {
        let since = self.since_silence?;
        let before = self.previous_request.map(|before| before.key).filter(|before| before.unit == key.unit && *before != key)?;
        let in_front = || self.recent.iter().rev().skip(since + 1).flatten();
        let last_of = |key: RequestKey| in_front().find(|(other, _)| *other == key).map(|(_, data)| *data);
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
