//! Lines that carry more than their own frames: constant payloads that hold valid frames, runs of one byte, spells of a wrong
//! baud rate or of another protocol, and another framing in front. Clean traffic is made first; these are put in between.

use crate::checksum::{ascii, rtu};
use crate::model::{Direction, Labels};
use crate::rng::Rng;
use crate::sim::case::Traffic;
use crate::sim::damage::Damage;
use crate::sim::look_alike::LookAlike;
use crate::sim::noise::{other_baud, some_exchanges};
use crate::sim::noise_signals::{floating, foreign_telegram, repeating_poll, runs, slow_squares};
use crate::sim::scenario::Scenario;
use crate::sim::truth::TruthFrame;

/// Bytes that are put in; a frame if it has a direction.
struct Piece {
    bytes: Vec<u8>,
    direction: Option<Direction>,
    /// The silence in front, in characters.
    silence: f64,
}

impl Piece {
    fn noise(bytes: Vec<u8>) -> Self {
        Self { bytes, direction: None, silence: 12.0 }
    }

    fn exchange(request: Vec<u8>, response: Vec<u8>, rng: &mut Rng) -> Vec<Self> {
        let silence = rng.uniform(4.0, 30.0);
        let request = Self { bytes: request, direction: Some(Direction::Request), silence: rng.uniform(8.0, 40.0) };
        vec![request, Self { bytes: response, direction: Some(Direction::Response), silence }]
    }
}

/// Clean traffic of a scenario with look-alikes of this kind in it.
pub(crate) fn traffic(kind: LookAlike, scenario: &Scenario, seed: u64, frames: usize) -> Traffic {
    let plain = Scenario { look_alike: None, ..scenario.clone() };
    let clean = Traffic::simulate(&plain, seed, frames);
    let mut rng = Rng::new(seed, scenario.name);
    let makers = Makers::new(kind, &clean, &mut rng);
    let mut mixed = Mixed::new(&clean);
    for piece in in_front(kind, &mut rng) {
        mixed.put(piece, &mut rng);
    }
    let mut last_txn = None;
    for frame in &clean.truth {
        let begins = frame.direction == Direction::Request && frame.labels == Labels::default() && last_txn != Some(frame.txn);
        if begins && last_txn.is_some() && rng.chance(kind.share()) {
            mixed.next_txn += 1;
            for piece in makers.pieces(kind, &mut rng) {
                mixed.put(piece, &mut rng);
            }
        }
        last_txn = Some(frame.txn);
        mixed.copy(&clean, frame);
    }
    mixed.finish(clean)
}

/// What the blocks are made of, which stays the same all over a recording.
struct Makers {
    /// The constant exchange.
    request: Vec<u8>,
    response: Vec<u8>,
    telegram: Vec<u8>,
    /// A poll received with a wrong baud rate.
    poll: Vec<u8>,
}

impl Makers {
    fn new(kind: LookAlike, clean: &Traffic, rng: &mut Rng) -> Self {
        let unit = clean.truth[rng.below(40)].unit.max(1);
        let inner = inner_frame(clean, unit, rng);
        let (request, response) = exchange(kind, unit, &inner, rng);
        let baud = other_baud(clean.settings.baud, rng);
        let poll = repeating_poll(&some_exchanges(clean, rng), clean.settings, baud, 600);
        let telegram = foreign_telegram(unit, rng);
        Self { request, response, telegram, poll: poll.into_iter().map(|(byte, _)| byte).collect() }
    }

    fn pieces(&self, kind: LookAlike, rng: &mut Rng) -> Vec<Piece> {
        let count = rng.range(30, 400);
        match kind {
            LookAlike::Runs => vec![Piece::noise(runs(rng, count))],
            LookAlike::Squares if rng.chance(0.5) => vec![Piece::noise(slow_squares(rng, count))],
            LookAlike::Squares => vec![Piece::noise(floating(rng, count))],
            LookAlike::WrongBaud => {
                let from = rng.below(self.poll.len().max(100) - 80);
                vec![Piece::noise(self.poll.iter().skip(from).take(count).copied().collect())]
            }
            LookAlike::Foreign => vec![Piece::noise(self.telegram.clone())],
            _ => Piece::exchange(self.request.clone(), self.response.clone(), rng),
        }
    }
}

/// What is in front of everything.
fn in_front(kind: LookAlike, rng: &mut Rng) -> Vec<Piece> {
    match kind {
        LookAlike::AsciiInFront => (0..3).map(|at| Piece::noise(ascii(at + 1, &[3, 0, rng.byte(), 0, 2], false))).collect(),
        LookAlike::MbapInFront => {
            (0..5u8).map(|at| Piece::noise(vec![0, at + 1, 0, 0, 0, 6, 1, 3, 0, rng.byte(), 0, 1 + at])).collect()
        }
        _ => Vec::new(),
    }
}

