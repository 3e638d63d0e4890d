//! Lengths of functions without public layout, as this line has shown them.
//!
//! Vendors' frames mostly have one length per direction, or begin with a count of the bytes that follow. Once that has
//! been seen, a length is evidence as good as a layout's, and it tells requests from responses.

use crate::framer::rtu::bits::log2;

/// Different lengths that are remembered of one function in one direction.
const LENGTHS: usize = 4;

/// Frames that the prior is worth: any length at all.
const PRIOR: f32 = 2.0;

/// Bits that choose a length where nothing is known of it.
pub const OPEN_LENGTH: f32 = 7.5;

/// Counts are halved here: devices may be replaced.
const FORGET: f32 = 64.0;

/// What was seen of one function in one direction.
#[derive(Clone, Copy, Default)]
struct Kind {
    frames: f32,
    /// Those that begin with a count of the bytes that follow.
    counted: f32,
    /// The others by length, the latest newcomer last.
    lengths: [(u16, f32); LENGTHS],
}

/// What was seen of all functions.
pub struct Shapes {
    kinds: Box<[[Kind; 128]; 2]>,
}

impl Default for Shapes {
    fn default() -> Self {
        Self { kinds: Box::new([[Kind::default(); 128]; 2]) }
    }
}

fn counted(body: &[u8]) -> bool {
    body.first().is_some_and(|&count| usize::from(count) + 1 == body.len())
}

impl Shapes {
    /// Learns from a frame that is certain.
    pub fn learn(&mut self, function: u8, direction: usize, body: &[u8]) {
        let kind = &mut self.kinds[direction][usize::from(function & 0x7F)];
        kind.frames += 1.0;
        if counted(body) {
            kind.counted += 1.0;
        } else {
            let length = body.len() as u16;
            let known = kind.lengths.iter().position(|&(known, seen)| known == length && seen > 0.0);
            let at = known.unwrap_or(LENGTHS - 1);
            if known.is_none() {
                kind.lengths[at] = (length, 0.0);
            }
            kind.lengths[at].1 += 1.0;
            kind.lengths.sort_by(|a, b| b.1.total_cmp(&a.1));
        }
        if kind.frames > FORGET {
            kind.frames /= 2.0;
            kind.counted /= 2.0;
            kind.lengths.iter_mut().for_each(|(_, seen)| *seen /= 2.0);
        }
    }

    /// Cost of this body's length; less than nothing where it is announced by a count, worth `count_bits` as a byte.
    pub fn cost(&self, function: u8, direction: usize, body: &[u8], count_bits: f32) -> f32 {
        let kind = &self.kinds[direction][usize::from(function & 0x7F)];
        let any = (-OPEN_LENGTH).exp2();
        let known: f32 = kind.lengths.iter().map(|&(_, seen)| seen).sum();
        let same: f32 =
            kind.lengths.iter().filter(|&&(length, _)| usize::from(length) == body.len()).map(|&(_, seen)| seen).sum();
        // Lengths that vary are known by none of those seen; a length seen once may be chance.
        let fixed = (same - 0.5).max(0.0);
        let open = PRIOR + known - fixed;
        let announced = if counted(body) { kind.counted * (count_bits - OPEN_LENGTH).exp2() } else { 0.0 };
        -log2((fixed + open * any + announced) / (kind.frames + PRIOR))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_never_seen_costs_an_open_length() {
        assert!((Shapes::default().cost(66, 0, &[1, 2, 3], 8.0) - OPEN_LENGTH).abs() < 0.01);
    }

    #[test]
    fn fixed_lengths_and_counts_are_learned_by_direction() {
        let mut shapes = Shapes::default();
        for byte in 0..10 {
            shapes.learn(66, 0, &[byte; 5]);
            shapes.learn(66, 1, &[2, byte, byte]);
            shapes.learn(66, 1, &[3, byte, byte, byte]);
        }
        assert!(shapes.cost(66, 0, &[7; 5], 8.0) < 1.0);
        assert!(shapes.cost(66, 1, &[7; 5], 8.0) > 9.0);
        assert!(shapes.cost(66, 1, &[4, 1, 1, 1, 1], 8.56) < 0.0);
        assert!(shapes.cost(66, 0, &[4, 1, 1, 1, 1, 9], 8.56) > 7.0);
    }
}
