//! The line as the tap records it: every character with its time and the frame that it belongs to.

use crate::model::{Direction, Framing, Settings};
use crate::rng::Rng;
use crate::sim::damage::{Damage, DamagedTransmission, Slot};
use crate::sim::scenario::Scenario;

/// The owner of a character that belongs to no frame.
pub(crate) const NO_FRAME: u32 = u32::MAX;

/// The clock at the start of the simulation. It is not 0, because no real capture starts at 0.
const START_NS: f64 = 1e9;

/// One character.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Byte {
    /// When its last stop bit ended, in ns.
    pub(crate) time: i64,
    /// Index of its frame, or `NO_FRAME`.
    pub(crate) owner: u32,
    /// Its position in the frame.
    pub(crate) index: u16,
    /// Its value as recorded.
    pub(crate) value: u8,
    /// The tap does not deliver it.
    pub(crate) lost: bool,
}

/// Why a frame was sent. The numbers are indices of other frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FrameRole {
    Request,
    /// A repetition of this request.
    Retry(usize),
    /// The request of a second master while this request waits for its response.
    Intruder(usize),
    /// This request, as the adapter's own receiver has picked it up.
    Echo(usize),
    /// The response to this request.
    Response(usize),
    /// The response to this request, but from another unit.
    WrongUnit(usize),
    /// A repetition of this response.
    Duplicate(usize),
    /// The response to `old`, which had timed out; it arrives after the retry `now`.
    Late {
        old: usize,
        now: usize,
    },
}

impl FrameRole {
    /// The earlier frame to which this one refers; they share a transaction unless this one is a request.
    pub(crate) fn earlier(self) -> Option<usize> {
        match self {
            Self::Request => None,
            Self::Retry(frame)
            | Self::Intruder(frame)
            | Self::Echo(frame)
            | Self::Response(frame)
            | Self::WrongUnit(frame)
            | Self::Duplicate(frame)
            | Self::Late { now: frame, .. } => Some(frame),
        }
    }
}

/// What came of a request. The number is the index of the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RequestOutcome {
    /// No response is expected.
    NoResponseExpected,
    /// There was no response.
    NoResponse,
    /// There was a response.
    Response(usize),
    /// Another unit has responded.
    WrongUnit,
}

/// A frame as it was sent.
#[derive(Clone, Debug)]
pub(crate) struct SentFrame {
    pub(crate) wire: Vec<u8>,
    /// Index of the line: 0 for requests, 1 for responses if they have a line of their own.
    pub(crate) line: usize,
    pub(crate) direction: Direction,
    pub(crate) unit: u8,
    /// Function code as sent.
    pub(crate) code: u8,
    pub(crate) txn: u32,
    pub(crate) role: FrameRole,
    pub(crate) outcome: RequestOutcome,
    pub(crate) damage: Damage,
    /// Number of the overlap of two masters' transactions that it is part of, from 1; 0 for none.
    pub(crate) overlap_id: u32,
}

/// The line, or the two lines.
#[derive(Debug)]
pub(crate) struct Wire {
    pub(crate) lines: Vec<Vec<Byte>>,
    pub(crate) frames: Vec<SentFrame>,
    mask: u8,
    char_ns: f64,
    now: f64,
}

impl Wire {
    pub(crate) fn new(settings: Settings, scenario: &Scenario) -> Self {
        let lines = if scenario.two_lines { 2 } else { 1 };
        Self {
            lines: vec![Vec::new(); lines],
            frames: Vec::new(),
            // Only a noisy ASCII line shows values with bit 7 set.
            mask: if scenario.framing == Framing::Ascii && scenario.noise_gap == 0.0 { 0x7F } else { 0xFF },
            char_ns: settings.char_ns(),
            now: START_NS,
        }
    }

    /// Sends a frame after this silence in ns; returns whether its receiver can read it.
    pub(crate) fn transmit(&mut self, silence: f64, mut sent: SentFrame, scenario: &Scenario, rng: &mut Rng) -> bool {
        let owner = self.frames.len() as u32;
        sent.line = sent.line.min(self.lines.len() - 1);
        let line = sent.line;
        let begin = self.now + silence;
        if rng.chance(scenario.noise_gap) {
            self.noise_in_silence(line, silence, rng);
        }
        self.now = self.now.max(begin);
        let damaged = DamagedTransmission::new(&sent.wire, scenario, rng);
        for slot in &damaged.slots {
            self.put(line, owner, slot);
        }
        if rng.chance(scenario.pause) {
            self.pause(line, owner, rng);
        }
        sent.damage = damaged.damage;
        self.frames.push(sent);
        !damaged.is_damaged_on_line
    }

