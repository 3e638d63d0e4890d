//! Clean mixed traffic in bulk, for measurements of speed: a poll list of 120 entries on ten slaves, and 15 % writes.
//!
//! Function codes 3/4/1/2/5/6/15/16/23 make 56/14/6/9/2.5/5/1/5/1 % of the requests, 1 % of the responses are exceptions,
//! and 0.5 % of the requests have no response. A frame has 28 bytes and a read 26 registers on average.

use crate::checksum::rtu;
use crate::model::{Direction, Framing, Settings};
use crate::rng::Rng;
use crate::sim::case::{Case, CaseLine};
use crate::sim::damage::Damage;
use crate::sim::reads::body;
use crate::sim::registers::content;
use crate::sim::requests::mask_padding;
use crate::sim::tap::{TapMode, TapRead};
use crate::sim::truth::TruthFrame;

/// The settings of the line from which the times follow.
pub const LINE: Settings = Settings { baud: 115_200, data_bits: 8, has_even_parity: true };

/// Numbers of registers per read, 26 on average.
const REGISTERS: [u16; 10] = [1, 2, 4, 8, 10, 20, 30, 40, 60, 85];

/// Numbers of coils or inputs per read.
const BITS: [u16; 8] = [8, 16, 32, 64, 128, 400, 800, 1000];

/// One frame of bulk traffic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BulkFrame {
    /// Offset in the stream.
    pub start: u64,
    /// The number of bytes.
    pub length: u16,
    /// Request or response.
    pub direction: Direction,
    /// It is not damaged.
    pub valid: bool,
    /// Number of its transaction.
    pub txn: u32,
    /// When its last byte ended on the line, in ns.
    pub end_ns: i64,
}

/// Bulk traffic with its frames and counts.
#[derive(Clone, Debug, Default)]
pub struct Bulk {
    /// The bytes.
    pub bytes: Vec<u8>,
    /// The frames.
    pub frames: Vec<BulkFrame>,
    /// The number of requests.
    pub transactions: u64,
    /// The number of exception responses.
    pub exceptions: u64,
    /// The number of requests without response.
    pub timeouts: u64,
    /// The number of registers in read responses.
    pub registers_read: u64,
}

/// An endless source of bulk traffic.
#[derive(Clone, Debug)]
pub struct Mixed {
    rng: Rng,
    /// One bit is flipped in 0.2 % of the frames, and 0.1 % have stray bytes in front.
    dirty: bool,
    poll: Vec<(u8, Vec<u8>)>,
    turn: usize,
    offset: u64,
    txn: u32,
    now: f64,
}

impl Mixed {
    /// The traffic of this seed.
    pub fn new(seed: u64, dirty: bool) -> Self {
        let mut rng = Rng::new(seed, "bulk");
        let poll = (0..120u16).map(|at| {
            let function = [3, 4, 1, 2][rng.weighted(&[56, 14, 6, 9])];
            let quantity = if function > 2 { rng.pick(&REGISTERS) } else { rng.pick(&BITS) };
            (at as u8 % 10 + 1, body(function, &[at * 100, quantity]))
        });
        let poll = poll.collect();
        Self { rng, dirty, poll, turn: 0, offset: 0, txn: 0, now: 1e9 }
    }

    /// Appends about so many bytes; offsets, transactions and times continue where the last call ended.
    pub fn more(&mut self, bytes: usize, into: &mut Bulk) {
        let end = into.bytes.len() + bytes;
        while into.bytes.len() < end {
            self.transaction(into);
        }
    }

    /// A case without times that has so many bytes.
    pub fn case(seed: u64, bytes: usize, dirty: bool) -> Case {
        let mut bulk = Bulk::default();
        Self::new(seed, dirty).more(bytes, &mut bulk);
        bulk.into_case(seed)
    }

    /// Appends a request and its response, if there is one.
    fn transaction(&mut self, into: &mut Bulk) {
        self.txn += 1;
        into.transactions += 1;
        let (unit, request) = self.request();
        self.frame(Direction::Request, unit, &request, 2e6, into);
        if self.rng.chance(0.005) {
            into.timeouts += 1;
            self.now += 250e6;
            return;
        }
        let answer = if self.rng.chance(0.01) {
            into.exceptions += 1;
            vec![request[0] | 0x80, self.rng.pick(&[1, 2, 3, 4, 6])]
        } else {
            let answer = self.answer(&request);
            if matches!(request[0], 3 | 4 | 23) {
                into.registers_read += u64::from(answer[1]) / 2;
            }
            answer
        };
        self.frame(Direction::Response, unit, &answer, 3e6, into);
    }

