//! Reads levels as Saleae Logic exports them: one line of text per level change, with the time in seconds and the level of
//! each channel.

use memchr::memchr;

use crate::logic::edges::{Edge, CHANNELS};

/// Samples per second: times are converted to ns, as finely as the file states them.
pub const RATE: f64 = 1e9;

/// At the end of the file the last levels count as held for so long, so that a character whose last bits are not followed
/// by an edge is complete.
const FINAL_HOLD_NS: u64 = 100_000_000;

/// A longer line is no row.
const MAX_ROW_BYTES: usize = 1 << 16;

/// Finds the level changes in text that arrives in blocks cut anywhere.
#[derive(Debug, Default)]
pub struct LevelTable {
    /// The beginning of a line whose rest is in the next block.
    carry: Vec<u8>,
    /// The time of the first row in seconds, from which samples are counted.
    first: Option<f64>,
    /// The levels of the last row, one bit per channel.
    levels: Option<u64>,
    /// The number of samples so far, that is, ns since the first row.
    pub samples: u64,
}

impl LevelTable {
    /// Takes a block of text; lines that are no rows, such as the column names, are ignored.
    pub fn push(&mut self, mut block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        while let Some(end) = memchr(b'\n', block) {
            if self.carry.is_empty() {
                self.push_row(&block[..end], each);
            } else {
                let mut line = std::mem::take(&mut self.carry);
                line.extend_from_slice(&block[..end]);
                self.push_row(&line, each);
                line.clear();
                self.carry = line;
            }
            block = &block[end + 1..];
        }
        if self.carry.len() < MAX_ROW_BYTES {
            self.carry.extend_from_slice(block);
        }
    }

    /// Reads the last line, because the text has ended.
    pub fn finish(&mut self, each: &mut impl FnMut(usize, Edge)) {
        let line = std::mem::take(&mut self.carry);
        self.push_row(&line, each);
        self.samples += FINAL_HOLD_NS;
    }

    /// Reports the channels that have changed since the row before.
    fn push_row(&mut self, line: &[u8], each: &mut impl FnMut(usize, Edge)) {
        let Some((seconds, now, count)) = parse_row(line) else { return };
        let first = *self.first.get_or_insert(seconds);
        let sample = ((seconds - first) * RATE).round().max(0.0) as u64;
        let used = if count == CHANNELS { u64::MAX } else { (1 << count) - 1 };
        let mut changed = self.levels.map_or(u64::MAX, |last| last ^ now) & used;
        while changed != 0 {
            let channel = changed.trailing_zeros() as usize;
            each(channel, Edge { sample, is_high: now >> channel & 1 == 1 });
            changed &= changed - 1;
        }
        self.levels = Some(now);
        self.samples = self.samples.max(sample);
    }
}

/// Parses a row: the time in seconds, the levels with channel 0 in bit 0, and the number of channels. `None` for other
/// lines.
fn parse_row(line: &[u8]) -> Option<(f64, u64, usize)> {
    let mut cells = line.trim_ascii().split(|&b| b == b',' || b == b'\t');
    let time = std::str::from_utf8(cells.next()?.trim_ascii()).ok()?;
    // Rust would parse `inf` and `nan` as well.
    let seconds = time.parse::<f64>().ok().filter(|_| time.ends_with(|last: char| last.is_ascii_digit()))?;
    let (mut levels, mut count) = (0, 0);
    for cell in cells {
        match cell.trim_ascii() {
            b"0" if count < CHANNELS => {}
            b"1" if count < CHANNELS => levels |= 1 << count,
            _ => return None,
        }
        count += 1;
    }
    (count > 0).then_some((seconds, levels, count))
}

/// Whether a text is such a table: a line of column names, then at least three rows of a time and levels, with times that
/// do not decrease.
pub fn is_table(sample: &[u8]) -> bool {
    let mut lines = sample.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty());
    let Some(names) = lines.next() else { return false };
    let width = names.split(|&b| b == b',' || b == b'\t').count();
    let (mut before, mut rows) = (f64::NEG_INFINITY, 0);
    // The last line of the sample may be cut off.
    let lines: Vec<&[u8]> = lines.take(50).collect();
    for line in &lines[..lines.len().saturating_sub(1)] {
        match parse_row(line) {
            Some((seconds, _, count)) if count + 1 == width && seconds >= before => before = seconds,
            _ => return false,
        }
        rows += 1;
    }
    rows >= 3 && parse_row(names).is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &[u8] = b"Time [s],RX,TX\n-0.000001000,1,1\n0.000103167,0,1\n0.000207334,1,0\n0.000207334,1,1\n";

    #[test]
    fn rows_are_changes_however_they_are_cut() {
        let found = |size: usize| {
            let mut table = LevelTable::default();
            let mut all = Vec::new();
            for block in TEXT.chunks(size) {
                table.push(block, &mut |channel, edge| all.push((channel, edge.sample, edge.is_high)));
            }
            table.finish(&mut |channel, edge| all.push((channel, edge.sample, edge.is_high)));
            all
        };
        let whole = found(1000);
        assert_eq!(
            whole,
            [(0, 0, true), (1, 0, true), (0, 104_167, false), (0, 208_334, true), (1, 208_334, false), (1, 208_334, true)]
        );
        for size in [1, 2, 7] {
            assert_eq!(found(size), whole);
        }
    }

    #[test]
    fn tables_are_told_from_other_text() {
        assert!(is_table(TEXT));
        assert!(!is_table(b"Time [s],Value,Parity Error,Framing Error\n0.1,0x05,,\n0.2,0x03,,\n0.3,0x00,,\n0.4,0x10,,\n"));
        assert!(!is_table(b"5,3,0,16\n0,2,196,74\n5,3,4,0\n1,0,1,0\n1,1,1,1\n"));
        assert!(!is_table(b"a,b\n1.5,nan\n"));
    }
}
