//! Troubles of a line that is listened to, as events: one begins, changes, or ends.
//!
//! A tap runs for months, so the counters of all that was ever seen do not show what is wrong now. The counters are kept in
//! slices of [`SLICE`], newer ones alone, older ones merged by twos, so that a few slices reach back for hours ([`Slices`]).
//! Every slice, the doctor judges the last slice, the last two, the last four and so on: a dead unit shows in the shortest
//! window, one lost request in a thousand only in a long one.
//!
//! **No flapping.** A trouble begins when two judgements in a row diagnose it, with a chance below [`BEGIN_CHANCE`]: about ten
//! thousand windows are judged in a day, so the chance of a single report would be too great; and its last failure must not be long
//! ago. It ends when, for [`HOLD`] judgements in a row, no window about as long as that in which it began diagnoses it (chance below [`crate::MAX_CHANCE`]), and its failures do
//! not go on in a longer one. One that returns within [`MEMORY`] is held twice as long each time. Another severity, or another
//! cause for the same failures, is a change, which has to hold as well. While nothing is asked, nothing is judged.
//!
//! All times are those of the rows.

mod json;
mod slices;

use std::collections::BTreeMap;

use modlens_engine::records::{Batch, Connection, DiagnosisRow};
use modlens_protocol::finding::Severity;
use modlens_protocol::Ns;

use crate::report::{Course, Report, UNEXPLAINED};
use crate::statistics::Share;
use crate::table::diagnosis;
use slices::Slices;
pub use slices::SLICE;

/// A trouble begins where its chance is below this.
pub const BEGIN_CHANCE: f64 = 1e-8;
/// A trouble ends after so many judgements without it: a minute.
pub const HOLD: u32 = 6;
/// A trouble that has ended is remembered for so long.
pub const MEMORY: Ns = 3600 * 1_000_000_000;
/// A trouble that returns is held at most so many times as long.
const MOST_HOLDS: u32 = 32;
/// Judgements in a row that begin or change a trouble.
const CONFIRMED: u32 = 2;
/// Events that nobody takes are kept up to this number; the oldest go first.
const MOST_EVENTS: usize = 4096;

/// What happened to a trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// It has begun.
    Begin,
    /// It has another severity, or another cause explains the same failures.
    Change,
    /// It is over.
    End,
}

impl Change {
    /// The word in JSON.
    pub fn text(self) -> &'static str {
        match self {
            Self::Begin => "begin",
            Self::Change => "change",
            Self::End => "end",
        }
    }
}

/// One event, with the evidence of the moment.
#[derive(Clone, Debug)]
pub struct Event {
    /// When it was decided, on the clock of the rows.
    pub time: Ns,
    /// What happened.
    pub change: Change,
    /// The trouble.
    pub trouble: Trouble,
    /// The cause that it had before, if that has changed.
    pub was: Option<&'static str>,
}

/// A trouble that has begun and is not over.
#[derive(Clone, Debug)]
pub struct Trouble {
    /// Its number, from 1.
    pub number: u64,
    /// What the doctor said of it last.
    pub row: DiagnosisRow,
    /// The first failure.
    pub since: Ns,
    /// The last failure.
    pub until: Ns,
    /// Requests that failed in it while it was open, of all in the window.
    pub share: Share,
    /// Windows of slices up to 2 to the power of this show it.
    scale: u32,
    /// Judgements in a row without it.
    missing: u32,
    /// It ends after so many of them.
    hold: u32,
    /// Judgements in a row with another severity.
    other_severity: u32,
}

