//! What is kept of the registers of a table while traffic goes by: samples spread over the whole time, and exact counts.

use std::collections::BTreeMap;

/// The samples kept of a block: 256 pairs of consecutive ones.
pub const MOST_ROWS: usize = 512;

/// The different values of a register that are counted.
pub const MOST_DISTINCT: usize = 12;

/// Pairs of consecutive samples of a block, evenly spread over the whole time. When there is no room, every other pair
/// goes, so the result depends on nothing but the samples.
#[derive(Clone, Debug)]
pub struct Samples {
    width: usize,
    /// The rows that are kept, one after the other.
    cells: Vec<u16>,
    times: Vec<i64>,
    /// The number of each row among all rows.
    numbers: Vec<u32>,
    seen: u32,
    /// Of so many pairs, one is kept.
    stride: u32,
}

impl Samples {
    /// No samples of this many registers.
    pub fn new(width: usize) -> Self {
        Self { width, cells: Vec::new(), times: Vec::new(), numbers: Vec::new(), seen: 0, stride: 1 }
    }

    /// Adds a row, unless it is one of those that are left out. `time` is in nanoseconds.
    pub fn put(&mut self, time: i64, row: impl Iterator<Item = u16>, most: usize) {
        let number = self.seen;
        self.seen = self.seen.saturating_add(1);
        if !(number / 2).is_multiple_of(self.stride) {
            return;
        }
        while self.times.len() >= most {
            self.thin();
        }
        if (number / 2).is_multiple_of(self.stride) {
            let before = self.cells.len();
            self.cells.extend(row.take(self.width));
            self.cells.resize(before + self.width, 0);
            self.times.push(time);
            self.numbers.push(number);
        }
    }

    /// Drops every other pair.
    fn thin(&mut self) {
        self.stride *= 2;
        let mut kept = 0;
        for i in 0..self.numbers.len() {
            if (self.numbers[i] / 2).is_multiple_of(self.stride) {
                self.cells.copy_within(i * self.width..(i + 1) * self.width, kept * self.width);
                (self.times[kept], self.numbers[kept]) = (self.times[i], self.numbers[i]);
                kept += 1;
            }
        }
        self.cells.truncate(kept * self.width);
        self.times.truncate(kept);
        self.numbers.truncate(kept);
    }

    /// Keeps at most so many rows.
    fn limit(&mut self, most: usize) {
        while self.times.len() > most {
            self.thin();
        }
        self.cells.shrink_to_fit();
        self.times.shrink_to_fit();
        self.numbers.shrink_to_fit();
    }

    /// The memory that the samples take, in bytes.
    fn bytes(&self) -> usize {
        2 * self.cells.capacity() + 8 * self.times.capacity() + 4 * self.numbers.capacity()
    }

    /// The number of rows that are kept.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// The registers from `at` to `end` of each row.
    pub fn rows(&self, at: usize, end: usize) -> Vec<&[u16]> {
        self.cells.chunks_exact(self.width).map(|row| &row[at..end]).collect()
    }

    /// The time of each row in nanoseconds.
    pub fn times(&self) -> &[i64] {
        &self.times
    }

    /// At which steps each register changed, as bits.
    pub fn changes(&self) -> Vec<Vec<u64>> {
        let words = self.len().div_ceil(64);
        let mut changed = vec![vec![0u64; words]; self.width];
        for step in 1..self.len() {
            let (before, now) = (&self.cells[(step - 1) * self.width..], &self.cells[step * self.width..]);
            for (i, bits) in changed.iter_mut().enumerate() {
                bits[step / 64] |= u64::from(before[i] != now[i]) << (step % 64);
            }
        }
        changed
    }

    /// Whether each row directly follows the one before it.
    pub fn follows(&self) -> Vec<bool> {
        (0..self.numbers.len()).map(|i| i > 0 && self.numbers[i] == self.numbers[i - 1] + 1).collect()
    }
}

/// Exact counts over all samples of a register.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// The number of samples, and of those that were written.
    pub samples: u64,
    /// The number of times that it was written.
    pub writes: u64,
    /// Whether it was read.
    pub is_read: bool,
    /// The first and the last value.
    pub first: u16,
    /// The last value.
    pub last: u16,
    /// The smallest value.
    pub min: u16,
    /// The largest value.
    pub max: u16,
    /// Changes between consecutive samples; of these those that go up and those that go down, as signed numbers if it is
    /// near zero, so that 65535 to 0 is up.
    pub ups: u64,
    /// See `ups`.
    pub downs: u64,
    /// Changes of direction.
    pub reversals: u64,
    /// Bits that were set at some time, and bits that were clear.
    pub set: u16,
    /// See `set`.
    pub clear: u16,
    /// Changes of a single bit.
    pub single_bits: u64,
    /// Steps of exactly one up, the wrap to zero included.
    pub increments: u64,
    /// Different values with their counts, until there are more than twelve.
    distinct: Vec<(u16, u32)>,
    is_going_down: bool,
}

impl Counts {
    /// Adds a value.
    pub fn put(&mut self, value: u16, is_write: bool) {
        if self.samples == 0 {
            (self.first, self.last, self.min, self.max) = (value, value, value, value);
        }
        self.samples += 1;
        self.writes += u64::from(is_write);
        self.is_read |= !is_write;
        (self.min, self.max) = (self.min.min(value), self.max.max(value));
        (self.set, self.clear) = (self.set | value, self.clear | !value);
        if value != self.last {
            self.moved(value);
        }
        self.last = value;
        if let Some(pair) = self.distinct.iter_mut().find(|pair| pair.0 == value) {
            pair.1 = pair.1.saturating_add(1);
        } else if self.distinct.len() <= MOST_DISTINCT {
            self.distinct.push((value, 1));
        }
    }

