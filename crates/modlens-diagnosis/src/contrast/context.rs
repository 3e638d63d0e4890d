//! What the rows of a bus need to know of those before them.

mod compared;

use std::collections::BTreeMap;

use modlens_engine::records::{Frame, Side};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::oddity::{bare_refusals, is_doubled, is_of_driver, Altered};
use modlens_protocol::Ns;

use super::before::Before;
use super::followed::Followed;
use super::good_frame::GoodFrame;
use super::recent::RecentAnswers;
use super::tally::Place;
use crate::observation::{
    answer_length, data_length, response_part, DamagedPart, Figures, FrameObservation, Observation, Outcome, RequestKey,
};

/// A write is remembered for so many transactions.
const WRITE_MEMORY: u64 = 4;

/// What a program has sent is remembered for so many frames, those that are counted again after a merge at most.
const SENT_MEMORY: u64 = 64;

/// An answer that is late meets one of so many requests after its own.
const FAILURE_MEMORY: u8 = 3;

/// A late answer comes within so many times as long as its master has waited for it.
const MOST_LATE: Ns = 2;

/// Runs of damage and noise are remembered until their transactions come.
const MAX_RUNS: usize = 1024;

/// Fewer bytes than these after a request are strays, not an answer.
pub(super) const LEAST_ANSWER_BYTES: u32 = 3;

/// What the frames before one tell of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Around {
    /// For damage or noise: who sent the good frame before, and its unit.
    pub attached: Option<(Direction, Option<u8>)>,
    /// The answer to the request before, or another request, in another framing.
    pub is_other_framing: bool,
    /// A request that the program received, although it sends requests itself.
    pub is_foreign: bool,
    /// A whole answer without a checksum, to a request that has one.
    pub is_bare_answer: bool,
    /// With it, the damage and noise between two good frames are more than strays; and whether that comes after a write.
    pub burst: Option<bool>,
    /// It begins with the unit and the function of the answer before.
    pub is_doubled: bool,
    /// After a request, a damaged answer is before it.
    pub is_behind_damage: bool,
    /// On Modbus/TCP, it is in the line or packet of the frame before, or begins as an answer to it with a wrong length.
    pub is_behind_header: bool,
    /// On a serial line, it is in the line of a whole answer whose sender is named, and does not begin with its unit.
    pub is_behind_answer: bool,
    /// Of a whole request: in its line, so many bytes of an idle line are in front of it, the first of which is this.
    pub idle_front: Option<Figures>,
}

/// A run of damaged frames and noise after a good frame.
#[derive(Clone, Debug, Default, PartialEq)]
struct BadRun {
    length: u32,
    bytes: Vec<u8>,
    /// Line or packet of its first byte, and of its last one.
    origins: [u64; 2],
    /// It belongs to the request after it.
    is_of_next: bool,
}

impl BadRun {
    /// Whether it is what a line leaves that nobody drives, all of it in this line.
    fn is_idle_in(&self, origin: u64) -> bool {
        let is_whole = self.length >= LEAST_ANSWER_BYTES && self.bytes.len() == self.length as usize;
        is_whole && origin != 0 && self.origins == [origin; 2] && self.bytes.iter().all(|byte| is_of_driver(*byte))
    }
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

/// The answer to the last request: it is whole, and came in time or before the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PreviousAnswer {
    pub bus: u32,
    pub unit: u8,
    pub place: Place,
    pub requested: Ns,
    pub came: Ns,
    /// What was asked, where it went well.
    pub key: Option<RequestKey>,
    /// From the end of the request to the start of the answer.
    pub response: Option<Ns>,
}

/// After so many requests that cannot be read, the one before is forgotten.
const MAX_AGE: usize = 8;

