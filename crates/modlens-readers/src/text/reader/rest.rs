//! Lists the hex of a line that is neither read nor skipped, so that nothing of a line which was read is lost silently.

use crate::text::date::stamp_length;
use crate::text::proved::{is_column, rest_of, MIN_REST_BYTES};
use crate::text::reader::line_bytes::BESIDE;
use crate::text::reader::Reader;

/// The most digits of an offset.
const MAX_OFFSET_DIGITS: usize = 8;

/// What the words of a line are, as far as a short look at it shows.
struct Words<'a> {
    line: &'a [u8],
    at: usize,
}

impl Words<'_> {
    /// How many bytes of hex the next word holds; dates and times hold none. `None` at the end of the line.
    fn next_bytes(&mut self) -> Option<usize> {
        let rest = &self.line[self.at..];
        self.at += rest.iter().position(u8::is_ascii_alphanumeric)?;
        let rest = &self.line[self.at..];
        let stamp = stamp_length(self.line, self.at);
        if stamp > 0 {
            self.at += stamp;
            return Some(0);
        }
        let length = rest.iter().take_while(|b| b.is_ascii_alphanumeric()).count();
        self.at += length;
        let word = &rest[..length];
        // A decimal number may be a byte as well.
        if length != 2 && length < 4 && word.iter().all(u8::is_ascii_digit) {
            return Some(1);
        }
        let digits = word.strip_prefix(b"0x").or_else(|| word.strip_prefix(b"x")).unwrap_or(word);
        let is_byte = digits.iter().all(u8::is_ascii_hexdigit) && (digits.len() < word.len() || digits.len().is_multiple_of(2));
        Some(if is_byte { digits.len().div_ceil(2) } else { 0 })
    }
}

/// The length of the offset at the start of a line of a dump; 0 if there is none.
fn offset_length(line: &[u8]) -> usize {
    let start = line.len() - line.trim_ascii_start().len();
    let digits = line[start..].iter().take_while(|b| b.is_ascii_hexdigit()).count();
    let end = start + digits;
    let is_offset = (4..=MAX_OFFSET_DIGITS).contains(&digits) && line[..end].ends_with(b"0");
    let rest = &line[end..];
    let is_apart = rest.starts_with(b": ") || rest.starts_with(b"  ") || rest.starts_with(b" | ");
    if is_offset && is_apart {
        end
    } else {
        0
    }
}

/// Whether a line holds so many bytes of hex more than were read of it that some of them may be lost.
fn may_hold_more(line: &[u8], read: usize) -> bool {
    let mut words = Words { line, at: 0 };
    let mut bytes = 0;
    while let Some(more) = words.next_bytes() {
        bytes += more;
        if bytes >= read + MIN_REST_BYTES {
            return true;
        }
    }
    false
}

impl Reader {
    /// Lists the hex of the line that was neither read nor listed.
    pub(super) fn list_rest(&mut self, line: &[u8]) {
        let line = &line[offset_length(line)..];
        let known = std::mem::take(&mut self.line_bytes.all);
        let read = known.iter().map(Vec::len).sum();
        if self.proved.is_some() && !known.is_empty() && may_hold_more(line, read) {
            for (place, bytes) in rest_of(line, &known) {
                let is_copy = known.iter().any(|known| known.windows(bytes.len()).any(|part| part == bytes));
                if is_copy || self.assembler.has_printed(&bytes) {
                    self.assembler.skip_copy(&bytes);
                } else if !known.iter().any(|known| is_column(&line[place.clone()], known)) {
                    self.assembler.skip(self.number, &bytes, BESIDE);
                }
            }
        }
        self.line_bytes.all = known;
        self.line_bytes.all.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_look_shows_whether_a_line_holds_more() {
        for (line, read, more) in [
            ("2026-11-21 12:30:05.250 TX: 07 03 00 10", 4, false),
            ("2026-11-21 12:30:05.250 TX: 07 03 00 10", 0, true),
            ("21.11.2026 12:30:05 TX 0x7 0x3 0x0 0x10", 4, false),
            ("07:03:00:10 07 03", 2, true),
            ("12:30:05", 0, false),
        ] {
            assert_eq!(may_hold_more(line.as_bytes(), read), more, "{line}");
        }
    }
}
