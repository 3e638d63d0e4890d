//! The rest of a frame that an earlier line has begun: a line with words, or several lines of nothing but hex, as a terminal or a
//! text field wraps them. The checksum at its end proves that they belong together.

use crate::text::proved::{longest_hex, only_hex};
use crate::text::reader::wrapped::Wrapped;
use crate::text::reader::Reader;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;

/// The rest of a frame has at most so many bytes.
const MOST_BYTES: usize = 512;

impl Reader {
    /// Reads a line that completes the frame which an earlier one has begun, with those between them. Returns whether it does.
    pub(super) fn read_rest_of_frame(&mut self, line: &[u8]) -> bool {
        self.wrapped.keep_above(self.number);
        if self.proved.is_none() || !self.assembler.has_begun(self.wrapped.lines.len() as u64) {
            return false;
        }
        let between = self.wrapped.bytes();
        let own = if between.is_empty() { longest_hex(line) } else { only_hex(line) };
        let Some(bytes) = own.filter(|own| between.len() + own.len() <= MOST_BYTES) else { return false };
        if !self.assembler.completes(&[&between[..], &bytes].concat(), self.wrapped.lines.len() as u64) {
            return false;
        }
        let number = self.number;
        let lines = std::mem::take(&mut self.wrapped.lines);
        for above in lines {
            self.unread_lines.remove(above.number, &above.text);
            self.take_rest(above.number, &above.bytes);
        }
        self.take_rest(number, &bytes);
        true
    }

    /// Notes a line that nothing reads, where it may belong to the frame that an earlier one has begun.
    pub(super) fn note_rest_of_frame(&mut self, text: &[u8]) {
        if self.proved.is_none() || !self.assembler.has_begun(self.wrapped.lines.len() as u64) {
            return;
        }
        if let Some(bytes) = only_hex(text) {
            self.wrapped.lines.push(Wrapped { number: self.number, text: text.to_vec(), bytes });
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
