//! Looks for another row, where those in use cannot read a line.

use std::sync::Arc;

use crate::text::dialect::Dialect;
use crate::text::evidence;
use crate::text::reader::Reader;

/// Lines with bytes that no row in use can read, which are tried with all rows.
const TRIES: u32 = 4000;

/// Lines that are tried together with those before them: this costs more.
const TRIES_BEHIND: u32 = 1000;

/// Lines without a reader that are kept for rows whose records have several, and as much of each.
const LINES_BEHIND: usize = 12;
const LONGEST_BEHIND: usize = 400;

impl Reader {
    /// Looks for a row of several lines a record that reads this line together with those before it, which none could read.
    pub(super) fn rows_behind(&mut self, line: &[u8]) -> bool {
        let Some(others) = self.others.clone() else { return false };
        if self.unread.len() >= LINES_BEHIND {
            self.unread.pop_front();
        }
        self.unread.push_back((self.number, line[..line.len().min(LONGEST_BEHIND)].to_vec()));
        if self.tries_behind >= TRIES_BEHIND || !line.iter().any(u8::is_ascii_digit) {
            return false;
        }
        self.tries_behind += 1;
        let mut text = Vec::new();
        for (_, line) in &self.unread {
            text.extend_from_slice(line);
            text.push(b'\n');
        }
        let reads = |row: &&Arc<Dialect>| row.several_lines() && row.possible(&text) && reads_all(row, &text);
        let used = |row: &Arc<Dialect>| self.dialects.iter().any(|one| one.name == row.name);
        let Some(row) = others.rows().filter(|row| !used(row)).find(reads) else { return false };
        self.dialects.push(Arc::clone(row));
        self.stamps.state.short_fractions |= row.short_fractions;
        // They were counted, all but the last.
        self.deliver.end_announcement(&self.stamps);
        let lines = std::mem::take(&mut self.unread);
        self.unparsed -= lines.len() as u64 - 1;
        self.first_unparsed.retain(|(number, _)| lines.iter().all(|(other, _)| other != number));
        for (number, line) in lines {
            self.deliver.number = number;
            if self.matches_of(row, &line) {
                self.hand_over(row);
            } else if !line.trim_ascii().is_empty() {
                self.note_unparsed_at(number, line.trim_ascii());
            }
        }
        true
    }

    /// Looks for a row that reads a line of bytes which those in use cannot read; a checksum has to prove it.
    pub(super) fn another_row(&mut self, line: &[u8]) -> bool {
        if self.tries >= TRIES || !may_hold_bytes(line) {
            return false;
        }
        let Some(others) = self.others.clone() else { return false };
        self.tries += 1;
        // Those whose bytes other lines announce are tried with these (`rows_behind`).
        for dialect in others.rows().filter(|row| !row.has_heads) {
            let used = self.dialects.iter().any(|one| one.name == dialect.name);
            let seen = self.stamps.state;
            if !used
                && self.matches_of(dialect, line)
                && evidence::proven_bytes(&self.found) == self.found.len()
                && !self.found.is_empty()
            {
                self.dialects.push(Arc::clone(dialect));
                self.stamps.state.short_fractions |= dialect.short_fractions;
                self.hand_over(dialect);
                return true;
            }
            self.stamps.state = seen;
        }
        false
    }
}

/// Whether the row reads bytes in these lines, and only such that checksums prove.
fn reads_all(row: &Arc<Dialect>, text: &[u8]) -> bool {
    let mut reader = Reader::new(vec![Arc::clone(row)], None, Arc::default());
    reader.push(text);
    let (mut bytes, mut burst, mut good) = (0, Vec::new(), 0);
    while let Some((record, piece)) = reader.next(true) {
        if record.record {
            good += evidence::proven_bytes(&burst);
            burst.clear();
        }
        bytes += piece.len();
        burst.extend_from_slice(piece);
    }
    good += evidence::proven_bytes(&burst);
    // Where a program prints no checksums, its words have to do.
    bytes > 0 && (good == bytes || row.no_checksum) && reader.announced()
}

/// Whether a line can hold bytes: some digits among some hex digits.
fn may_hold_bytes(line: &[u8]) -> bool {
    let digits = line.iter().filter(|b| b.is_ascii_digit()).count();
    digits >= 4 && line.iter().filter(|b| b.is_ascii_hexdigit()).count() >= 6
}
