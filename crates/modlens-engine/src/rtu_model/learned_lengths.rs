//! Lengths of functions without public layout, as this line has shown them.
//!
//! Vendors' frames mostly have one length per direction, or begin with a count of the bytes that follow. Once that has been
//! seen, a length is evidence as good as a layout's, and it distinguishes requests from responses.

use crate::rtu_model::log2::log2;
use crate::weights::{HALVE_LENGTHS_FRAMES, LENGTH_DISCOUNT_FRAMES, LENGTH_PRIOR_FRAMES, OPEN_LENGTH_BITS};

/// Different lengths that are remembered of one function in one direction.
const REMEMBERED_LENGTHS: usize = 4;

/// What was seen of one function in one direction.
#[derive(Clone, Copy, Default)]
struct LengthCounts {
    frames: f32,
    /// Frames whose body begins with a count of the bytes that follow.
    counted: f32,
    /// The other frames by length of the body, the most frequent length first and the latest newcomer last.
    lengths: [(u16, f32); REMEMBERED_LENGTHS],
}

/// What was seen of all functions.
pub struct LearnedLengths {
    /// By direction and function code, without the exception bit.
    counts: Box<[[LengthCounts; 128]; 2]>,
}

impl Default for LearnedLengths {
    fn default() -> Self {
        Self { counts: Box::new([[LengthCounts::default(); 128]; 2]) }
    }
}

/// Whether the first byte of a body is the number of bytes after it.
fn begins_with_count(body: &[u8]) -> bool {
    body.first().is_some_and(|&count| usize::from(count) + 1 == body.len())
}

impl LengthCounts {
    /// Counts a body of this length. A length that is not among those remembered takes the place of the least frequent one,
    /// with a count of one. The lengths stay sorted by their counts, the most frequent first.
    fn count_length(&mut self, length: u16) {
        let known = self.lengths.iter().position(|&(known, seen)| known == length && seen > 0.0);
        let place = known.unwrap_or(REMEMBERED_LENGTHS - 1);
        if known.is_none() {
            self.lengths[place] = (length, 0.0);
        }
        self.lengths[place].1 += 1.0;
        self.lengths.sort_by(|a, b| b.1.total_cmp(&a.1));
    }
}

impl LearnedLengths {
    /// Learns the length of the body (without function code and CRC) of a committed frame: as announced where the body begins
    /// with a count of the bytes that follow, else as one of the lengths remembered. Counts are halved after
    /// `HALVE_LENGTHS_FRAMES`.
    pub fn learn(&mut self, function: u8, direction: usize, body: &[u8]) {
        let counts = &mut self.counts[direction][usize::from(function & 0x7F)];
        counts.frames += 1.0;
        if begins_with_count(body) {
            counts.counted += 1.0;
        } else {
            counts.count_length(body.len() as u16);
        }
        if counts.frames > HALVE_LENGTHS_FRAMES {
            counts.frames /= 2.0;
            counts.counted /= 2.0;
            counts.lengths.iter_mut().for_each(|(_, seen)| *seen /= 2.0);
        }
    }

    /// Cost of this body's length, in bits; negative where a count announces it, because the count is then a predicted
    /// byte. `count_bits` is the information content of that byte.
    pub fn cost(&self, function: u8, direction: usize, body: &[u8], count_bits: f32) -> f32 {
        let counts = &self.counts[direction][usize::from(function & 0x7F)];
        let any_length = (-OPEN_LENGTH_BITS).exp2();
        let known: f32 = counts.lengths.iter().map(|&(_, seen)| seen).sum();
        let of_this_length = counts.lengths.iter().filter(|&&(length, _)| usize::from(length) == body.len());
        let same: f32 = of_this_length.map(|&(_, seen)| seen).sum();
        // Lengths that vary are predicted by none of those seen, and a length seen once may be chance.
        let fixed = (same - LENGTH_DISCOUNT_FRAMES).max(0.0);
        let open = LENGTH_PRIOR_FRAMES + known - fixed;
        let announced = if begins_with_count(body) { counts.counted * (count_bits - OPEN_LENGTH_BITS).exp2() } else { 0.0 };
        -log2((fixed + open * any_length + announced) / (counts.frames + LENGTH_PRIOR_FRAMES))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_never_seen_costs_an_open_length() {
        assert!((LearnedLengths::default().cost(66, 0, &[1, 2, 3], 8.0) - OPEN_LENGTH_BITS).abs() < 0.01);
    }

    #[test]
    fn fixed_lengths_and_counts_are_learned_by_direction() {
        let mut lengths = LearnedLengths::default();
        for byte in 0..10 {
            lengths.learn(66, 0, &[byte; 5]);
            lengths.learn(66, 1, &[2, byte, byte]);
            lengths.learn(66, 1, &[3, byte, byte, byte]);
        }
        assert!(lengths.cost(66, 0, &[7; 5], 8.0) < 1.0);
        assert!(lengths.cost(66, 1, &[7; 5], 8.0) > 9.0);
        assert!(lengths.cost(66, 1, &[4, 1, 1, 1, 1], 8.56) < 0.0);
        assert!(lengths.cost(66, 0, &[4, 1, 1, 1, 1, 9], 8.56) > 7.0);
    }
}
