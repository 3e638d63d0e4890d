//! Finds another dialect for lines that those in use cannot read.

use std::sync::Arc;

use crate::text::dialect::Dialect;
use crate::text::frame_evidence;
use crate::text::reader::Reader;

/// How many single lines of a text are tried with all rows; a bound on the time that foreign text may cost.
const MAX_SINGLE_LINE_TRIES: u32 = 4000;

/// How many lines are tried together with those before them, which costs more.
const MAX_UNREAD_LINE_TRIES: u32 = 1000;

/// How many unread lines are kept for dialects that print a frame over several lines.
const MAX_UNREAD_LINES: usize = 12;

/// How many characters of each unread line are kept.
const MAX_UNREAD_CHARS: usize = 400;

impl Reader {
    /// Looks for a dialect with several lines per frame that reads this line together with the unread lines before it. If
    /// there is one, it is used from here on and the lines are read with it. Returns whether there is one.
    pub(super) fn read_with_unread_lines(&mut self, line: &[u8]) -> bool {
        let Some(others) = self.others.clone() else { return false };
        if self.unread.len() >= MAX_UNREAD_LINES {
            self.unread.pop_front();
        }
        self.unread.push_back((self.number, line[..line.len().min(MAX_UNREAD_CHARS)].to_vec()));
        if self.unread_line_tries >= MAX_UNREAD_LINE_TRIES || !line.iter().any(u8::is_ascii_digit) {
            return false;
        }
        self.unread_line_tries += 1;
        let mut text = Vec::new();
        for (_, line) in &self.unread {
            text.extend_from_slice(line);
            text.push(b'\n');
        }
        let reads = |row: &&Arc<Dialect>| row.is_multi_line() && row.may_match(&text) && proves_all_bytes(row, &text);
        let used = |row: &Arc<Dialect>| self.dialects.iter().any(|one| one.name == row.name);
        let Some(row) = others.rows().filter(|row| !used(row)).find(reads) else { return false };
        self.dialects.push(Arc::clone(row));
        self.timestamps.state.short_fractions |= row.may_have_short_fractions;
        // All of these lines but the last one were counted as unparsed.
        self.assembler.end_announcement(&self.timestamps);
        let lines = std::mem::take(&mut self.unread);
        for (number, line) in lines.iter().take(lines.len() - 1) {
            self.unread_lines.remove(*number, line);
        }
        for (number, line) in lines {
            self.assembler.number = number;
            if self.collect_matches(row, &line) {
                self.deliver_matches(row);
            } else if !line.trim_ascii().is_empty() {
                self.note_unparsed_at(number, line.trim_ascii());
            }
        }
        true
    }

    /// Looks for a dialect that reads the line alone, and whose bytes are proven by checksums. If there is one, it is used
    /// from here on and the line is read with it. Returns whether there is one.
    pub(super) fn read_with_another_dialect(&mut self, line: &[u8]) -> bool {
        let Some(others) = self.others.clone() else { return false };
        if self.single_line_tries >= MAX_SINGLE_LINE_TRIES || !may_hold_bytes(line) {
            return false;
        }
        self.single_line_tries += 1;
        // Dialects with header lines need these lines, too: `read_with_unread_lines` tries them.
        for dialect in others.rows().filter(|row| !row.has_headers) {
            let used = self.dialects.iter().any(|one| one.name == dialect.name);
            let saved_state = self.timestamps.state;
            if !used
                && self.collect_matches(dialect, line)
                && frame_evidence::proven_bytes(&self.found) == self.found.len()
                && !self.found.is_empty()
            {
                self.dialects.push(Arc::clone(dialect));
                self.timestamps.state.short_fractions |= dialect.may_have_short_fractions;
                self.deliver_matches(dialect);
                return true;
            }
            self.timestamps.state = saved_state;
        }
        false
    }
}

/// Whether the row reads bytes in these lines and checksums prove all of them.
fn proves_all_bytes(row: &Arc<Dialect>, text: &[u8]) -> bool {
    let mut reader = Reader::to_count(vec![Arc::clone(row)]);
    reader.push(text);
    let (mut bytes, mut burst, mut good) = (0, Vec::new(), 0);
    while let Some((record, piece)) = reader.next(true) {
        if record.starts_record {
            good += frame_evidence::proven_bytes(&burst);
            burst.clear();
        }
        bytes += piece.len();
        burst.extend_from_slice(piece);
    }
    good += frame_evidence::proven_bytes(&burst);
    // Where a program prints no checksums, matching its fixed text has to be enough.
    bytes > 0 && (good == bytes || row.no_checksum) && reader.has_announced_bytes()
}

/// Whether a line is worth trying: it has at least four digits and six hex digits, as a short frame in hex has.
fn may_hold_bytes(line: &[u8]) -> bool {
    let digits = line.iter().filter(|b| b.is_ascii_digit()).count();
    digits >= 4 && line.iter().filter(|b| b.is_ascii_hexdigit()).count() >= 6
}
