//! A UART receiver over edges: start bit, data bits, parity, stop bit, each sampled in its middle.

use std::collections::VecDeque;

use crate::logic::edges::Edge;
use modlens_protocol::line::{Line, Parity};

/// A character off the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Character {
    /// The sample at which its start bit begins.
    pub start: f64,
    /// The sample at which its last stop bit ends.
    pub end: f64,
    /// Its data bits.
    pub byte: u8,
    /// The stop bit was not there.
    pub framing_error: bool,
    /// The parity bit was not right.
    pub parity_error: bool,
}

impl Character {
    /// Whether the receiver would mark it.
    pub fn marked(&self) -> bool {
        self.framing_error || self.parity_error
    }
}

/// A receiver of one channel.
#[derive(Debug)]
pub struct UartReceiver {
    line: Line,
    /// Samples a bit.
    bit: f64,
    /// The idle level is low.
    inverted: bool,
    /// EdgeDetector that are still needed, oldest first.
    edges: VecDeque<Edge>,
    /// The level before the oldest of them.
    level: Option<bool>,
    /// No start bit is looked for before here.
    from: f64,
}

impl UartReceiver {
    /// A receiver with these settings, for so many samples a second.
    pub fn new(line: Line, rate: f64, inverted: bool) -> Self {
        Self { bit: rate / f64::from(line.baud), line, inverted, edges: VecDeque::new(), level: None, from: 0.0 }
    }

    /// A change of the channel.
    pub fn edge(&mut self, edge: Edge) {
        self.edges.push_back(Edge { high: edge.high != self.inverted, ..edge });
    }

    /// The next character that is whole when the channel is known up to `now`.
    pub fn next(&mut self, now: u64) -> Option<Character> {
        let bits = 1 + u32::from(self.line.data_bits) + u32::from(self.line.parity != Parity::None);
        let start = self.start_bit()?;
        // The middle of the stop bit says whether it is there.
        let middle = start + (f64::from(bits) + 0.5) * self.bit;
        if middle >= now as f64 {
            return None;
        }
        let mut levels = (1..=bits).map(|bit| self.at(start + (f64::from(bit) + 0.5) * self.bit));
        let mut byte = 0u8;
        for bit in 0..self.line.data_bits {
            byte |= u8::from(levels.next()?) << bit;
        }
        let odd = byte.count_ones() % 2 == 1;
        let parity_error = match self.line.parity {
            Parity::None => false,
            Parity::Even => levels.next()? != odd,
            Parity::Odd => levels.next()? == odd,
            Parity::Mark => !levels.next()?,
            Parity::Space => levels.next()?,
        };
        drop(levels);
        let framing_error = !self.at(middle);
        // A second stop bit is silence to a receiver; the character's end counts it.
        let end = start + (f64::from(bits) + f64::from(self.line.stop_halves) / 2.0) * self.bit;
        self.from = middle;
        if framing_error {
            self.wait_for_idle(middle);
        }
        self.forget();
        Some(Character { start, end, byte, framing_error, parity_error })
    }

    /// Where the next start bit begins: the change to low behind `from`.
    fn start_bit(&self) -> Option<f64> {
        let mut level = self.level;
        for edge in &self.edges {
            // The first sample of a channel is no edge, unless the line idles before it.
            if !edge.high && edge.sample as f64 >= self.from && level == Some(true) {
                return Some(edge.sample as f64);
            }
            level = Some(edge.high);
        }
        None
    }

    /// The level at a place.
    fn at(&self, place: f64) -> bool {
        let mut level = self.level.unwrap_or(true);
        for edge in &self.edges {
            if edge.sample as f64 > place {
                break;
            }
            level = edge.high;
        }
        level
    }

    /// After a break the line has to be idle before a start bit can begin.
    fn wait_for_idle(&mut self, from: f64) {
        let idle = self.edges.iter().find(|edge| edge.high && edge.sample as f64 >= from);
        self.from = idle.map_or(from, |edge| edge.sample as f64);
    }

    fn forget(&mut self) {
        while self.edges.front().is_some_and(|edge| (edge.sample as f64) < self.from) {
            self.level = self.edges.pop_front().map(|edge| edge.high);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// EdgeDetector of characters as a transmitter makes them, bit by bit.
    fn sent(line: Line, rate: f64, inverted: bool, bytes: &[(u8, f64)]) -> (Vec<Edge>, u64) {
        let bit = rate / f64::from(line.baud);
        let (mut edges, mut level, mut at) = (vec![Edge { sample: 0, high: !inverted }], true, 10.0 * bit);
        for (byte, pause) in bytes {
            let mut bits = vec![false];
            bits.extend((0..line.data_bits).map(|n| byte >> n & 1 == 1));
            let odd = byte.count_ones() % 2 == 1;
            match line.parity {
                Parity::None => {}
                Parity::Even => bits.push(odd),
                Parity::Odd => bits.push(!odd),
                Parity::Mark | Parity::Space => unreachable!("not tried here"),
            }
            bits.push(true);
            for high in bits {
                if high != level {
                    edges.push(Edge { sample: at.ceil() as u64, high: high != inverted });
                    level = high;
                }
                at += bit;
            }
            at += pause * bit;
        }
        (edges, at as u64 + 100)
    }

    #[test]
    fn what_was_sent_is_received() {
        let bytes: Vec<(u8, f64)> = (0..=255u8).map(|byte| (byte & 0x7F, f64::from(byte % 3) * 0.4)).collect();
        for settings in ["9600-8N1", "19200-8E1", "115200-8O1", "4800-7E1"] {
            let line: Line = settings.parse().unwrap();
            for (rate, inverted) in [(1e6, false), (1e6, true), (4e6, false)] {
                let (edges, now) = sent(line, rate, inverted, &bytes);
                let mut uart = UartReceiver::new(line, rate, inverted);
                for edge in edges {
                    uart.edge(edge);
                }
                let found: Vec<Character> = std::iter::from_fn(|| uart.next(now)).collect();
                assert_eq!(
                    found.iter().map(|it| it.byte).collect::<Vec<_>>(),
                    bytes.iter().map(|it| it.0).collect::<Vec<_>>(),
                    "{settings}"
                );
                assert!(!found.iter().any(Character::marked));
            }
        }
    }

    #[test]
    fn wrong_parity_and_a_break_are_marked() {
        let even: Line = "9600-8E1".parse().unwrap();
        let (edges, now) = sent("9600-8O1".parse().unwrap(), 1e6, false, &[(0x55, 5.0)]);
        let mut uart = UartReceiver::new(even, 1e6, false);
        for edge in edges {
            uart.edge(edge);
        }
        assert!(uart.next(now).unwrap().parity_error);
        let mut uart = UartReceiver::new("9600-8N1".parse().unwrap(), 1e6, false);
        for (sample, high) in [(0, true), (1000, false), (9000, true)] {
            uart.edge(Edge { sample, high });
        }
        assert!(uart.next(20_000).unwrap().framing_error);
        assert_eq!(uart.next(20_000), None, "one break, one character");
    }
}
