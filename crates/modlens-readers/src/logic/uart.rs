//! A UART receiver that works on edges. It samples start bit, data bits, parity bit and stop bit in their middle.

use std::collections::VecDeque;

use crate::logic::edges::Edge;
use modlens_protocol::line::{LineSettings, Parity};

/// A received character.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Character {
    /// The sample at which its start bit begins.
    pub start: f64,
    /// The sample at which its last stop bit ends.
    pub end: f64,
    /// The data bits.
    pub byte: u8,
    /// The stop bit was missing.
    pub has_framing_error: bool,
    /// The parity bit was wrong.
    pub has_parity_error: bool,
}

impl Character {
    /// Whether a receiver would report an error for it.
    pub fn has_error(&self) -> bool {
        self.has_framing_error || self.has_parity_error
    }
}

/// The receiver of one channel.
#[derive(Debug)]
pub struct UartReceiver {
    line: LineSettings,
    /// Samples per bit.
    samples_per_bit: f64,
    /// The idle level is low.
    inverted: bool,
    /// Edges that are still needed, oldest first.
    edges: VecDeque<Edge>,
    /// The level before the oldest of these edges.
    level: Option<bool>,
    /// The sample before which no start bit can begin.
    from: f64,
}

impl UartReceiver {
    /// A receiver with these settings, for `rate` samples per second.
    pub fn new(line: LineSettings, rate: f64, inverted: bool) -> Self {
        Self { samples_per_bit: rate / f64::from(line.baud), line, inverted, edges: VecDeque::new(), level: None, from: 0.0 }
    }

    /// Takes a level change of the channel.
    pub fn push_edge(&mut self, edge: Edge) {
        self.edges.push_back(Edge { is_high: edge.is_high != self.inverted, ..edge });
    }

    /// The next character that is complete if the levels are known up to the sample `now`; `None` if there is none.
    pub fn next(&mut self, now: u64) -> Option<Character> {
        let bits = 1 + u32::from(self.line.data_bits) + u32::from(self.line.parity != Parity::None);
        let start = self.start_bit()?;
        // A character ends in the middle of its stop bit, where a receiver checks it.
        let middle = start + (f64::from(bits) + 0.5) * self.samples_per_bit;
        if middle >= now as f64 {
            return None;
        }
        let mut levels = (1..=bits).map(|bit| self.level_at(start + (f64::from(bit) + 0.5) * self.samples_per_bit));
        let mut byte = 0u8;
        for bit in 0..self.line.data_bits {
            byte |= u8::from(levels.next()?) << bit;
        }
        let odd = byte.count_ones() % 2 == 1;
        let has_parity_error = match self.line.parity {
            Parity::None => false,
            Parity::Even => levels.next()? != odd,
            Parity::Odd => levels.next()? == odd,
            Parity::Mark => !levels.next()?,
            Parity::Space => levels.next()?,
        };
        drop(levels);
        let has_framing_error = !self.level_at(middle);
        // A receiver does not wait for a second stop bit, but the time at which the character ends includes it.
        let end = start + (f64::from(bits) + f64::from(self.line.half_stop_bits) / 2.0) * self.samples_per_bit;
        self.from = middle;
        if has_framing_error {
            self.wait_for_idle(middle);
        }
        self.drop_old_edges();
        Some(Character { start, end, byte, has_framing_error, has_parity_error })
    }

    /// The sample at which the next start bit begins: the first change from high to low at or after `from`.
    fn start_bit(&self) -> Option<f64> {
        let mut level = self.level;
        for edge in &self.edges {
            // A channel that is low at its first sample has no known start, so the line has to be high before a start bit.
            if !edge.is_high && edge.sample as f64 >= self.from && level == Some(true) {
                return Some(edge.sample as f64);
            }
            level = Some(edge.is_high);
        }
        None
    }

    /// The level at a sample.
    fn level_at(&self, sample: f64) -> bool {
        let mut level = self.level.unwrap_or(true);
        for edge in &self.edges {
            if edge.sample as f64 > sample {
                break;
            }
            level = edge.is_high;
        }
        level
    }

    /// After a missing stop bit or a break the line has to be high before a start bit can begin.
    fn wait_for_idle(&mut self, from: f64) {
        let idle = self.edges.iter().find(|edge| edge.is_high && edge.sample as f64 >= from);
        self.from = idle.map_or(from, |edge| edge.sample as f64);
    }

    /// Drops edges that are no longer needed.
    fn drop_old_edges(&mut self) {
        while self.edges.front().is_some_and(|edge| (edge.sample as f64) < self.from) {
            self.level = self.edges.pop_front().map(|edge| edge.is_high);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edges of characters as a transmitter makes them, bit by bit, and the number of samples.
    fn sent(line: LineSettings, rate: f64, inverted: bool, bytes: &[(u8, f64)]) -> (Vec<Edge>, u64) {
        let bit = rate / f64::from(line.baud);
        let (mut edges, mut level, mut at) = (vec![Edge { sample: 0, is_high: !inverted }], true, 10.0 * bit);
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
            for is_high in bits {
                if is_high != level {
                    edges.push(Edge { sample: at.ceil() as u64, is_high: is_high != inverted });
                    level = is_high;
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
            let line: LineSettings = settings.parse().unwrap();
            for (rate, inverted) in [(1e6, false), (1e6, true), (4e6, false)] {
                let (edges, now) = sent(line, rate, inverted, &bytes);
                let mut uart = UartReceiver::new(line, rate, inverted);
                for edge in edges {
                    uart.push_edge(edge);
                }
                let found: Vec<Character> = std::iter::from_fn(|| uart.next(now)).collect();
                assert_eq!(
                    found.iter().map(|it| it.byte).collect::<Vec<_>>(),
                    bytes.iter().map(|it| it.0).collect::<Vec<_>>(),
                    "{settings}"
                );
                assert!(!found.iter().any(Character::has_error));
            }
        }
    }

    #[test]
    fn wrong_parity_and_a_break_are_errors() {
        let even: LineSettings = "9600-8E1".parse().unwrap();
        let (edges, now) = sent("9600-8O1".parse().unwrap(), 1e6, false, &[(0x55, 5.0)]);
        let mut uart = UartReceiver::new(even, 1e6, false);
        for edge in edges {
            uart.push_edge(edge);
        }
        assert!(uart.next(now).unwrap().has_parity_error);
        let mut uart = UartReceiver::new("9600-8N1".parse().unwrap(), 1e6, false);
        for (sample, is_high) in [(0, true), (1000, false), (9000, true)] {
            uart.push_edge(Edge { sample, is_high });
        }
        assert!(uart.next(20_000).unwrap().has_framing_error);
        assert_eq!(uart.next(20_000), None, "one break, one character");
    }
}
