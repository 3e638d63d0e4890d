//! The values of one point of a profile over time.

use crate::learn::{ObservedTable, Samples};
use crate::points::CompiledPoint;

/// The samples that are looked at.
const MOST_ROWS: usize = 64;

/// The registers of a point at some moments.
#[derive(Debug, Default)]
pub(super) struct Series {
    /// The registers of the point, sample after sample.
    words: Vec<u16>,
    /// The times of the samples.
    pub times: Vec<i64>,
    width: usize,
}

impl Series {
    /// Samples of a point from the block with the most samples that has all of its registers.
    pub fn of(table: &ObservedTable, compiled: &CompiledPoint) -> Self {
        let (first, end) = (u32::from(compiled.address), u32::from(compiled.address) + u32::from(compiled.width));
        let has_all = |from: u16, count: u16| u32::from(from) <= first && end <= u32::from(from) + u32::from(count);
        let blocks = table.blocks.iter().filter(|((from, count), _)| has_all(*from, *count));
        let best: Option<(u16, &Samples)> =
            blocks.map(|((from, _), block)| (*from, &block.samples)).max_by_key(|(_, samples)| samples.len());
        let width = usize::from(compiled.width);
        let Some((from, samples)) = best.filter(|(_, samples)| !samples.is_empty()) else { return Self::default() };
        let at = usize::from(compiled.address - from);
        let stride = samples.len().div_ceil(MOST_ROWS).max(1);
        let mut found = Self { words: Vec::new(), times: Vec::new(), width };
        for (row, time) in samples.rows(at, at + width).into_iter().zip(samples.times()).step_by(stride) {
            found.words.extend_from_slice(row);
            found.times.push(*time);
        }
        found
    }

    /// The registers of each sample.
    pub fn rows(&self) -> impl Iterator<Item = &[u16]> {
        self.words.chunks_exact(self.width.max(1))
    }

    /// The bytes of each sample.
    pub fn bytes(&self) -> impl Iterator<Item = Vec<u8>> + '_ {
        self.rows().map(|row| row.iter().flat_map(|word| word.to_be_bytes()).collect())
    }

    /// Whether all registers were zero at all times, or there are no samples.
    pub fn is_zero(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }

    /// The numbers of a point; `None` for a sample that holds what devices send instead of a value.
    pub fn numbers(&self, compiled: &CompiledPoint) -> Vec<Option<f64>> {
        let is_value = |row: &[u16]| !is_placeholder(row);
        self.rows().zip(self.bytes()).map(|(row, bytes)| compiled.value(&bytes).number().filter(|_| is_value(row))).collect()
    }
}

/// Whether registers hold what devices send instead of a value: all ones, or the ends of the signed range.
pub(super) fn is_placeholder(row: &[u16]) -> bool {
    let rest = |word: u16| row[1..].iter().all(|other| *other == word);
    match row.first() {
        Some(0xFFFF | 0x7FFF) => rest(0xFFFF),
        Some(0x8000) => rest(0),
        _ => row.last() == Some(&0x8000) && row[..row.len() - 1].iter().all(|word| *word == 0),
    }
}
