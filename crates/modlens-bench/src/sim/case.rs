//! Traffic, which is what happened on the bus, and cases, which are what a tap has recorded of it.

use std::collections::HashSet;

use crate::model::{Framing, Label, Settings};
use crate::rng::Rng;
use crate::sim::master::Simulation;
use crate::sim::scenario::Scenario;
use crate::sim::tap::{TapMode, TapRead};
use crate::sim::truth::{truth, Loss, TruthFrame};
use crate::sim::undecided::mark_undecided;

/// The bytes of one line.
#[derive(Clone, Debug)]
pub struct TrafficLine {
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub id: u8,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// When the last stop bit of each byte ended, in ns.
    pub times: Vec<i64>,
}

/// What happened on the bus, which is the same for every tap.
#[derive(Clone, Debug)]
pub struct Traffic {
    /// The scenario's name.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// The scenario.
    scenario: Scenario,
    /// Settings of the line.
    pub settings: Settings,
    /// RTU or ASCII.
    pub framing: Framing,
    /// The analyzer has to find the framing.
    pub hides_framing: bool,
    /// The lines.
    pub lines: Vec<TrafficLine>,
    /// The frames that were sent.
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
    /// The reads in which they were delivered.
    pub reads: Vec<TapRead>,
}

/// The input of an algorithm, with the truth by which it is scored.
#[derive(Clone, Debug)]
pub struct Case {
    /// The scenario's name.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// The kind of tap.
    pub mode: TapMode,
    /// Settings of the line.
    pub settings: Settings,
    /// RTU or ASCII.
    pub framing: Framing,
    /// The analyzer has to find the framing.
    pub hides_framing: bool,
    /// The lines.
    pub lines: Vec<CaseLine>,
    /// The frames that were sent.
    pub truth: Vec<TruthFrame>,
    /// Where bytes are missing.
    pub losses: Vec<Loss>,
}

/// One read, as it is fed to an algorithm.
#[derive(Clone, Copy, Debug)]
pub struct TimedRead<'a> {
    /// The line: 0 for the only one, 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// Offset of the first byte in the line's stream.
    pub offset: u64,
    /// The bytes.
    pub bytes: &'a [u8],
    /// When the read returned, in ns.
    pub time: Option<i64>,
}

impl Traffic {
    /// Simulates a scenario, without the look-alikes that it may have, until `frames` frames were sent.
    pub(super) fn simulate(scenario: &Scenario, seed: u64, frames: usize) -> Self {
        let simulation = Simulation::new(scenario, seed, frames);
        let (truth, losses) = truth(&simulation.wire, scenario.framing);
        let two = simulation.wire.lines.len() == 2;
        let lines = simulation.wire.lines.iter().enumerate().map(|(at, bytes)| {
            let delivered = bytes.iter().filter(|byte| !byte.lost);
            let (bytes, times) = delivered.map(|byte| (byte.value, byte.time)).unzip();
            TrafficLine { id: if two { at as u8 + 1 } else { 0 }, bytes, times }
        });
        Self {
            name: scenario.name.into(),
            seed,
            settings: simulation.settings(),
            scenario: scenario.clone(),
            framing: scenario.framing,
            hides_framing: false,
            lines: lines.collect(),
            truth,
            losses,
        }
    }

    /// The recording that a tap of this kind makes.
    pub fn tap(&self, mode: TapMode) -> Case {
        let lines = self.lines.iter().map(|line| {
            let mut rng = Rng::new(self.seed, &format!("{} {} {}", self.name, mode.text(), line.id));
            let reads = mode.reads(&line.times, self.settings, &mut rng);
            CaseLine { id: line.id, bytes: line.bytes.clone(), reads }
        });
        let orderless = self.lines.len() == 2 && mode == TapMode::None;
        let mut truth = if orderless { without_order(&self.truth) } else { self.truth.clone() };
        mark_undecided(&mut truth, &self.lines[0].bytes, &self.scenario, mode);
        Case {
            name: self.name.clone(),
            seed: self.seed,
            mode,
            settings: self.settings,
            framing: self.framing,
            hides_framing: self.hides_framing,
            lines: lines.collect(),
            truth,
            losses: self.losses.clone(),
        }
    }

    /// The number of bytes on all lines.
    pub fn len(&self) -> usize {
        self.lines.iter().map(|line| line.bytes.len()).sum()
    }

    /// Whether there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The truth for two lines without times, where the order of frames on different lines is unknown. The same request twice on
/// one line and two responses on the other may be two transactions, or a retry and a late response, so labels that would
/// decide this are only allowed.
fn without_order(truth: &[TruthFrame]) -> Vec<TruthFrame> {
    let late = truth.iter().filter(|frame| frame.labels.contains(Label::Late));
    let pairs: HashSet<(u32, u32)> = late.filter_map(|frame| Some((frame.alternative_txn?, frame.txn))).collect();
    let open = |frame: &TruthFrame, label| match label {
        Label::Late => frame.alternative_txn.is_some_and(|old| pairs.contains(&(old, frame.txn))),
        Label::NoResponse => pairs.iter().any(|&(old, _)| old == frame.txn),
        Label::Retry => pairs.iter().any(|&(_, now)| now == frame.txn),
        _ => false,
    };
    let mut truth = truth.to_vec();
    for frame in &mut truth {
        for label in [Label::Late, Label::NoResponse, Label::Retry] {
            if open(frame, label) {
                frame.labels.remove(label);
                frame.allowed_labels.insert(label);
            }
        }
    }
    truth
}

impl Case {
    /// The reads of all lines in the order of time.
    pub fn timed_reads(&self) -> impl Iterator<Item = TimedRead<'_>> {
        let mut next = vec![(0usize, 0usize); self.lines.len()];
        std::iter::from_fn(move || {
            let ready = (0..self.lines.len()).filter(|&at| next[at].0 < self.lines[at].reads.len());
            let at = ready.min_by_key(|&at| self.lines[at].reads[next[at].0].order)?;
            let line = &self.lines[at];
            let (number, offset) = next[at];
            let read = line.reads[number];
            let end = offset + read.length as usize;
            next[at] = (number + 1, end);
            Some(TimedRead { line: line.id, offset: offset as u64, bytes: &line.bytes[offset..end], time: read.time })
        })
    }

    /// The bytes of one line.
    pub fn bytes(&self, line: u8) -> &[u8] {
        self.lines.iter().find(|other| other.id == line).map_or(&[], |line| &line.bytes)
    }

    /// The times of the reads of a line, by the offset of a byte.
    pub fn read_times(&self, line: u8) -> ReadTimes<'_> {
        let reads = self.lines.iter().find(|other| other.id == line).map_or(&[][..], |line| &line.reads);
        ReadTimes { reads, end: 0, time: None }
    }
}

/// Looks up the times of reads; the offsets of successive calls must not decrease.
#[derive(Clone, Debug)]
pub struct ReadTimes<'a> {
    reads: &'a [TapRead],
    end: u64,
    time: Option<i64>,
}

impl ReadTimes<'_> {
    /// The time of the read that delivered the byte at this offset.
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
