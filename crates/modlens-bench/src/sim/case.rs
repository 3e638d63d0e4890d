//! Traffic (what happened on the bus) and cases (what a tap made of it).

use std::collections::HashSet;

use crate::model::{Framing, Label, Settings};
use crate::rng::Rng;
use crate::sim::master::Play;
use crate::sim::scenario::Scenario;
use crate::sim::tap::{Read, TapMode};
use crate::sim::truth::{truth, Loss, TruthFrame};

/// One line as the tap heard it.
#[derive(Clone, Debug)]
pub struct TrafficLine {
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub id: u8,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// When each one's last stop bit ended, in ns.
    pub times: Vec<i64>,
}

/// What happened on the bus: the same for every tap.
#[derive(Clone, Debug)]
pub struct Traffic {
    /// The scenario's name.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Settings of the line.
    pub settings: Settings,
    /// RTU or ASCII.
    pub framing: Framing,
    /// The lines.
    pub lines: Vec<TrafficLine>,
    /// What was sent.
    pub truth: Vec<TruthFrame>,
    /// Where bytes are missing.
    pub losses: Vec<Loss>,
}

/// One line of a case.
#[derive(Clone, Debug)]
pub struct CaseLine {
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub id: u8,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// How they came.
    pub reads: Vec<Read>,
}

/// What an algorithm gets, and the truth that it is measured by.
#[derive(Clone, Debug)]
pub struct Case {
    /// The scenario's name.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// How the bytes were tapped.
    pub mode: TapMode,
    /// Settings of the line.
    pub settings: Settings,
    /// RTU or ASCII.
    pub framing: Framing,
    /// The lines.
    pub lines: Vec<CaseLine>,
    /// What was sent.
    pub truth: Vec<TruthFrame>,
    /// Where bytes are missing.
    pub losses: Vec<Loss>,
}

/// One read, as an algorithm is fed.
#[derive(Clone, Copy, Debug)]
pub struct Feed<'a> {
    /// Which line.
    pub line: u8,
    /// Offset of the first byte in the line's stream.
    pub offset: u64,
    /// The bytes.
    pub bytes: &'a [u8],
    /// When the read returned, in ns.
    pub time: Option<i64>,
}

impl Traffic {
    /// Plays a scenario until `frames` frames were sent.
    pub fn new(scenario: &Scenario, seed: u64, frames: usize) -> Self {
        let play = Play::new(scenario, seed, frames);
        let (truth, losses) = truth(&play.wire, scenario.framing);
        let two = play.wire.lines.len() == 2;
        let lines = play.wire.lines.iter().enumerate().map(|(at, bytes)| {
            let heard = bytes.iter().filter(|byte| !byte.lost);
            let (bytes, times) = heard.map(|byte| (byte.value, byte.time)).unzip();
            TrafficLine { id: if two { at as u8 + 1 } else { 0 }, bytes, times }
        });
        Self {
            name: scenario.name.into(),
            seed,
            settings: play.settings(),
            framing: scenario.framing,
            lines: lines.collect(),
            truth,
            losses,
        }
    }

    /// What this tap makes of it.
    pub fn tap(&self, mode: TapMode) -> Case {
        let lines = self.lines.iter().map(|line| {
            let mut rng = Rng::new(self.seed, &format!("{} {} {}", self.name, mode.text(), line.id));
            let reads = mode.reads(&line.times, self.settings, &mut rng);
            CaseLine { id: line.id, bytes: line.bytes.clone(), reads }
        });
        let orderless = self.lines.len() == 2 && mode == TapMode::None;
        Case {
            name: self.name.clone(),
            seed: self.seed,
            mode,
            settings: self.settings,
            framing: self.framing,
            lines: lines.collect(),
            truth: if orderless { without_order(&self.truth) } else { self.truth.clone() },
            losses: self.losses.clone(),
        }
    }

    /// Bytes on all lines.
    pub fn len(&self) -> usize {
        self.lines.iter().map(|line| line.bytes.len()).sum()
    }

    /// Whether nothing was heard.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What can be said where nothing tells the order of two lines: the same request twice on one of them and two answers on
/// the other are two exchanges, or a retry and a late answer.
fn without_order(truth: &[TruthFrame]) -> Vec<TruthFrame> {
    let late = truth.iter().filter(|frame| frame.labels.contains(Label::Late));
    let pairs: HashSet<(u32, u32)> = late.filter_map(|frame| Some((frame.alt_txn?, frame.txn))).collect();
    let open = |frame: &TruthFrame, label| match label {
        Label::Late => frame.alt_txn.is_some_and(|old| pairs.contains(&(old, frame.txn))),
        Label::NoResponse => pairs.iter().any(|&(old, _)| old == frame.txn),
        Label::Retry => pairs.iter().any(|&(_, now)| now == frame.txn),
        _ => false,
    };
    let mut truth = truth.to_vec();
    for frame in &mut truth {
        for label in [Label::Late, Label::NoResponse, Label::Retry] {
            if open(frame, label) {
                frame.labels.remove(label);
                frame.maybe.insert(label);
            }
        }
    }
    truth
}

impl Case {
    /// The reads of all lines in the order of time.
    pub fn feeds(&self) -> impl Iterator<Item = Feed<'_>> {
        let mut next = vec![(0usize, 0usize); self.lines.len()];
        std::iter::from_fn(move || {
            let ready = (0..self.lines.len()).filter(|&at| next[at].0 < self.lines[at].reads.len());
            let at = ready.min_by_key(|&at| self.lines[at].reads[next[at].0].order)?;
            let line = &self.lines[at];
            let (number, offset) = next[at];
            let read = line.reads[number];
            let end = offset + read.length as usize;
            next[at] = (number + 1, end);
            Some(Feed { line: line.id, offset: offset as u64, bytes: &line.bytes[offset..end], time: read.time })
        })
    }

    /// The bytes of one line.
    pub fn bytes(&self, line: u8) -> &[u8] {
        self.lines.iter().find(|other| other.id == line).map_or(&[], |line| &line.bytes)
    }

    /// When the read came that carried this byte.
    pub fn read_times(&self, line: u8) -> ReadTimes<'_> {
        let reads = self.lines.iter().find(|other| other.id == line).map_or(&[][..], |line| &line.reads);
        ReadTimes { reads, end: 0, time: None }
    }
}

/// Looks up times of reads; offsets must not go back.
#[derive(Clone, Debug)]
pub struct ReadTimes<'a> {
    reads: &'a [Read],
    end: u64,
    time: Option<i64>,
}

impl ReadTimes<'_> {
    /// The time of the read that carried this byte.
    pub fn at(&mut self, offset: u64) -> Option<i64> {
        while offset >= self.end {
            let (read, rest) = self.reads.split_first()?;
            self.end += u64::from(read.length);
            self.time = read.time;
            self.reads = rest;
        }
        self.time
    }
}
