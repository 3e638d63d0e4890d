//! Levels as Saleae's Logic exports them: a line of text for each change, a time in seconds and a level a channel.

use memchr::memchr;

use crate::logic::edges::{Edge, CHANNELS};

/// Places a second: times have nanoseconds, or more digits.
pub const RATE: f64 = 1e9;

/// The last levels hold so long, at the end: a character may still be going on.
const HOLD: u64 = 100_000_000;

/// A line longer than this is no row.
const LONGEST_LINE: usize = 1 << 16;

/// Finds the changes in blocks of text, cut anywhere.
#[derive(Debug, Default)]
pub struct LevelTable {
    /// The beginning of a line whose rest is in the next block.
    carry: Vec<u8>,
    first: Option<f64>,
    levels: Option<u64>,
    /// Places so far.
    pub samples: u64,
}

impl LevelTable {
    /// Takes text; lines that are no rows are passed over.
    pub fn push(&mut self, mut block: &[u8], each: &mut impl FnMut(usize, Edge)) {
        while let Some(end) = memchr(b'\n', block) {
            if self.carry.is_empty() {
                self.row(&block[..end], each);
            } else {
                let mut line = std::mem::take(&mut self.carry);
                line.extend_from_slice(&block[..end]);
                self.row(&line, each);
                line.clear();
                self.carry = line;
            }
            block = &block[end + 1..];
        }
        if self.carry.len() < LONGEST_LINE {
            self.carry.extend_from_slice(block);
        }
    }

    /// The text has ended.
    pub fn finish(&mut self, each: &mut impl FnMut(usize, Edge)) {
        let line = std::mem::take(&mut self.carry);
        self.row(&line, each);
        self.samples += HOLD;
    }

    fn row(&mut self, line: &[u8], each: &mut impl FnMut(usize, Edge)) {
        let Some((seconds, now, count)) = row(line) else { return };
        let first = *self.first.get_or_insert(seconds);
        let sample = ((seconds - first) * RATE).round().max(0.0) as u64;
        let used = if count == CHANNELS { u64::MAX } else { (1 << count) - 1 };
        let mut changed = self.levels.map_or(u64::MAX, |last| last ^ now) & used;
        while changed != 0 {
            let channel = changed.trailing_zeros() as usize;
            each(channel, Edge { sample, high: now >> channel & 1 == 1 });
            changed &= changed - 1;
        }
        self.levels = Some(now);
        self.samples = self.samples.max(sample);
    }
}

/// Time, levels (channel 0 in bit 0) and their number; `None` if the line is no row.
fn row(line: &[u8]) -> Option<(f64, u64, usize)> {
    let mut cells = line.trim_ascii().split(|&b| b == b',' || b == b'\t');
    let time = std::str::from_utf8(cells.next()?.trim_ascii()).ok()?;
    // Rust reads `inf` and `nan`, too.
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

/// Whether a text is such a table: rows of a time and levels, rising, behind a line of names.
pub fn is_table(sample: &[u8]) -> bool {
    let mut lines = sample.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty());
    let Some(names) = lines.next() else { return false };
    let width = names.split(|&b| b == b',' || b == b'\t').count();
    let (mut before, mut rows) = (f64::NEG_INFINITY, 0);
    // The last line may be cut off.
    let lines: Vec<&[u8]> = lines.take(50).collect();
    for line in &lines[..lines.len().saturating_sub(1)] {
        match row(line) {
            Some((seconds, _, count)) if count + 1 == width && seconds >= before => before = seconds,
            _ => return false,
        }
        rows += 1;
    }
    rows >= 3 && row(names).is_none()
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
                table.push(block, &mut |channel, edge| all.push((channel, edge.sample, edge.high)));
            }
            table.finish(&mut |channel, edge| all.push((channel, edge.sample, edge.high)));
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