/// Whose trouble: bus, unit, client.
type Subject = (String, Option<u8>, Option<String>);
/// Whose trouble, and which.
type Key = (Subject, &'static str);

/// What a judgement found of a trouble.
struct Sight {
    row: DiagnosisRow,
    course: Course,
    scale: u32,
    /// Its chance is small enough to begin a trouble.
    is_sure: bool,
}

/// Watches a line.
#[derive(Clone, Debug, Default)]
pub struct Events {
    slices: Slices,
    now: Option<Ns>,
    open: BTreeMap<Key, Trouble>,
    /// Troubles that one judgement has shown.
    shown: BTreeMap<Key, u32>,
    /// Those whose troubles are over: when, and how long they were held.
    past: BTreeMap<Subject, (Ns, u32)>,
    numbers: u64,
    waiting: Vec<Event>,
}

impl Events {
    /// Counts the rows of a batch, which has frames and transactions, and judges where a slice is over.
    pub fn observe(&mut self, batch: &Batch) {
        self.observe_with(batch, Vec::new);
    }

    /// The same with the connections that are open; asked for where a slice is over, after the rows of the batch.
    pub fn observe_with(&mut self, batch: &Batch, open: impl FnOnce() -> Vec<Connection>) {
        let transactions = batch.transactions.iter().filter_map(|row| row.start);
        let connections = batch.connections.iter().filter_map(|row| row.closed.or(row.begun));
        let times = transactions.chain(batch.frames.iter().filter_map(|row| row.start)).chain(connections);
        let Some(now) = times.max() else { return };
        let before = self.now.replace(now);
        // A clock that was set back begins again at once; nothing is judged twice.
        let is_over = self.slices.is_over(before.unwrap_or(now), now);
        self.slices.observe(batch, now);
        if is_over {
            self.slices.observe_open(&open(), now);
            self.slices.close(now);
            self.judge(now);
        }
    }

    /// The events since the last call.
    pub fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.waiting)
    }

    /// The troubles that are open, by bus and unit.
    pub fn open(&self) -> impl Iterator<Item = &Trouble> {
        self.open.values()
    }

    fn judge(&mut self, now: Ns) {
        let sights = self.sights(now);
        self.past.retain(|_, (ended, _)| now - *ended < MEMORY);
        for (key, trouble) in &mut self.open {
            let all = sights.get(key).map_or(&[][..], Vec::as_slice);
            let near = all.iter().filter(|sight| sight.scale <= trouble.scale + 1);
            trouble.until = near.filter_map(|sight| sight.course.last).fold(trouble.until, Ns::max);
            let Some(seen) = all.iter().find(|sight| trouble.is_seen_in(sight, now)) else {
                trouble.missing += 1;
                continue;
            };
            if let Some(change) = trouble.see(seen) {
                self.waiting.push(Event { time: now, change, trouble: trouble.clone(), was: None });
            }
        }
        self.shown.retain(|key, _| sights.get(key).is_some_and(|all| all.iter().any(|sight| sight.is_sure)));
        for (key, all) in &sights {
            if let Some(seen) = all.iter().find(|sight| sight.is_sure && !self.is_told(key)) {
                let shown = self.shown.entry(key.clone()).or_default();
                *shown += 1;
                if *shown >= CONFIRMED {
                    self.shown.remove(key);
                    let (key, seen) = likeliest(&sights, key).unwrap_or((key, seen));
                    self.begin(key, seen, now);
                }
            } else if let Some(seen) = all.iter().find(|sight| !sight.course.has_ended && self.lacks_cause(key)) {
                self.begin(key, seen, now);
            }
        }
        self.end(now);
        let surplus = self.waiting.len().saturating_sub(MOST_EVENTS);
        self.waiting.drain(..surplus);
    }

    /// What the windows show, by trouble; the shortest window first.
    fn sights(&self, now: Ns) -> BTreeMap<Key, Vec<Sight>> {
        let mut found: BTreeMap<Key, Vec<Sight>> = BTreeMap::new();
        let mut longest = 0;
        for (scale, contrast) in self.slices.windows() {
            longest = scale;
            for (row, course) in Report::of(contrast).troubles() {
                if row.certainty == "diagnosed" && row.severity != Severity::Info {
                    let key = ((row.bus.clone(), row.unit, row.client.clone()), row.code);
                    let is_sure = row.chance.is_none_or(|chance| chance < BEGIN_CHANCE);
                    let mut sight = Sight { row: row.clone(), course: course.clone(), scale, is_sure };
                    // Where nobody tries again, nothing goes well after the last failure, but time passes.
                    sight.is_sure &= !sight.course.has_ended && !sight.has_ceased(now);
                    found.entry(key).or_default().push(sight);
                }
            }
        }
        // Who never answers in the last minute may have answered before it.
        found.retain(|(_, code), all| *code != NEVER || all.last().is_some_and(|sight| sight.scale == longest));
        found
    }

    /// Whether a trouble is open already, or another cause for the same failures of the same subject.
    fn is_told(&self, key: &Key) -> bool {
        let is_settled = |other: &Key, one: &Trouble| !one.is_nearly_over() && (other.1 != UNEXPLAINED || !self.lacks_cause(key));
        self.open.iter().any(|(other, one)| other == key || (is_settled(other, one) && are_related(other, key)))
    }

    /// Whether the subject of this cause has a trouble whose cause is not known yet. That it has one is sure, so the chance of
    /// any diagnosis is small enough to name its cause.
    fn lacks_cause(&self, (subject, code): &Key) -> bool {
        *code != UNEXPLAINED && self.open.contains_key(&(subject.clone(), UNEXPLAINED))
    }

    fn begin(&mut self, key: &Key, seen: &Sight, now: Ns) {
        // Another cause may explain from now on what one did that is no longer seen.
        let other = self.open.iter().find(|(other, _)| are_related(other, key));
        if let Some(other) = other.map(|(other, _)| other.clone()) {
            let mut trouble = self.open.remove(&other).expect("just found");
            (trouble.scale, trouble.missing) = (seen.scale, 0);
            trouble.show(seen);
            self.waiting.push(Event { time: now, change: Change::Change, trouble: trouble.clone(), was: Some(other.1) });
            self.open.insert(key.clone(), trouble);
            return;
        }
        self.numbers += 1;
        let hold = self.past.get(&key.0).map_or(1, |(_, hold)| (hold * 2).min(MOST_HOLDS));
        let since = seen.course.first.unwrap_or(now);
        let mut trouble = Trouble {
            number: self.numbers,
            row: seen.row.clone(),
            since,
            until: since,
            share: Share::default(),
            scale: seen.scale,
            missing: 0,
            hold,
            other_severity: 0,
        };
        trouble.show(seen);
        self.waiting.push(Event { time: now, change: Change::Begin, trouble: trouble.clone(), was: None });
        self.open.insert(key.clone(), trouble);
    }

    fn end(&mut self, now: Ns) {
        let over = self.open.iter().filter(|(_, trouble)| trouble.missing >= HOLD * trouble.hold);
        for key in over.map(|(key, _)| key.clone()).collect::<Vec<_>>() {
            let trouble = self.open.remove(&key).expect("just found");
            self.past.insert(key.0, (now, trouble.hold));
            self.waiting.push(Event { time: now, change: Change::End, trouble, was: None });
        }
    }
}

