//! What was received with one line setting.

use std::sync::Arc;

use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use super::read::SearchRead;

/// Bytes after which the first burst is over in any case. It may have begun in the middle of a frame, so its line errors
/// prove nothing.
const FIRST_BURST_BYTES: usize = 40;
/// A pause that ends a burst: so many characters, and what an adapter is late.
const GAP_CHARACTERS: Ns = 5;
const GAP_NS: Ns = 3_000_000;
/// Only the newest bytes tell whether a trial is text: a receiver that starts inside a burst reads garbage up to its end.
const NEWEST_BYTES: usize = 24;
const TEXT_SHARE: f64 = 0.9;

/// What was received with one line setting.
pub(super) struct Trial {
    pub line: LineSettings,
    pub reads: Vec<Arc<SearchRead>>,
    pub bytes: Vec<u8>,
    pub marked_bytes: usize,
    /// Bytes and line errors after the first burst.
    pub settled_bytes: usize,
    pub settled_errors: usize,
    /// The time of the last read.
    pub last: Option<Ns>,
    /// Bursts that have ended; those that ended in 00 hint at swapped wires.
    pub bursts: usize,
    pub bursts_ending_in_zero: usize,
}

impl Trial {
    /// A trial that has heard nothing yet.
    pub fn new(line: LineSettings) -> Self {
        Self {
            line,
            reads: Vec::new(),
            bytes: Vec::new(),
            marked_bytes: 0,
            settled_bytes: 0,
            settled_errors: 0,
            last: None,
            bursts: 0,
            bursts_ending_in_zero: 0,
        }
    }

    /// Adds a read.
    pub fn add(&mut self, read: &Arc<SearchRead>) {
        let gap = GAP_CHARACTERS * self.line.char_ns() + GAP_NS;
        if self.last.is_some_and(|last| read.time - last > gap) {
            self.bursts += 1;
            self.bursts_ending_in_zero += usize::from(self.bytes.last() == Some(&0));
        }
        if self.bursts > 0 || self.bytes.len() >= FIRST_BURST_BYTES {
            self.settled_bytes += read.bytes.len();
            self.settled_errors += read.errors.len();
        }
        self.last = Some(read.time);
        self.bytes.extend_from_slice(&read.bytes);
        self.marked_bytes += read.errors.len();
        self.reads.push(Arc::clone(read));
    }

    /// How many bytes are 00.
    pub fn zeros(&self) -> usize {
        self.bytes.iter().map(|byte| usize::from(*byte == 0)).sum()
    }

    /// Whether the newest bytes are characters of Modbus ASCII frames, whatever bit 7 is.
    pub fn looks_like_text(&self) -> bool {
        let newest = &self.bytes[self.bytes.len().saturating_sub(NEWEST_BYTES)..];
        let text = newest.iter().filter(|byte| is_of_ascii_frames(**byte)).count();
        text as f64 >= TEXT_SHARE * newest.len() as f64
    }
}

/// Whether the low seven bits are a character of Modbus ASCII.
pub(super) fn is_of_ascii_frames(byte: u8) -> bool {
    matches!(byte & 0x7F, b':' | b'0'..=b'9' | b'A'..=b'F' | b'a'..=b'f' | b'\r' | b'\n')
}
