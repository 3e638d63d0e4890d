//! A line that is written down byte by byte, with the truth about it.

use crate::model::{Direction, Framing, Labels, Settings};
use crate::rng::Rng;
use crate::sim::case::{Case, CaseLine};
use crate::sim::damage::Damage;
use crate::sim::tap::{TapMode, TapRead};
use crate::sim::truth::TruthFrame;

/// A line as it grows.
pub struct Line {
    /// The source of chance.
    pub rng: Rng,
    name: &'static str,
    seed: u64,
    settings: Settings,
    bytes: Vec<u8>,
    times: Vec<i64>,
    now: f64,
    truth: Vec<TruthFrame>,
    txn: u32,
}

impl Line {
    /// An empty line; its settings are chosen by chance.
    pub fn new(name: &'static str, seed: u64) -> Self {
        let mut rng = Rng::new(seed, &format!("beyond {name}"));
        let baud = rng.pick(&[4800, 9600, 14_400, 19_200, 38_400, 57_600]);
        let settings = Settings { baud, data_bits: 8, has_even_parity: rng.chance(0.5) };
        let (bytes, times, truth) = (Vec::new(), Vec::new(), Vec::new());
        Self { rng, name, seed, settings, bytes, times, now: 2e9, truth, txn: 0 }
    }

    /// A request after a silence of so many ms; returns its transaction.
    pub fn ask(&mut self, silence_ms: f64, frame: &[u8]) -> u32 {
        self.txn += 1;
        let txn = self.txn;
        self.frame(silence_ms, frame, (Direction::Request, txn, true));
        txn
    }

    /// The response to a transaction after a silence of so many ms.
    pub fn answer(&mut self, silence_ms: f64, txn: u32, frame: &[u8]) {
        self.frame(silence_ms, frame, (Direction::Response, txn, true));
    }

    /// A response whose request the tap does not hear.
    pub fn answer_unheard(&mut self, silence_ms: f64, frame: &[u8]) {
        self.txn += 1;
        let txn = self.txn;
        self.answer(silence_ms, txn, frame);
    }

    /// A request, and its response.
    pub fn exchange(&mut self, pause_ms: f64, response_ms: f64, [request, response]: [&[u8]; 2]) {
        let txn = self.ask(pause_ms, request);
        self.answer(response_ms, txn, response);
    }

    /// Bytes of a damaged frame.
    pub fn damaged(&mut self, silence_ms: f64, direction: Direction, txn: u32, bytes: &[u8]) {
        self.frame(silence_ms, bytes, (direction, txn, false));
    }

    /// Replaces the bytes of the last frame, which the tap receives damaged.
    pub fn spoil_last(&mut self, bytes: &[u8]) {
        let frame = self.truth.last_mut().expect("a frame was sent");
        self.bytes[frame.start as usize..].copy_from_slice(bytes);
        frame.valid = false;
    }

    /// A frame of so many bytes after a silence, which the tap does not hear.
    pub fn unheard(&mut self, silence_ms: f64, bytes: usize) {
        self.silence(silence_ms);
        self.now += bytes as f64 * self.settings.char_ns();
    }

    /// The echo of a request by the adapter.
    pub fn echo(&mut self, silence_ms: f64, txn: u32, frame: &[u8]) {
        self.frame(silence_ms, frame, (Direction::Request, txn, true));
        self.truth.last_mut().expect("just added").echo = true;
    }

    /// Bytes that belong to no frame.
    pub fn noise(&mut self, silence_ms: f64, bytes: &[u8]) {
        self.silence(silence_ms);
        for &byte in bytes {
            self.byte(byte);
        }
    }

    /// A pause of so many ms inside the last frame, whose last `bytes` bytes come later by it.
    pub fn pause_inside(&mut self, bytes: usize, pause_ms: f64) {
        let from = self.times.len() - bytes;
        self.times[from..].iter_mut().for_each(|time| *time += (pause_ms * 1e6) as i64);
        self.now += pause_ms * 1e6;
    }

    fn silence(&mut self, silence_ms: f64) {
        self.now += silence_ms * 1e6;
    }

    fn byte(&mut self, byte: u8) {
        self.now += self.settings.char_ns();
        self.bytes.push(byte);
        self.times.push(self.now as i64);
    }

    fn frame(&mut self, silence_ms: f64, bytes: &[u8], (direction, txn, valid): (Direction, u32, bool)) {
        self.silence(silence_ms);
        let start = self.bytes.len() as u64;
        for &byte in bytes {
            self.byte(byte);
        }
        let end = self.bytes.len() as u64;
        let sent = RecordedFrame { start, end, direction, txn, valid, echo: false };
        self.truth.push(truth_of(&sent, &self.bytes));
    }

    /// The recording that a tap of this kind makes.
    pub fn tap(&self, mode: TapMode) -> Case {
        let mut rng = Rng::new(self.seed, &format!("beyond {} {}", self.name, mode.text()));
        let reads = mode.reads(&self.times, self.settings, &mut rng);
        let case = case(self.name.into(), self.settings, (self.bytes.clone(), reads), self.truth.clone());
        Case { seed: self.seed, mode, ..case }
    }
}

/// A frame that was sent, and its place.
pub struct RecordedFrame {
    /// Offset of its first byte.
    pub start: u64,
    /// Offset of the byte after its last one.
    pub end: u64,
    /// Request or response.
    pub direction: Direction,
    /// Number of the transaction.
    pub txn: u32,
    /// It is not damaged.
    pub valid: bool,
    /// An echo, whose direction is not scored.
    pub echo: bool,
}

/// Recorded bytes as a case.
pub fn recorded_case(name: String, settings: Settings, recorded: (Vec<u8>, Vec<TapRead>), frames: Vec<RecordedFrame>) -> Case {
    let truth = frames.iter().map(|frame| truth_of(frame, &recorded.0)).collect();
    case(name, settings, recorded, truth)
}

fn case(name: String, settings: Settings, (bytes, reads): (Vec<u8>, Vec<TapRead>), truth: Vec<TruthFrame>) -> Case {
    let lines = vec![CaseLine { id: 0, bytes, reads }];
    let (framing, losses) = (Framing::Rtu, Vec::new());
    Case { name, seed: 0, mode: TapMode::Exact, settings, framing, hides_framing: false, lines, truth, losses }
}

fn truth_of(frame: &RecordedFrame, bytes: &[u8]) -> TruthFrame {
    let bytes = &bytes[frame.start as usize..frame.end as usize];
    TruthFrame {
        line: 0,
        start: frame.start,
        end: frame.end,
        direction: frame.direction,
        unit: bytes[0],
        function: bytes.get(1).map_or(0, |code| code & 0x7F),
        exception: bytes.get(1).is_some_and(|code| code & 0x80 != 0),
        txn: frame.txn,
        alternative_txn: None,
        valid: frame.valid,
        is_unscored: false,
        is_undecided: false,
        echo: frame.echo,
        needs_no_pair: false,
        labels: Labels::default(),
        allowed_labels: Labels::default(),
        overlap_id: 0,
        damage: Damage::default(),
    }
}
