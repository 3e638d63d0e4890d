//! Lines over which the hex of a frame is wrapped.

/// Lines of nothing but hex, each right below the one before, which are no frame so far.
#[derive(Debug, Default)]
pub(super) struct WrappedLines {
    pub lines: Vec<Wrapped>,
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

    pub fn bytes(&self) -> Vec<u8> {
        self.lines.iter().flat_map(|line| line.bytes.iter().copied()).collect()
    }
}
