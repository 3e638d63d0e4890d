//! Finds the level changes of all channels in binary samples.

/// A level change of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Number of the first sample with the new level.
    pub sample: u64,
    /// The new level.
    pub is_high: bool,
}

/// Finds the edges of all channels in samples that arrive in blocks cut anywhere.
#[derive(Debug)]
pub struct EdgeDetector {
    /// Bytes per sample.
    sample_bytes: usize,
    /// The levels of the last sample, one bit per channel.
    last: Option<u64>,
    /// The beginning of a sample whose rest is in the next block.
    carry: Vec<u8>,
    /// The number of samples so far.
    pub samples: u64,
}

/// The most channels that a sample can have.
pub const CHANNELS: usize = 64;

impl EdgeDetector {
    /// A detector for samples of so many bytes, at most eight.
    pub fn new(sample_bytes: usize) -> Self {
        Self { sample_bytes: sample_bytes.clamp(1, 8), last: None, carry: Vec::new(), samples: 0 }
    }

    /// Takes a block of samples; `each` is called with the channel and every edge. The first sample counts as an edge of
    /// every channel, which reports its level.
    pub fn push(&mut self, mut block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        if !self.carry.is_empty() {
            let (more, rest) = block.split_at((self.sample_bytes - self.carry.len()).min(block.len()));
            self.carry.extend_from_slice(more);
            block = rest;
            if self.carry.len() < self.sample_bytes {
                return;
            }
            let first = std::mem::take(&mut self.carry);
            self.push_whole_samples(&first, each);
        }
        let whole = block.len() / self.sample_bytes * self.sample_bytes;
        self.push_whole_samples(&block[..whole], each);
        self.carry.extend_from_slice(&block[whole..]);
    }

    /// Finds the edges in whole samples.
    fn push_whole_samples(&mut self, block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        let mut at = 0;
        while at < block.len() {
            // Nearly all samples equal the one before, so runs of them are skipped sixteen bytes at a time.
            if at >= self.sample_bytes {
                at += common_prefix(&block[at..], &block[at - self.sample_bytes..]) / self.sample_bytes * self.sample_bytes;
                if at >= block.len() {
                    break;
                }
            }
            self.push_sample(&block[at..at + self.sample_bytes], at, each);
            at += self.sample_bytes;
        }
        self.samples += (block.len() / self.sample_bytes) as u64;
    }

    /// Compares the sample at offset `at` of the block with the last one and reports the channels that have changed.
    fn push_sample(&mut self, bytes: &[u8], at: usize, each: &mut impl FnMut(usize, Edge)) {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let now = u64::from_le_bytes(word);
        // The first sample sets all levels.
        let mut changed = self.last.map_or(u64::MAX, |last| last ^ now);
        let sample = self.samples + (at / self.sample_bytes) as u64;
        let used = if self.sample_bytes == 8 { u64::MAX } else { (1 << (8 * self.sample_bytes)) - 1 };
        changed &= used;
        while changed != 0 {
            let channel = changed.trailing_zeros() as usize;
            each(channel, Edge { sample, is_high: now >> channel & 1 == 1 });
            changed &= changed - 1;
        }
        self.last = Some(now);
    }
}

/// The length of the longest common prefix of both.
fn common_prefix(one: &[u8], other: &[u8]) -> usize {
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
        let found = |size: usize, sample_bytes: usize| {
            let mut edges = EdgeDetector::new(sample_bytes);
            let mut all = Vec::new();
            for block in samples.chunks(size) {
                edges.push(block, &mut |channel, edge| all.push((channel, edge)));
            }
            all
        };
        let whole: Vec<_> =
            found(1000, 1).into_iter().filter(|(channel, _)| *channel < 2).map(|(c, e)| (c, e.sample, e.is_high)).collect();
        assert_eq!(whole, [(0, 0, true), (1, 0, false), (0, 100, false), (0, 137, true), (1, 137, true), (0, 142, false)]);
        for size in [1, 2, 3, 7, 16] {
            assert_eq!(found(size, 1), found(1000, 1));
            assert_eq!(found(size, 2), found(1000, 2));
        }
    }
}
