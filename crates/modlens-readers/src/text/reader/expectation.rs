//! Frames that a person only expects: "it should be 01 03 ...". They were never on a line, and are left out.
//!
//! The words are in front of the bytes, after them, or in the last line of prose above them; the last of several words
//! decides. Logs of programs are not asked: what they call expected is a number of bytes, and their lines begin with a time.

use crate::text::proved::Found;
use crate::text::reader::announcements::{announces, LAST_LINE};
use crate::text::reader::Reader;
use crate::text::role::LineRole;

/// The reason reported for such bytes.
const EXPECTED: &str = "bytes that should have come, as the text says";

impl Reader {
    /// Whether frames of the current line may be ones that only should have come: in a short text, after others that did.
    fn may_be_expected(&self) -> bool {
        self.is_short_text() && self.assembler.records > 0
    }

    fn is_short_text(&self) -> bool {
        self.number <= LAST_LINE && !self.is_counting()
    }

    /// Leaves out what a dialect has read in a line, if it only should have come. Returns whether it did.
    pub(super) fn leave_out_expected(&mut self, line: &[u8]) -> bool {
        let is_bytes = |(role, _, _): &(LineRole, _, _)| matches!(role, LineRole::Bytes(_));
        if !self.may_be_expected() || !self.matches.iter().all(is_bytes) {
            return false;
        }
        let start = self.matches.first().map_or(0, |(_, found, _)| found.start);
        let (front, behind) = (&line[..start], line.get(self.tail..).unwrap_or(&[]));
        self.expectation.of_what_follows &= announces(front) != Some(false);
        let is_expected = self.expectation.says(front, Some(behind));
        if is_expected {
            let found = std::mem::take(&mut self.found);
            self.assembler.skip(self.number, &found, EXPECTED);
            self.line_bytes.add(&found);
            self.found = found;
        }
        is_expected
    }

    /// Leaves out those of the bytes found in a line that only should have come.
    pub(super) fn without_expected(&mut self, line: &[u8], all: Vec<Found>) -> Vec<Found> {
        let is_first = !self.may_be_expected();
        if (is_first && !(self.is_short_text() && all.len() > 1)) || all.iter().any(|one| !one.earlier.is_empty()) {
            return all;
        }
        let fronts: Vec<&[u8]> = all.iter().map(|one| &line[one.front.clone()]).collect();
        self.expectation.of_what_follows &= fronts.iter().all(|front| announces(front) != Some(false));
        let last = all.len().saturating_sub(1);
        let expected: Vec<bool> = fronts.iter().map(|front| self.expectation.says(front, None)).collect();
        let mut kept = Vec::new();
        for (at, (one, is_expected)) in all.into_iter().zip(expected).enumerate() {
            let is_behind = at == last && announces(behind(line, &one)) == Some(true);
            // In the first line with bytes, some of them have to have come.
            if (is_expected || is_behind) && !(is_first && kept.is_empty()) {
                self.assembler.skip(self.number, &one.bytes, EXPECTED);
                self.line_bytes.add(&one.bytes);
            } else {
                kept.push(one);
            }
        }
        kept
    }
}

/// The text after the last letters and digits that may be bytes.
fn behind<'a>(line: &'a [u8], last: &Found) -> &'a [u8] {
    let rest = &line[last.front.end..];
    let is_word = |at: usize| {
        rest[at..]
            .iter()
            .take_while(|byte| byte.is_ascii_alphanumeric())
            .any(|byte| byte.is_ascii_alphabetic() && !byte.is_ascii_hexdigit())
    };
    let at = (0..rest.len()).find(|&at| (at == 0 || !rest[at - 1].is_ascii_alphanumeric()) && is_word(at));
    at.map_or(&[], |at| &rest[at..])
}