    fn moved(&mut self, value: u16) {
        let step = value.wrapping_sub(self.last);
        let is_down = step >= 0x8000;
        if self.ups + self.downs > 0 && is_down != self.is_going_down {
            self.reversals += 1;
        }
        self.is_going_down = is_down;
        self.ups += u64::from(!is_down);
        self.downs += u64::from(is_down);
        self.increments += u64::from(step == 1);
        self.single_bits += u64::from((value ^ self.last).is_power_of_two());
    }

    /// The number of changes.
    pub fn changes(&self) -> u64 {
        self.ups + self.downs
    }

    /// The number of different values; 13 stands for more than twelve.
    pub fn distinct_count(&self) -> usize {
        self.distinct.len()
    }

    /// The different values with their counts, sorted, if there are at most twelve.
    pub fn distinct(&self) -> Option<Vec<(u16, u32)>> {
        let mut values = self.distinct.clone();
        values.sort_unstable();
        (values.len() <= MOST_DISTINCT).then_some(values)
    }
}

/// A block that a master reads or writes.
#[derive(Clone, Debug)]
pub struct ObservedBlock {
    /// The number of reads.
    pub reads: u64,
    /// The number of writes.
    pub writes: u64,
    /// Exception responses by code.
    pub exceptions: BTreeMap<u8, u64>,
    /// Samples of its registers.
    pub samples: Samples,
}

/// The registers or bits of one table of one unit.
#[derive(Clone, Debug)]
pub struct ObservedTable {
    /// The blocks by first address and quantity.
    pub blocks: BTreeMap<(u16, u16), ObservedBlock>,
    /// Counts by address.
    pub registers: BTreeMap<u16, Counts>,
    /// The samples that are kept of each block.
    most_rows: usize,
    /// The memory that all samples take, in bytes.
    bytes: usize,
}

impl Default for ObservedTable {
    fn default() -> Self {
        Self::with_rows(MOST_ROWS)
    }
}

impl ObservedTable {
    /// A table that keeps at most so many samples of each block, an even number.
    pub fn with_rows(most_rows: usize) -> Self {
        Self { blocks: BTreeMap::new(), registers: BTreeMap::new(), most_rows, bytes: 0 }
    }

    /// The block of an address and a quantity.
    pub fn block(&mut self, first: u16, count: u16) -> &mut ObservedBlock {
        self.blocks.entry((first, count)).or_insert_with(|| {
            let samples = Samples::new(usize::from(count));
            ObservedBlock { reads: 0, writes: 0, exceptions: BTreeMap::new(), samples }
        })
    }

    /// Adds the values that a transaction read or wrote.
    pub fn put(&mut self, first: u16, values: &[u16], time: i64, is_write: bool) {
        for (i, &value) in values.iter().enumerate() {
            self.registers.entry(first.wrapping_add(i as u16)).or_default().put(value, is_write);
        }
        let most = self.most_rows;
        let samples = &mut self.block(first, values.len() as u16).samples;
        let before = samples.bytes();
        samples.put(time, values.iter().copied(), most);
        let after = samples.bytes();
        self.bytes = self.bytes + after - before;
    }

    /// The memory that all samples take, in bytes.
    pub fn sample_bytes(&self) -> usize {
        self.bytes
    }

    /// Keeps at most so many samples of each block, an even number, from now on.
    pub fn limit_rows(&mut self, most: usize) {
        self.most_rows = most;
        self.blocks.values_mut().for_each(|block| block.samples.limit(most));
        self.bytes = self.blocks.values().map(|block| block.samples.bytes()).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_recording_keeps_pairs_over_the_whole_of_it() {
        let mut samples = Samples::new(1);
        for i in 0..100_000u32 {
            samples.put(i64::from(i), std::iter::once(i as u16), MOST_ROWS);
        }
        assert!(samples.len() <= MOST_ROWS && samples.len() >= MOST_ROWS / 4, "{}", samples.len());
        let times = samples.times();
        assert!(times[0] == 0 && times[times.len() - 1] > 99_000);
        let follows = samples.follows();
        assert_eq!(follows.iter().filter(|&&follows| follows).count(), samples.len() / 2);
        assert!(times.iter().zip(samples.rows(0, 1)).all(|(time, row)| *time as u16 == row[0]));
    }

    #[test]
    fn a_table_with_less_memory_keeps_pairs_of_every_block() {
        let mut table = ObservedTable::default();
        for i in 0..2000i64 {
            table.put(i as u16 % 4 * 100, &[i as u16; 100], i, false);
        }
        let all = table.sample_bytes();
        table.limit_rows(32);
        assert!(table.sample_bytes() < all / 8 && table.sample_bytes() > 4 * 16 * 200);
        table.put(0, &[7; 100], 2000, false);
        for block in table.blocks.values() {
            assert!(block.samples.len() <= 32 && block.samples.len() >= 16);
            assert!(block.samples.follows().iter().filter(|&&follows| follows).count() * 2 >= block.samples.len() - 1);
        }
        assert_eq!(table.registers[&0].samples, 501);
    }

    #[test]
    fn counts_are_those_of_all_samples() {
        let mut counts = Counts::default();
        for value in [65_534, 65_535, 0, 1, 0, 8, 8] {
            counts.put(value, false);
        }
        assert_eq!((counts.changes(), counts.ups, counts.downs, counts.reversals), (5, 4, 1, 2));
        assert_eq!((counts.increments, counts.min, counts.max), (3, 0, 65_535));
        assert_eq!(counts.distinct().unwrap(), [(0, 2), (1, 1), (8, 2), (65_534, 1), (65_535, 1)]);
    }
}
