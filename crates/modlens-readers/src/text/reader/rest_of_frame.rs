//! The rest of a frame that an earlier line has begun: a line with words, or several lines of nothing but hex, as a terminal or a
//! text field wraps them. The checksum at its end proves that they belong together.

use crate::text::proved::{longest_hex, only_hex};
use crate::text::reader::Reader;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;

/// The rest of a frame has at most so many bytes.
const MOST_BYTES: usize = 512;

/// Lines of nothing but hex, each right below the one before, which are no frame so far.
#[derive(Debug, Default)]
pub(super) struct RestOfFrame {
    lines: Vec<Wrapped>,
}

/// Such a line, which was counted as unread.
#[derive(Debug)]
struct Wrapped {
    number: u64,
    text: Vec<u8>,
    bytes: Vec<u8>,
}

impl RestOfFrame {
    /// Forgets the lines, unless this one is right below them.
    fn keep_above(&mut self, number: u64) {
        let is_next = self.lines.last().is_some_and(|last| last.number + 1 == number);
        if !is_next {
            self.lines.clear();
        }
    }

    fn bytes(&self) -> Vec<u8> {
        self.lines.iter().flat_map(|line| line.bytes.iter().copied()).collect()
    }
}

impl Reader {
    /// Reads a line that completes the frame which an earlier one has begun, with those between them. Returns whether it does.
    pub(super) fn read_rest_of_frame(&mut self, line: &[u8]) -> bool {
        self.rest_of_frame.keep_above(self.number);
        if self.proved.is_none() || !self.assembler.has_begun(self.rest_of_frame.lines.len() as u64) {
            return false;
        }
        let between = self.rest_of_frame.bytes();
        let own = if between.is_empty() { longest_hex(line) } else { only_hex(line) };
        let Some(bytes) = own.filter(|own| between.len() + own.len() <= MOST_BYTES) else { return false };
        if !self.assembler.completes(&[&between[..], &bytes].concat(), self.rest_of_frame.lines.len() as u64) {
            return false;
        }
        let number = self.number;
        let lines = std::mem::take(&mut self.rest_of_frame.lines);
        for above in lines {
            self.unread_lines.remove(above.number, &above.text);
            self.take_rest(above.number, &above.bytes);
        }
        self.take_rest(number, &bytes);
        true
    }

    /// Notes a line that nothing reads, where it may belong to the frame that an earlier one has begun.
    pub(super) fn note_rest_of_frame(&mut self, text: &[u8]) {
        if self.proved.is_none() || !self.assembler.has_begun(self.rest_of_frame.lines.len() as u64) {
            return;
        }
        if let Some(bytes) = only_hex(text) {
            self.rest_of_frame.lines.push(Wrapped { number: self.number, text: text.to_vec(), bytes });
        }
    }

    /// Takes bytes that continue the frame of an earlier line.
    fn take_rest(&mut self, number: u64, bytes: &[u8]) {
        let Some(row) = self.proved_row.clone() else { return };
        let side = self.assembler.last_side();
        let found = LineMatch { side, ..LineMatch::default() };
        self.assembler.number = number;
        self.assembler.take(&row, LineRole::Bytes(side), &found, bytes, &self.timestamps);
    }
}