    fn put(&mut self, line: usize, owner: u32, slot: &Slot) {
        self.now += (slot.gap + 1.0) * self.char_ns;
        let (owner, index) = slot.index.map_or((NO_FRAME, 0), |index| (owner, index));
        let time = self.now.round() as i64;
        self.lines[line].push(Byte { time, owner, index, value: slot.value, lost: slot.lost });
    }

    /// Puts 1 to 4 random bytes into the silence before a frame.
    fn noise_in_silence(&mut self, line: usize, silence: f64, rng: &mut Rng) {
        let from = self.now;
        let mut places: Vec<f64> = (0..rng.range(1, 4)).map(|_| from + rng.uniform(0.0, silence)).collect();
        places.sort_by(f64::total_cmp);
        for place in places {
            // `put` adds the character itself.
            self.now = self.now.max(place - self.char_ns);
            let value = rng.byte() & self.mask;
            self.put(line, NO_FRAME, &Slot::stray(value));
        }
    }

    /// Inserts a long pause into the frame that was just put on the line.
    fn pause(&mut self, line: usize, owner: u32, rng: &mut Rng) {
        let bytes = &mut self.lines[line];
        let first = bytes.iter().rposition(|byte| byte.owner != owner).map_or(0, |last| last + 1);
        if first + 1 < bytes.len() {
            let length = rng.uniform(0.05, 0.95) * 1e9;
            let at = rng.range(first + 1, bytes.len() - 1);
            bytes[at..].iter_mut().for_each(|byte| byte.time += length as i64);
            self.now += length;
        }
    }

    /// Puts 60 to 600 bytes of noise on the line.
    pub(crate) fn storm(&mut self, rng: &mut Rng) {
        let kind = rng.weighted(&[2, 1, 1, 1]);
        for _ in 0..rng.range(60, 600) {
            let value = match kind {
                1 if rng.chance(0.97) => 0x00,
                2 if rng.chance(0.97) => 0xFF,
                3 => [0x00, 0xFF, 0xFE, 0x80, 0x01, 0x03, rng.byte()][rng.below(7)],
                _ => rng.byte(),
            };
            let gap = if rng.chance(0.1) { rng.exponential(5.0) } else { 0.0 };
            self.put(0, NO_FRAME, &Slot { gap, ..Slot::stray(value & self.mask) });
        }
    }

    /// Loses bytes in the tap at so many places.
    pub(crate) fn cut(&mut self, places: usize, rng: &mut Rng) {
        for _ in 0..places {
            let total: usize = self.lines.iter().map(Vec::len).sum();
            let mut at = rng.below(total);
            let (low, high) = rng.pick(&[(1, 1), (2, 2), (5, 5), (1, 60), (1, 400)]);
            let length = rng.range(low, high);
            for line in &mut self.lines {
                if at < line.len() {
                    let end = (at + length).min(line.len());
                    line[at..end].iter_mut().for_each(|byte| byte.lost = true);
                    break;
                }
                at -= line.len();
            }
        }
    }

    /// Drops the beginning of the capture, up to the middle of one of the first frames.
    pub(crate) fn start_in_the_middle(&mut self, rng: &mut Rng) {
        let frame = rng.below(5.min(self.frames.len()));
        let sent = &mut self.frames[frame];
        let middle = (sent.wire.len() / 2) as u16;
        let line = sent.line;
        let Some(byte) = self.lines[line].iter().find(|byte| byte.owner == frame as u32 && byte.index >= middle) else {
            return;
        };
        sent.damage.midstart = true;
        let start = byte.time;
        self.lines.iter_mut().for_each(|line| line.retain(|byte| byte.time >= start));
    }
    /// Removes the frames of the other direction: the tap does not hear them.
    pub(crate) fn keep_only(&mut self, direction: Direction) {
        let frames = &self.frames;
        let is_heard = |byte: &Byte| frames.get(byte.owner as usize).is_none_or(|frame| frame.direction == direction);
        self.lines.iter_mut().for_each(|line| line.retain(|byte| is_heard(byte)));
    }
}
