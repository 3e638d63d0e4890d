//! The values of registers over a whole recording, for searches that need to know what a register was at some time.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use modlens_engine::records::Batch;
use modlens_profiles::find::BlockSeries;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

use crate::columns::{read_data, read_range, row_of, write_data, write_range, Items};

/// The memory that samples may take, in registers of two bytes. A time takes four.
const MOST_CELLS: usize = 32 << 20;

/// Collects the samples of every block. If they take too much memory, every other sample of the largest block is dropped,
/// except near the times that matter.
#[derive(Debug)]
pub struct RegisterSeries {
    blocks: BTreeMap<(u8, Space, u16, u16), BlockSeries>,
    /// Times near which every sample is kept.
    kept: Vec<RangeInclusive<i64>>,
    cells: usize,
    most_cells: usize,
    dropped: u64,
}

impl RegisterSeries {
    /// An empty collection; all samples in `kept` stay, whatever memory they take.
    pub fn new(kept: Vec<RangeInclusive<i64>>) -> Self {
        Self { blocks: BTreeMap::new(), kept, cells: 0, most_cells: MOST_CELLS, dropped: 0 }
    }

    /// Adds what the transactions of a batch read and wrote.
    pub fn add(&mut self, batch: &Batch) {
        for t in batch.all_transactions().iter().filter(|t| t.status == Status::Ok) {
            let Some(space) = row_of(batch, t).and_then(|row| row.space) else { continue };
            let place = (t.unit, space);
            let time = t.start.or(t.elapsed);
            self.put(place, time, read_range(batch, t), read_data(batch, t));
            self.put(place, time, write_range(batch, t), write_data(batch, t));
        }
    }

    /// Adds one sample of a block.
    fn put(&mut self, place: (u8, Space), start: Option<i64>, range: Option<(u16, u16)>, items: Option<Items<'_>>) {
        let (unit, space) = place;
        let (Some((first, count)), Some(items)) = (range, items) else { return };
        let width = usize::from(count);
        if items.len() < width || width == 0 {
            return;
        }
        let Some(time) = start else { return };
        let empty = || BlockSeries { unit, space, first, width, times: Vec::new(), cells: Vec::new() };
        let block = self.blocks.entry((unit, space, first, count)).or_insert_with(empty);
        if block.times.last().is_some_and(|&last| last > time) {
            // A clock that was set back: what was before it cannot be separated by time.
            return;
        }
        block.times.push(time);
        block.cells.extend((0..width).map(|i| items.get(i) as u16));
        self.cells += width + 4;
        if self.cells > self.most_cells {
            self.thin();
        }
    }

    /// Drops every other sample of the largest block.
    fn thin(&mut self) {
        let Some(block) = self.blocks.values_mut().max_by_key(|block| block.cells.len() + 4 * block.times.len()) else {
            return;
        };
        let (mut times, mut cells) = (Vec::new(), Vec::new());
        for (i, row) in block.cells.chunks_exact(block.width).enumerate() {
            let time = block.times[i];
            if i % 2 == 0 || self.kept.iter().any(|range| range.contains(&time)) {
                times.push(time);
                cells.extend_from_slice(row);
            }
        }
        let dropped = block.times.len() - times.len();
        self.dropped += dropped as u64;
        self.cells -= dropped * (block.width + 4);
        if dropped == 0 {
            // Only samples that matter are left.
            self.most_cells *= 2;
        }
        (block.times, block.cells) = (times, cells);
    }

    /// The number of samples that were dropped to save memory.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// The first and the last time of a sample; `None` without samples.
    pub fn span(&self) -> Option<(i64, i64)> {
        let first = self.blocks.values().filter_map(|block| block.times.first().copied()).min()?;
        let last = self.blocks.values().filter_map(|block| block.times.last().copied()).max()?;
        Some((first, last))
    }

    /// Moves the blocks with their samples out.
    pub fn blocks(&mut self) -> Vec<BlockSeries> {
        std::mem::take(&mut self.blocks).into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_the_times_that_matter() {
        let mut series = RegisterSeries::new(vec![100..=105]);
        series.most_cells = 900;
        for i in 0..400i64 {
            let word = (i as u16).to_be_bytes();
            series.put((1, Space::Holding), Some(i), Some((7, 1)), Some(Items::Words(&word)));
        }
        assert!(series.dropped() > 0 && series.cells <= 900);
        let blocks = series.blocks();
        let times = &blocks[0].times;
        assert!((100..=105).all(|time| times.contains(&time)), "{times:?}");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]) && times[0] == 0 && *times.last().unwrap() > 390);
        assert!(blocks[0].cells.iter().zip(times).all(|(cell, time)| i64::from(*cell) == *time));
    }
}
