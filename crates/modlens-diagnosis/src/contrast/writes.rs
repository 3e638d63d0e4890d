//! What comes after each write: a write may switch what disturbs the line.

use super::sample::Sample;
use crate::observation::WriteKey;

/// Different writes that are distinguished.
const MAX_WRITES: usize = 64;

/// What was counted shortly after a write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AfterWrite {
    /// Bursts of noise.
    pub bursts: u64,
    /// Good frames.
    pub frames: u64,
}

/// Noise and good frames by the write before them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AfterWrites(Sample<WriteKey, AfterWrite, MAX_WRITES>);

impl AfterWrites {
    /// Counts a good frame.
    pub(super) fn count_frame(&mut self, write: WriteKey) {
        if let Some(counts) = self.0.entry(write.hash(), write) {
            counts.frames += 1;
        }
    }

    /// Counts a burst of noise.
    pub(super) fn count_burst(&mut self, write: WriteKey) {
        if let Some(counts) = self.0.entry(write.hash(), write) {
            counts.bursts += 1;
        }
    }

    /// Adds what came later.
    pub(super) fn merge(&mut self, later: &Self) {
        self.0.merge(later.0.clone(), |own, more| {
            own.bursts += more.bursts;
            own.frames += more.frames;
        });
    }

    /// Returns the write after which most bursts came, with what was counted after it.
    pub fn noisiest(&self) -> Option<(WriteKey, AfterWrite)> {
        let all = self.0.sorted().into_iter().map(|(key, counts)| (*key, *counts));
        all.max_by_key(|(key, counts)| (counts.bursts, std::cmp::Reverse(*key)))
    }

    /// Returns the sums over all other writes.
    pub fn without(&self, write: WriteKey) -> AfterWrite {
        let others = self.0.sorted().into_iter().filter(|(key, _)| **key != write);
        others.fold(AfterWrite::default(), |sum, (_, one)| AfterWrite {
            bursts: sum.bursts + one.bursts,
            frames: sum.frames + one.frames,
        })
    }

    /// Returns the unit that all of them write to.
    pub fn only_unit(&self) -> Option<u8> {
        let all = self.0.sorted();
        let (first, _) = all.first()?;
        all.iter().all(|(key, _)| key.unit == first.unit).then_some(first.unit)
    }
}
