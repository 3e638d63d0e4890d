//! Lines over which the hex of a frame is wrapped.

use crate::text::proved::only_hex;

/// Lines of nothing but hex, each right below the one before, which are no frame so far.
#[derive(Debug, Default)]
pub(super) struct WrappedLines {
    lines: Vec<Wrapped>,
}

/// Such a line, which was counted as unread.
#[derive(Debug)]
pub(super) struct Wrapped {
    pub number: u64,
    pub text: Vec<u8>,
    pub bytes: Vec<u8>,
}

impl WrappedLines {
    /// Forgets the lines, unless this one is right below them.
    pub fn keep_above(&mut self, number: u64) {
        let is_next = self.lines.last().is_some_and(|last| last.number + 1 == number);
        if !is_next {
            self.lines.clear();
        }
    }

    /// Notes a line that nothing reads.
    pub fn note(&mut self, number: u64, text: &[u8]) {
        if let Some(bytes) = only_hex(text) {
            self.lines.push(Wrapped { number, text: text.to_vec(), bytes });
        }
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.lines.len() as u64
    }

    /// Returns them, and forgets them.
    pub fn take(&mut self) -> Vec<Wrapped> {
        std::mem::take(&mut self.lines)
    }

    /// The bytes of all.
    pub fn bytes(&self) -> Vec<u8> {
        self.lines.iter().flat_map(|line| line.bytes.iter().copied()).collect()
    }
}
