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
use super::tally::Tally;
use super::unit::UnitCounts;
use crate::observation::{response_part, FrameObservation, Observation, Outcome, RequestKey};

/// What is counted of a row depends on at most so many rows before it.
pub const WINDOW: usize = 64;

/// Requests that are counted one by one.
const MAX_REQUESTS: usize = 1024;

/// A write is remembered for so many transactions.
const WRITE_MEMORY: usize = 4;

/// Runs of damage and noise are remembered until their transactions come.
const MAX_RUNS: usize = 1024;

/// Transactions whose data the next ones are compared with.
const RECENT: usize = 12;

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
}

/// A run of damaged frames and noise behind a good frame.
#[derive(Clone, Debug, PartialEq)]
struct BadRun {
    length: u32,
    bytes: Vec<u8>,
}

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
    /// The last transactions: to which request data came, and their hashes.
    recent: VecDeque<Option<(RequestKey, u64)>>,
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
    pub(super) fn frame(&mut self, mut seen: FrameObservation) {
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
    pub(super) fn transaction(&mut self, mut seen: Observation) {
        self.transactions_seen += 1;
        self.context.complete(&mut seen);
        if self.first_transactions.len() < WINDOW && self.transactions_seen <= WINDOW as u64 {
            self.context.transaction(&mut seen);
            self.first_transactions.push_back(seen);
        } else {
            let before = self.context.before();
            self.context.transaction(&mut seen);
            self.count_transaction(&seen, before);
        }
    }

    /// Takes a connection that is over.
    pub(super) fn connection(&mut self, row: &Connection) {
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

    /// Counts whether a frame came in pieces, with the unit that it was from or to.
    fn count_pause(&mut self, seen: &FrameObservation) {
        let side = match seen.direction {
            Direction::Request => 0,
            Direction::Response => 1,
            Direction::Unknown => return,
        };
        if let Some(unit) = seen.unit.filter(|_| self.facts.char_ns.is_some()) {
            self.units.entry(unit).or_default().pauses[side].count(seen.findings.has(Finding::GapInFrame), seen.place);
        }
    }

    fn count_transaction(&mut self, seen: &Observation, before: Before) {
        if seen.outcome.counts() {
            self.requests_seen.count(seen.outcome.is_failure(), seen.place);
        }
        self.units.entry(seen.unit).or_default().count(seen, before);
        let Some(key) = seen.key().filter(|_| seen.outcome.counts()) else { return };
        if let Some(counts) = self.requests.entry(key.hash(), key) {
            counts.count(seen);
        }
    }
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
        if seen.outcome != Outcome::Silent {
            return;
        }
        let Some(run) = self.bad_runs.get(&seen.request_frame).filter(|run| run.length >= LEAST_ANSWER_BYTES) else { return };
        seen.outcome = Outcome::Garbled;
        seen.damage = Some(response_part(&run.bytes, seen.unit, seen.function, &[]));
        let head = run.bytes.len().min(seen.request_head.len());
        seen.is_own_echo = run.bytes[..head] == seen.request_head[..head];
        seen.lengths[1] = run.length;
    }

    fn before(&self) -> Before {
        Before { previous: self.previous, written: self.since_write.is_some() }
    }

    fn transaction(&mut self, seen: &mut Observation) {
        self.compare(seen);
        if seen.outcome.counts() {
            self.previous = Some((seen.unit, seen.outcome == Outcome::Silent));
        }
        self.since_write = match self.since_write {
            _ if seen.writes => Some(1),
            Some(count) if count < WRITE_MEMORY => Some(count + 1),
            _ => None,
        };
    }

    /// Notes whether the data are those that another request was answered with a moment ago.
    fn compare(&mut self, seen: &mut Observation) {
        let key = seen.key().filter(|_| seen.data.length >= LEAST_COMPARED_BYTES && !seen.data.is_plain());
        let head = seen.data.head_hash;
        let mut others = self.recent.iter().flatten();
        seen.is_of_another =
            key.is_some_and(|key| others.any(|(other, hash)| other.unit == key.unit && *other != key && *hash == head));
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(key.map(|key| (key, head)));
    }

    /// What the rows after a later part need to know.
    fn follow(&mut self, later: &Self, with_transactions: bool) {
        self.last_good = later.last_good.or(self.last_good);
        self.last_txn = later.last_txn.max(self.last_txn);
        if with_transactions {
            self.previous = later.previous.or(self.previous);
            self.since_write = later.since_write;
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
