//! A line that is a label for the bytes below it: `TX:`, `Request`, `Station 5 <-`, `Sent 8 bytes`.

use crate::text::proved::{hex_bytes, label_of_remark};
use crate::text::reader::prose::is_sentence;

/// A longer line is no label.
const MAX_CHARS: usize = 100;

/// A label that was read, and the bytes below it so far.
#[derive(Debug, Default)]
pub(super) struct Label {
    pub text: Vec<u8>,
    /// The line of the label or of the last bytes below it, and the line of the label.
    pub number: u64,
    pub own_number: u64,
    pub bytes: Vec<u8>,
}

/// The text of a line that may be a label; `None` for any other.
pub(super) fn label_text(line: &[u8]) -> Option<&[u8]> {
    let text = line.trim_ascii();
    // Characters of other scripts take several bytes.
    let chars = text.iter().filter(|&&b| b & 0xC0 != 0x80).take(MAX_CHARS + 1).count();
    let is_short = !text.is_empty() && chars <= MAX_CHARS;
    (is_short && hex_bytes(text) == 0 && (!is_sentence(text) || label_of_remark(text).is_some())).then_some(text)
}