/// What the next rows need to know of those before.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Context {
    /// The last good frame.
    pub last_good: Option<GoodFrame>,
    /// Number of the last transaction of a frame.
    pub last_txn: u64,
    /// Damage and noise by the number of the good frame before.
    bad_runs: BTreeMap<u64, BadRun>,
    /// Unit and silence of the last transaction.
    previous: Option<(u8, bool)>,
    /// For so many further transactions, damage may be that of a late answer: one failed shortly before.
    after_failure: u8,
    /// Start of the request before, if the recording shows no answer to it.
    open_since: Option<Ns>,
    /// The answer before.
    pub previous_answer: Option<PreviousAnswer>,
    /// The last request that could be read, and whether it failed, or one since.
    previous_request: Option<PreviousRequest>,
    /// The last request that could be read, whether the recording shows what came of it or not.
    asked: Option<RequestKey>,
    /// The recording shows no answer to the last transaction.
    is_open: bool,
    /// Of the last two transactions, those without any answer: what was asked, and when.
    unanswered: [Option<(RequestKey, Ns)>; 2],
    /// Until when an answer may come to a request without any.
    late_until: Option<Ns>,
    /// The answer to it stops before its end, and lacks so many bytes.
    cut: Option<(RequestKey, u32)>,
    /// The last frame that the program says it sent: who sends such frames, and the number.
    sent: Option<(Direction, u64)>,
    /// The frame of the last answer, and the identifier of the last request.
    last_answer_frame: u64,
    last_id: Option<u16>,
    /// The last transactions.
    pub recent: RecentAnswers,
    /// The last transaction that stands shortly after one without an answer, by its number among the `recent` ones.
    behind_silence_until: u64,
    /// The last transaction that stands shortly after a write.
    behind_write_until: u64,
}

impl Context {
    /// Notes a frame, and gives what those before tell of it.
    pub fn frame(&mut self, seen: &FrameObservation) -> Around {
        self.last_txn = seen.txn.unwrap_or(self.last_txn);
        if seen.verdict.is_good() {
            let is_other_framing = self.last_good.is_some_and(|before| before.is_followed_in_another_framing(seen));
            let is_foreign = self.is_foreign(seen);
            self.note_sent(seen.side, seen.direction, seen.number);
            let idle_front = self.idle_front(seen);
            let sender = (seen.direction, seen.unit);
            let is_bare_answer = self.last_good.is_some_and(|before| before.is_answered_bare(seen.verdict, seen.mode, sender));
            let good = GoodFrame::after(self.last_good, seen.number, sender, seen.mode, seen.code, seen.write);
            self.last_good = Some(good.judged(seen.verdict).at(seen.origins[1], seen.side));
            return Around { is_other_framing, is_foreign, is_bare_answer, idle_front, ..Around::default() };
        }
        // What the sender of the request sends after it is no answer.
        let is_of_sender =
            |good: &GoodFrame| seen.side == Some(Side::Sent) && self.sent == Some((Direction::Request, good.number));
        let Some(good) = self.last_good.filter(|good| !is_of_sender(good)) else { return Around::default() };
        let run = self.bad_runs.entry(good.number).or_insert_with(|| BadRun { origins: seen.origins, ..BadRun::default() });
        let was_burst = run.length >= LEAST_ANSWER_BYTES;
        run.origins[1] = seen.origins[1];
        run.length += seen.length;
        run.bytes.extend_from_slice(&seen.bytes);
        let is_burst = run.length >= LEAST_ANSWER_BYTES && !was_burst;
        let is_behind_damage = was_burst && good.direction == Direction::Request;
        // What comes after the request of a write is its answer.
        let is_answer_to_write = good.since_write == 0 && good.direction == Direction::Request;
        let burst = is_burst.then_some(good.is_behind_write() && !is_answer_to_write);
        let is_doubled = is_burst
            && good.direction == Direction::Response
            && run.bytes.first() == good.unit.as_ref()
            && run.bytes.get(1).is_some_and(|code| Some(code & !EXCEPTION_BIT) == good.function);
        if self.bad_runs.len() > MAX_RUNS {
            self.bad_runs.pop_first();
        }
        let is_answer = good.direction == Direction::Request
            && matches!(seen.bytes[..], [_, _, 0, 0, _, _, unit, code, ..] if Some(unit) == good.unit && Some(code & !EXCEPTION_BIT) == good.function);
        let is_same_record = good.origin != 0 && good.origin == seen.origins[0];
        let is_behind_header = good.mode == Mode::Tcp && seen.verdict == Verdict::Noise && (is_same_record || is_answer);
        let is_behind_answer = good.mode == Mode::Rtu
            && is_same_record
            && good.direction == Direction::Response
            && seen.length >= LEAST_ANSWER_BYTES
            && seen.bytes.first() != good.unit.as_ref();
        let attached = Some((good.direction, good.unit));
        Around { attached, burst, is_doubled, is_behind_damage, is_behind_header, is_behind_answer, ..Around::default() }
    }

