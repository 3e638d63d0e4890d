//! Samples to edges: where a channel changes, and to what.

/// A change of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Number of the first sample with the new level.
    pub sample: u64,
    /// The new level.
    pub high: bool,
}

/// Finds the edges of all channels in blocks of samples, cut anywhere.
#[derive(Debug)]
pub struct EdgeDetector {
    /// Bytes of one sample.
    unit: usize,
    /// The sample before.
    last: Option<u64>,
    /// The beginning of a sample whose rest is in the next block.
    carry: Vec<u8>,
    /// Samples so far.
    pub samples: u64,
}

/// Channels that a sample can have.
pub const CHANNELS: usize = 64;

impl EdgeDetector {
    /// For samples of so many bytes, at most eight.
    pub fn new(unit: usize) -> Self {
        Self { unit: unit.clamp(1, 8), last: None, carry: Vec::new(), samples: 0 }
    }

    /// The levels at the first sample.
    pub fn push(&mut self, mut block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        if !self.carry.is_empty() {
            let (more, rest) = block.split_at((self.unit - self.carry.len()).min(block.len()));
            self.carry.extend_from_slice(more);
            block = rest;
            if self.carry.len() < self.unit {
                return;
            }
            let first = std::mem::take(&mut self.carry);
            self.whole(&first, each);
        }
        let whole = block.len() / self.unit * self.unit;
        self.whole(&block[..whole], each);
        self.carry.extend_from_slice(&block[whole..]);
    }

    fn whole(&mut self, block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        let mut at = 0;
        while at < block.len() {
            // Nearly all samples are as the one before: runs of them are skipped sixteen bytes at a time.
            if at >= self.unit {
                at += same(&block[at..], &block[at - self.unit..]) / self.unit * self.unit;
                if at >= block.len() {
                    break;
                }
            }
            self.sample(&block[at..at + self.unit], at, each);
            at += self.unit;
        }
        self.samples += (block.len() / self.unit) as u64;
    }

    fn sample(&mut self, bytes: &[u8], at: usize, each: &mut impl FnMut(usize, Edge)) {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let now = u64::from_le_bytes(word);
        // The first sample sets all levels.
        let mut changed = self.last.map_or(u64::MAX, |last| last ^ now);
        let sample = self.samples + (at / self.unit) as u64;
        let used = if self.unit == 8 { u64::MAX } else { (1 << (8 * self.unit)) - 1 };
        changed &= used;
        while changed != 0 {
            let channel = changed.trailing_zeros() as usize;
            each(channel, Edge { sample, high: now >> channel & 1 == 1 });
            changed &= changed - 1;
        }
        self.last = Some(now);
    }
}

/// How many bytes both begin with.
fn same(one: &[u8], other: &[u8]) -> usize {
    const STEP: usize = 16;
    let steps = one.chunks_exact(STEP).zip(other.chunks_exact(STEP)).take_while(|(a, b)| a == b).count() * STEP;
    steps + one[steps..].iter().zip(&other[steps..]).take_while(|(a, b)| a == b).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_found_however_the_blocks_are_cut() {
        let samples: Vec<u8> = [vec![1; 100], vec![0; 37], vec![3; 5], vec![2; 64]].concat();
        let found = |size: usize, unit: usize| {
            let mut edges = EdgeDetector::new(unit);
            let mut all = Vec::new();
            for block in samples.chunks(size) {
                edges.push(block, &mut |channel, edge| all.push((channel, edge)));
            }
            all
        };
        let whole: Vec<_> =
            found(1000, 1).into_iter().filter(|(channel, _)| *channel < 2).map(|(c, e)| (c, e.sample, e.high)).collect();
        assert_eq!(whole, [(0, 0, true), (1, 0, false), (0, 100, false), (0, 137, true), (1, 137, true), (0, 142, false)]);
        for size in [1, 2, 3, 7, 16] {
            assert_eq!(found(size, 1), found(1000, 1));
            assert_eq!(found(size, 2), found(1000, 2));
        }
    }
}