    /// A random request: mostly the next one of the poll list, otherwise a write.
    fn request(&mut self) -> (u8, Vec<u8>) {
        // The weights are in units of 0.5 %: 85.5 % are reads of the poll list, the others functions 5, 6, 15, 16 and 23.
        let kind = self.rng.weighted(&[171, 5, 10, 2, 10, 2]);
        if kind == 0 {
            self.turn += 1;
            return self.poll[self.turn % self.poll.len()].clone();
        }
        let unit = self.rng.range(1, 10) as u8;
        let address = self.rng.range(0, 2000) as u16;
        let pdu = match kind {
            1 => body(5, &[address, self.rng.pick(&[0, 0xFF00])]),
            2 => body(6, &[address, self.rng.range(0, 5000) as u16]),
            3 => {
                let count = self.rng.range(1, 32) as u16;
                let mut data = content(usize::from(count).div_ceil(8), false, &mut self.rng);
                mask_padding(&mut data, count);
                [body(15, &[address, count]), vec![data.len() as u8], data].concat()
            }
            4 => {
                let count = self.rng.range(1, 20) as u16;
                let data = content(2 * usize::from(count), false, &mut self.rng);
                [body(16, &[address, count]), vec![data.len() as u8], data].concat()
            }
            _ => {
                let (read, write) = (self.rng.pick(&REGISTERS), self.rng.range(1, 10) as u16);
                let data = content(2 * usize::from(write), false, &mut self.rng);
                [body(23, &[address, read, address, write]), vec![data.len() as u8], data].concat()
            }
        };
        (unit, pdu)
    }

    fn answer(&mut self, request: &[u8]) -> Vec<u8> {
        let count = u16::from_be_bytes([request[3], request[4]]);
        match request[0] {
            1 | 2 => {
                let mut data = content(usize::from(count).div_ceil(8), false, &mut self.rng);
                mask_padding(&mut data, count);
                [vec![request[0], data.len() as u8], data].concat()
            }
            3 | 4 | 23 => {
                let data = content(2 * usize::from(count), false, &mut self.rng);
                [vec![request[0], data.len() as u8], data].concat()
            }
            _ => request[..5].to_vec(),
        }
    }

    /// Appends a frame after a silence in ns, with the damage of dirty traffic.
    fn frame(&mut self, direction: Direction, unit: u8, pdu: &[u8], silence: f64, into: &mut Bulk) {
        let mut wire = rtu(unit, pdu);
        let flipped = self.dirty && self.rng.chance(0.002);
        if flipped {
            let at = self.rng.below(wire.len());
            wire[at] ^= 1 << self.rng.below(8);
        }
        if self.dirty && self.rng.chance(0.001) {
            let strays = self.rng.range(1, 8);
            into.bytes.extend((0..strays).map(|_| self.rng.byte()));
            self.offset += strays as u64;
        }
        self.now += silence + wire.len() as f64 * LINE.char_ns();
        into.frames.push(BulkFrame {
            start: self.offset,
            length: wire.len() as u16,
            direction,
            valid: !flipped,
            txn: self.txn,
            end_ns: self.now as i64,
        });
        self.offset += wire.len() as u64;
        into.bytes.extend(wire);
    }
}

impl Bulk {
    /// Converts the traffic to a case without times.
    pub fn into_case(self, seed: u64) -> Case {
        let truth = self.frames.iter().map(|frame| {
            let bytes = &self.bytes[frame.start as usize..];
            TruthFrame {
                is_undecided: false,
                line: 0,
                start: frame.start,
                end: frame.start + u64::from(frame.length),
                direction: frame.direction,
                unit: bytes[0],
                function: bytes[1] & 0x7F,
                exception: bytes[1] & 0x80 != 0,
                txn: frame.txn,
                alternative_txn: None,
                valid: frame.valid,
                is_unscored: false,
                echo: false,
                needs_no_pair: false,
                labels: crate::model::Labels::default(),
                allowed_labels: crate::model::Labels::default(),
                overlap_id: 0,
                damage: Damage { flip: !frame.valid, ..Damage::default() },
            }
        });
        let truth = truth.collect();
        let blocks = self.bytes.chunks(4096).enumerate();
        let reads = blocks.map(|(at, block)| TapRead { time: None, length: block.len() as u32, order: at as i64 });
        let reads = reads.collect();
        Case {
            name: "bulk".into(),
            seed,
            mode: TapMode::None,
            settings: LINE,
            framing: Framing::Rtu,
            hides_framing: false,
            lines: vec![CaseLine { id: 0, bytes: self.bytes, reads }],
            truth,
            losses: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mix_is_that_of_the_yardstick() {
        let mut bulk = Bulk::default();
        Mixed::new(1, false).more(4_000_000, &mut bulk);
        let per_frame = bulk.bytes.len() as f64 / bulk.frames.len() as f64;
        let per_read = bulk.registers_read as f64 / bulk.transactions as f64;
        println!("{per_frame} bytes a frame, {per_read} registers a transaction");
        assert!((25.0..32.0).contains(&per_frame), "{per_frame}");
        assert!((15.0..22.0).contains(&per_read), "{per_read}");
        assert!((bulk.exceptions as f64 / bulk.transactions as f64 - 0.01).abs() < 0.002);
        assert!((bulk.timeouts as f64 / bulk.transactions as f64 - 0.005).abs() < 0.001);
    }

    #[test]
    fn pieces_are_the_whole() {
        let (mut whole, mut first, mut second) = (Bulk::default(), Bulk::default(), Bulk::default());
        Mixed::new(2, true).more(60_000, &mut whole);
        let mut mixed = Mixed::new(2, true);
        mixed.more(20_000, &mut first);
        mixed.more(10_000, &mut second);
        let at = first.bytes.len();
        assert_eq!(second.bytes, whole.bytes[at..at + second.bytes.len()]);
        assert_eq!(second.frames[0].start, at as u64);
        assert!(whole.frames.iter().filter(|frame| frame.valid).all(|frame| {
            let start = frame.start as usize;
            crate::checksum::crc_fits(&whole.bytes[start..start + usize::from(frame.length)])
        }));
    }
}