    /// The bytes of an idle line in front of a request, in its line and not in that of the request before: they are no answer to that.
    fn idle_front(&mut self, seen: &FrameObservation) -> Option<Figures> {
        let before = self.last_good.filter(|before| before.direction == Direction::Request && before.mode == Mode::Rtu)?;
        let is_of_other = before.side.zip(seen.side).is_some_and(|(one, other)| one != other);
        let is_apart = before.line != seen.origins[0] && !is_of_other && seen.direction == Direction::Request;
        let run = self.bad_runs.get_mut(&before.number).filter(|run| is_apart && run.is_idle_in(seen.origins[0]))?;
        run.is_of_next = true;
        Some([run.length, run.bytes[0].into()])
    }

    /// Notes who sends what the program says it has sent.
    #[inline]
    pub fn note_sent(&mut self, side: Option<Side>, direction: Direction, number: u64) {
        if side == Some(Side::Sent) {
            self.sent = Some((direction, number));
        }
    }

    /// Whether a good frame may be the request of another master.
    #[inline]
    pub fn may_be_foreign(&self, row: &Frame) -> bool {
        let is_received = row.side == Some(Side::Received) && row.direction == Direction::Request;
        is_received && self.sent.is_some_and(|(direction, _)| direction == Direction::Request)
    }

    /// Whether a request to read was received by a program that has sent a request a moment ago, and no echo of that.
    fn is_foreign(&self, seen: &FrameObservation) -> bool {
        let is_near = |number: u64| seen.number - number < SENT_MEMORY;
        let asks = self.sent.is_some_and(|(direction, number)| direction == Direction::Request && is_near(number));
        seen.side == Some(Side::Received) && asks && seen.is_read_request() && !seen.findings.has(Finding::LocalEcho)
    }

    /// An unanswered request after which an answer's worth of damage came was answered, if badly.
    pub fn complete(&self, seen: &mut Observation) {
        let Some(run) = self.bad_runs.get(&seen.request_frame).filter(|run| run.length >= LEAST_ANSWER_BYTES) else { return };
        if run.is_of_next {
            (seen.outcome, seen.damage, seen.is_cut) = (Outcome::NotSeen, None, false);
            return;
        }
        if seen.outcome == Outcome::Garbled {
            seen.lengths[1] = run.length;
            // What follows the frame may be the rest of it.
            if bare_refusals(&run.bytes).is_some() || is_doubled(&run.bytes) || run.bytes.starts_with(&seen.answer_head) {
                seen.answer_head.clone_from(&run.bytes);
            }
        }
        if !matches!(seen.outcome, Outcome::Silent | Outcome::NotSeen) {
            return;
        }
        // Where no clock shows that the master has waited, the export does not count the request as failed.
        if seen.outcome == Outcome::Silent {
            seen.outcome = Outcome::Garbled;
        }
        seen.answer_head.clone_from(&run.bytes);
        seen.damage = Some(response_part(&run.bytes, seen.unit, seen.function, &[]));
        let head = run.bytes.len().min(seen.request_head.len());
        // A header, a unit and a function are alike in a request and its answer.
        seen.is_own_echo = seen.id.is_none() && run.bytes[..head] == seen.request_head[..head];
        // The last byte or two may be missing.
        let is_as_long = (seen.lengths[0].saturating_sub(2)..=seen.lengths[0]).contains(&run.length);
        seen.altered_echo = Altered::of(&seen.request_head, &run.bytes).filter(|_| is_as_long);
        seen.lengths[1] = run.length;
    }

    /// What came before a request with this key, bus, start, and silence before it.
    pub fn before(&self, key: Option<RequestKey>, bus: u32, start: Option<Ns>, gap: Option<Ns>) -> Before {
        // A request sent again, and one after bytes that could not be read, say nothing about the order of requests.
        let is_repeated =
            self.previous_request.is_some_and(|before| before.age == 0 && !before.failed && Some(before.key) == key);
        let request = self.previous_request.filter(|before| before.age == 0 && Some(before.key) != key);
        let request = request.map(|before| (before.key.hash(), before.failed));
        let (written, overtaken) = (self.is_behind_write(), self.overtaken(bus, start));
        let asked = self.asked;
        let hasty = self.open_since.zip(start).map(|(open, start)| start - open);
        Before {
            previous: self.previous,
            failed: self.after_failure > 0,
            may_meet_late: start.zip(self.late_until).is_some_and(|(start, until)| start < until),
            written,
            request,
            is_repeated,
            overtaken,
            followed: self.followed(bus, key, start, gap),
            asked,
            id: self.last_id,
            is_open: self.is_open,
            cut: self.cut,
            hasty,
        }
    }

