//! The lines of a text that nothing could read: their number, and those of them that hold most hex.

use crate::text::oddities::{self, UnreadLine};
use crate::text::proved::{hex_bytes, is_byte_line};
use crate::text::reports::Said;

/// So many lines in a row that hold a byte each are bytes.
const MIN_LISTED: u64 = 5;

/// How many lines are kept so that users can see examples.
const MAX_EXAMPLES: usize = 3;

/// How many characters of such a line are kept.
const MAX_EXAMPLE_CHARS: usize = 120;

/// So many of these lines are kept to be judged, and of each so many bytes.
const MAX_KEPT: usize = 200;
const MAX_KEPT_BYTES: usize = 1000;

/// What could not be read of a text.
#[derive(Clone, Debug, Default)]
pub struct UnreadLines {
    /// Only their number is asked for: what hex they hold takes far longer to find than that no dialect reads them.
    is_only_counted: bool,
    /// How many lines could not be read.
    pub count: u64,
    /// How many of these lines hold hex, but for dates and times.
    pub with_hex: u64,
    /// How many bytes of hex these lines hold.
    pub hex_bytes: u64,
    /// The lines with most hex; of lines with equally many bytes the first. Number, text, bytes of hex.
    pub examples: Vec<(u64, String, usize)>,
    /// How many lines with a byte each are the last ones, and the number of the last of them.
    listed: u64,
    last_listed: u64,
    /// The first of these lines, each with the frame that was read shortly before it.
    kept: Vec<(u64, Vec<u8>, Vec<u8>)>,
}

impl UnreadLines {
    /// Counts lines, and looks for nothing in them.
    pub(super) fn only_counted() -> Self {
        Self { is_only_counted: true, ..Self::default() }
    }

    /// Whether nothing but their number is asked for.
    pub(super) fn only_counts(&self) -> bool {
        self.is_only_counted
    }

    /// Counts a line; `before` is the frame that was read shortly before it.
    pub(super) fn add(&mut self, number: u64, line: &[u8], before: &[u8]) {
        self.count += 1;
        if self.is_only_counted {
            return;
        }
        if self.kept.len() < MAX_KEPT {
            self.kept.push((number, line[..line.len().min(MAX_KEPT_BYTES)].to_vec(), before.to_vec()));
        }
        let bytes = hex_bytes(line);
        self.with_hex += u64::from(bytes > 0);
        self.hex_bytes += bytes as u64;
        if bytes == 0 && is_byte_line(line) {
            self.listed = if self.last_listed + 1 == number { self.listed + 1 } else { 1 };
            self.last_listed = number;
            let new = if self.listed == MIN_LISTED { MIN_LISTED } else { u64::from(self.listed > MIN_LISTED) };
            (self.with_hex, self.hex_bytes) = (self.with_hex + new, self.hex_bytes + new);
        }
        let place = self.examples.iter().position(|(_, _, other)| bytes > *other).unwrap_or(self.examples.len());
        if place < MAX_EXAMPLES {
            let text: String = String::from_utf8_lossy(line).chars().take(MAX_EXAMPLE_CHARS).collect();
            self.examples.insert(place, (number, text, bytes));
            self.examples.truncate(MAX_EXAMPLES);
        }
    }

    /// Takes back a line that was read after all, with lines after it.
    pub(super) fn remove(&mut self, number: u64, line: &[u8]) {
        self.count = self.count.saturating_sub(1);
        if self.is_only_counted {
            return;
        }
        let bytes = hex_bytes(line);
        let is_listed = bytes == 0 && self.listed >= MIN_LISTED && self.last_listed < number + self.listed && is_byte_line(line);
        let bytes = bytes + usize::from(is_listed);
        self.with_hex = self.with_hex.saturating_sub(u64::from(bytes > 0));
        self.hex_bytes = self.hex_bytes.saturating_sub(bytes as u64);
        self.examples.retain(|(other, _, _)| *other != number);
        self.kept.retain(|(other, _, _)| *other != number);
    }

    /// What the bytes of these lines show, or what the lines report in words, or that they hold hex; `None` if they say nothing.
    pub fn says(&self) -> Option<Said> {
        let lines = self.kept.iter().map(|(number, text, before)| UnreadLine { number: *number, text, before });
        let hex = || {
            let completed = oddities::completed(lines.clone());
            let count = self.with_hex.saturating_sub(completed.len() as u64);
            let most = self.examples.iter().map(|(number, ..)| *number).find(|number| !completed.contains(number));
            most.filter(|_| count > 0).map(|most| Said::of_hex(count, most))
        };
        oddities::named_lines(lines.clone()).or_else(hex)
    }
}