impl Sight {
    /// Whether its failures have times, and are over by these.
    fn has_ceased(&self, now: Ns) -> bool {
        self.course.first.is_some() && self.course.last.is_some() && !self.is_going_on(now)
    }

    /// Whether the last failure is no longer ago than its failures mostly are apart, many times over.
    fn is_going_on(&self, now: Ns) -> bool {
        let (Some(first), Some(last)) = (self.course.first, self.course.last) else { return false };
        let apart = (last - first) / i64::try_from(self.row.failed.max(2) - 1).unwrap_or(i64::MAX);
        now - last < (2 * SLICE).max(APART * apart)
    }
}

/// Failures that come at random are so many times as long apart as mostly once in a thousand times.
const APART: i64 = 7;

/// A unit that never answers: a claim about all of a recording, whatever a window shows.
const NEVER: &str = "dead_unit_cost";
/// Two causes that show the same symptom in such shares of their failures explain the same failures.
const MUCH: f64 = 0.3;

/// The cause that a window names for a subject whose trouble no other window explains.
fn likeliest<'a>(sights: &'a BTreeMap<Key, Vec<Sight>>, (subject, code): &Key) -> Option<(&'a Key, &'a Sight)> {
    let causes = sights.iter().filter(|((other, _), _)| *code == UNEXPLAINED && other == subject);
    let going_on = causes.filter(|((_, cause), _)| *cause != UNEXPLAINED);
    let going_on = going_on.filter_map(|(key, all)| Some((key, all.iter().find(|sight| !sight.course.has_ended)?)));
    going_on.min_by(|(_, one), (_, other)| one.row.chance.unwrap_or(1.0).total_cmp(&other.row.chance.unwrap_or(1.0)))
}

/// Whether two troubles are causes for the same failures of one subject.
fn are_related(one: &Key, other: &Key) -> bool {
    let symptoms = |key: &Key| diagnosis(key.1).map(|cause| cause.symptoms.iter().filter(|(_, share)| *share >= MUCH));
    let (Some(mut own), Some(others)) = (symptoms(one), symptoms(other)) else {
        // What no cause explains.
        return one.0 == other.0;
    };
    one.0 == other.0 && own.any(|(symptom, _)| others.clone().any(|(same, _)| same == symptom))
}

impl Trouble {
    /// Whether it ends with the next judgement without it.
    fn is_nearly_over(&self) -> bool {
        self.missing + CONFIRMED >= HOLD * self.hold
    }

    /// Whether a window shows that it goes on: one that is not much longer than that in which it began, or one whose failures
    /// have not ceased.
    fn is_seen_in(&self, sight: &Sight, now: Ns) -> bool {
        !sight.course.has_ended && (sight.scale <= self.scale + 1 || sight.is_going_on(now))
    }

    /// Takes what a judgement shows; gives the change, if it is one.
    fn see(&mut self, seen: &Sight) -> Option<Change> {
        self.missing = 0;
        if seen.row.severity == self.row.severity {
            self.other_severity = 0;
            self.show(seen);
            return None;
        }
        self.other_severity += 1;
        // Less severe in one window is not better yet: the change is held as long as an end.
        let enough = if seen.row.severity == Severity::Error { CONFIRMED } else { HOLD * self.hold };
        (self.other_severity >= enough).then(|| {
            self.other_severity = 0;
            self.show(seen);
            Change::Change
        })
    }

    fn show(&mut self, seen: &Sight) {
        self.until = seen.course.last.unwrap_or(self.until).max(self.until);
        self.share = Share { failed: seen.row.failed, total: seen.row.total };
        self.row = seen.row.clone();
    }
}