    /// Whether the answer before came after a request of the same connection with this start: its unit, its place, how long the
    /// master waited, and how long it would have had to. Programs on one computer wait each on its own connection.
    #[inline]
    pub fn overtaken(&self, bus: u32, start: Option<Ns>) -> Option<(u8, Place, Ns, Ns)> {
        let before = self.previous_answer.filter(|before| before.bus == bus);
        let (before, start) = before.zip(start).filter(|(before, start)| before.came > *start)?;
        Some((before.unit, before.place, start - before.requested, before.came - before.requested))
    }

    /// What follows the answer before, if a request with this key and start comes after it on the same connection: what was asked,
    /// in which transaction, and the times. `gap` is the silence before the next request.
    #[inline]
    pub fn followed(
        &self,
        bus: u32,
        key: Option<RequestKey>,
        start: Option<Ns>,
        gap: Option<Ns>,
    ) -> Option<(RequestKey, u64, Followed)> {
        let before = self.previous_answer.filter(|before| before.bus == bus)?;
        let start = start.filter(|start| *start >= before.came)?;
        let pause = gap.map_or(start - before.came, |gap| gap.clamp(0, start - before.came));
        let response = before.response.unwrap_or(before.came - before.requested).max(0);
        let is_repeated = before.key == key;
        let length = start - before.came - pause;
        Some((before.key?, before.place.number, Followed { response, length, pause, is_repeated }))
    }

    /// The request right before the next one, if nothing has failed there.
    #[inline]
    pub fn request_before(&self) -> Option<RequestKey> {
        self.previous.filter(|(_, was_silent)| !was_silent && self.after_failure == 0 && self.open_since.is_none())?;
        self.previous_request.filter(|before| before.age == 0).map(|before| before.key)
    }

    /// Whether the recording shows no answer to the last transaction.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Whether the next transaction stands shortly after a write.
    #[inline]
    pub fn is_behind_write(&self) -> bool {
        self.recent.next_number() <= self.behind_write_until
    }