/// A frame that a payload holds: one of this bus, or one of another.
fn inner_frame(clean: &Traffic, unit: u8, rng: &mut Rng) -> Vec<u8> {
    let known = &clean.truth[rng.below(60)];
    match rng.below(5) {
        0 if known.end - known.start <= 60 => clean.lines[0].bytes[known.start as usize..known.end as usize].to_vec(),
        1 => rtu(unit, &[3, 2, rng.byte(), rng.byte()]),
        2 => rtu(unit, &[6, 0, rng.byte(), rng.byte(), rng.byte()]),
        3 => rtu(rng.range(1, 247) as u8, &[4, 0, rng.byte(), 0, rng.range(1, 20) as u8]),
        _ => rtu(unit, &[3, 0, rng.byte(), 0, rng.range(1, 20) as u8]),
    }
}

/// The constant request of this kind and its response; empty where the kind has none.
fn exchange(kind: LookAlike, unit: u8, inner: &[u8], rng: &mut Rng) -> (Vec<u8>, Vec<u8>) {
    let mut data: Vec<u8> = (0..rng.range(2, 9)).map(|_| rng.byte()).collect();
    data.extend(inner);
    data.extend((0..rng.range(2, 9)).map(|_| rng.byte()));
    data.resize(data.len().next_multiple_of(2), 0x5A);
    let (bytes, registers) = (data.len() as u8, data.len() as u8 / 2);
    let with = |head: &[u8]| rtu(unit, &[head, &data[..]].concat());
    match kind {
        LookAlike::FileWrite => {
            let write = with(&[21, bytes + 7, 6, 0, 4, 0, 7, 0, registers]);
            (write.clone(), write)
        }
        LookAlike::RegisterWrite => (with(&[16, 0, 100, 0, registers, bytes]), rtu(unit, &[16, 0, 100, 0, registers])),
        LookAlike::Loopback => {
            let loopback = with(&[8, 0, 0]);
            (loopback.clone(), loopback)
        }
        LookAlike::Vendor => (with(&[100]), rtu(unit, &[100, 0])),
        LookAlike::Read => (rtu(unit, &[3, 1, 0, 0, registers]), with(&[3, bytes])),
        _ => (Vec::new(), Vec::new()),
    }
}

/// The recording as it grows.
struct Mixed {
    bytes: Vec<u8>,
    times: Vec<i64>,
    truth: Vec<TruthFrame>,
    char_ns: f64,
    /// How many bytes and nanoseconds were put in.
    shift: (u64, i64),
    /// Bytes of the clean traffic that were copied.
    copied: usize,
    next_txn: u32,
}

impl Mixed {
    fn new(clean: &Traffic) -> Self {
        let next_txn = clean.truth.iter().map(|frame| frame.txn).max().unwrap_or(0) + 1;
        let (bytes, times, truth) = (Vec::new(), Vec::new(), Vec::new());
        Self { bytes, times, truth, char_ns: clean.settings.char_ns(), shift: (0, 0), copied: 0, next_txn }
    }

    fn put(&mut self, piece: Piece, rng: &mut Rng) {
        let begin = self.times.last().copied().unwrap_or(1_000_000_000);
        let mut now = begin as f64 + piece.silence * self.char_ns;
        let start = self.bytes.len() as u64;
        for byte in &piece.bytes {
            let is_paused = piece.direction.is_none() && rng.chance(0.05);
            now += (1.0 + if is_paused { rng.exponential(5.0) } else { 0.0 }) * self.char_ns;
            self.bytes.push(*byte);
            self.times.push(now.round() as i64);
        }
        self.shift = (self.shift.0 + piece.bytes.len() as u64, self.shift.1 + now as i64 - begin);
        let Some(direction) = piece.direction else { return };
        self.truth.push(TruthFrame {
            is_undecided: false,
            line: 0,
            start,
            end: self.bytes.len() as u64,
            direction,
            unit: piece.bytes[0],
            function: piece.bytes[1],
            exception: false,
            txn: self.next_txn,
            alternative_txn: None,
            valid: true,
            is_unscored: false,
            echo: false,
            needs_no_pair: false,
            labels: Labels::default(),
            allowed_labels: Labels::default(),
            overlap_id: 0,
            damage: Damage::default(),
        });
    }

    /// Copies the clean traffic up to the end of this frame.
    fn copy(&mut self, clean: &Traffic, frame: &TruthFrame) {
        self.copy_to(clean, frame.end as usize);
        self.truth.push(TruthFrame { start: frame.start + self.shift.0, end: frame.end + self.shift.0, ..frame.clone() });
    }

    fn copy_to(&mut self, clean: &Traffic, end: usize) {
        let line = &clean.lines[0];
        self.bytes.extend(&line.bytes[self.copied..end]);
        self.times.extend(line.times[self.copied..end].iter().map(|time| time + self.shift.1));
        self.copied = end;
    }

    fn finish(mut self, clean: Traffic) -> Traffic {
        self.copy_to(&clean, clean.lines[0].bytes.len());
        let mut traffic = clean;
        debug_assert!(self.shift.0 == 0 || traffic.losses.is_empty(), "places of losses are not moved");
        (traffic.lines[0].bytes, traffic.lines[0].times, traffic.truth) = (self.bytes, self.times, self.truth);
        traffic
    }
}