    /// Compares a transaction with those before, and notes it.
    pub fn transaction(&mut self, seen: &mut Observation) {
        self.compare(seen);
        self.note_order(seen);
        self.note_unanswered(seen);
        if let (Outcome::Silent, Some(start), Some(waited)) = (seen.outcome, seen.starts[0], seen.waited) {
            self.late_until = Some(start + MOST_LATE * waited);
        }
        self.open_since = seen.starts[0].filter(|_| seen.outcome == Outcome::NotSeen);
        self.is_open = matches!(seen.outcome, Outcome::Silent | Outcome::NotSeen);
        self.cut = missing(seen);
        self.previous_answer = match (seen.outcome, seen.starts) {
            (Outcome::Good | Outcome::Refused, [Some(requested), Some(came)]) => {
                let key = seen.key().filter(|_| seen.outcome == Outcome::Good);
                let (bus, unit, place, response) = (seen.bus, seen.unit, seen.place, seen.response_time);
                Some(PreviousAnswer { bus, unit, place, requested, came, key, response })
            }
            _ => None,
        };
        if seen.outcome != Outcome::Unasked {
            self.asked = seen.key().or(self.asked);
        }
        if seen.outcome.counts() {
            self.previous = Some((seen.unit, seen.outcome == Outcome::Silent));
            self.after_failure = if seen.outcome.is_failure() { FAILURE_MEMORY } else { self.after_failure.saturating_sub(1) };
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
        if seen.writes {
            self.note_write();
        }
    }

    /// Notes a request without any answer, or that this one came for it: after the next request, whose answer it cannot be.
    fn note_unanswered(&mut self, seen: &mut Observation) {
        if seen.outcome.counts() {
            let asked = seen.key().zip(seen.starts[0]).filter(|_| seen.outcome == Outcome::Silent);
            let before = std::mem::replace(&mut self.unanswered[0], asked);
            let last = std::mem::replace(&mut self.unanswered[1], before);
            let is_of_another = seen.outcome == Outcome::Garbled && seen.findings.has(Finding::ResponseLength);
            if is_of_another {
                seen.belated = [before, last].into_iter().flatten().find_map(|asked| belated(seen, asked));
            } else if seen.outcome == Outcome::Garbled {
                seen.intruder = [before, last].into_iter().flatten().find_map(|asked| intruder(seen, asked));
            }
        } else if seen.outcome == Outcome::Unasked && seen.late_response_to.is_none() && seen.exception.is_none() {
            seen.belated = self.unanswered.into_iter().flatten().find_map(|asked| belated(seen, asked));
        }
    }

    /// Whether the last answer came after a request with this frame.
    #[inline]
    pub fn is_overtaken_by(&self, request: u64) -> bool {
        self.last_answer_frame > request
    }

    /// Passes an exchange that went well: the frame of its answer, and its identifier.
    #[inline]
    pub fn pass_frames(&mut self, answer: u64, id: Option<u16>) {
        (self.last_answer_frame, self.last_id) = (answer, id);
    }

    /// Notes whether the answer before came after this request.
    fn note_order(&mut self, seen: &mut Observation) {
        if seen.request_frame == 0 {
            return;
        }
        seen.is_step_behind =
            matches!(seen.outcome, Outcome::Good | Outcome::NotSeen) && self.is_overtaken_by(seen.request_frame);
        self.pass_frames(seen.response_frame, seen.id);
    }

    /// Notes that the last transaction is a write.
    #[inline]
    pub fn note_write(&mut self) {
        self.behind_write_until = self.recent.count() + WRITE_MEMORY;
    }

    /// Notes exchanges that went well, the last of which asked this; their data are already among the `recent` ones.
    #[inline]
    pub fn follow_clean(&mut self, key: RequestKey) {
        (self.previous, self.after_failure, self.is_open, self.cut) = (Some((key.unit, false)), 0, false, None);
        self.previous_request = Some(PreviousRequest { key, failed: false, age: 0 });
        self.asked = Some(key);
    }

    /// What the rows after a later part need to know.
    pub fn follow(&mut self, later: &Self, with_transactions: bool) {
        self.last_good = later.last_good.or(self.last_good);
        self.last_txn = later.last_txn.max(self.last_txn);
        self.sent = later.sent.or(self.sent);
        if with_transactions {
            self.after_failure = if later.previous.is_some() { later.after_failure } else { self.after_failure };
            self.previous = later.previous.or(self.previous);
            self.previous_request = later.previous_request.or(self.previous_request);
            self.asked = later.asked.or(self.asked);
            self.behind_write_until = later.behind_write_until;
            self.behind_silence_until = later.behind_silence_until;
            self.previous_answer = later.previous_answer;
            self.last_answer_frame = later.last_answer_frame;
            self.open_since = later.open_since;
            self.is_open = later.is_open;
            self.cut = later.cut;
            self.unanswered = later.unanswered;
            self.late_until = later.late_until.or(self.late_until);
            self.last_id = later.last_id.or(self.last_id);
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

/// How long after this request an answer came, if it fits it and not what it was taken for.
fn belated(seen: &Observation, (asked, start): (RequestKey, Ns)) -> Option<Ns> {
    let is_of_unit = (asked.unit, asked.function) == (seen.unit, seen.function) && seen.key() != Some(asked);
    let fits = answer_length(asked.function, asked.quantity) == Some(seen.lengths[1]);
    seen.starts[1].filter(|_| is_of_unit && fits && seen.id.is_none()).map(|came| came - start)
}

/// An earlier request, and how long after it an answer came, if a damaged answer begins as that to this request of another unit or
/// function.
fn intruder(seen: &Observation, (asked, start): (RequestKey, Ns)) -> Option<(RequestKey, Ns)> {
    let is_other = (asked.unit, asked.function) != (seen.unit, seen.function) && seen.id.is_none();
    let count = data_length(asked.function, asked.quantity)?;
    let begins = is_other && seen.answer_head.starts_with(&[asked.unit, asked.function, u8::try_from(count).ok()?]);
    seen.starts[1].filter(|_| begins).map(|came| (asked, came - start))
}

/// How many bytes an answer lacks that is right as far as it goes, and what it answers.
fn missing(seen: &Observation) -> Option<(RequestKey, u32)> {
    let is_right_so_far =
        seen.outcome == Outcome::Garbled && seen.is_cut && matches!(seen.damage, None | Some(DamagedPart::Inside));
    let key = seen.key().filter(|_| is_right_so_far)?;
    let missing = answer_length(key.function, key.quantity)?.checked_sub(seen.lengths[1])?;
    Some((key, missing))
}
