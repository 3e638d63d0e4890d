//! Splits text into words, for all notations.

use std::ops::Range;

/// What a notation has found beside the bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::text) struct NotationFlags {
    /// A placeholder stands where the checksum should be.
    pub no_checksum: bool,
}

/// How many characters or bytes are processed at once, without a branch for each, where the text is regular.
pub(super) const CHARS_PER_STEP: usize = 8;

/// The word at position `from`: letters, digits and question marks, possibly none.
pub(super) fn word(text: &[u8], from: usize) -> &[u8] {
    // The test has no branches, so that the compiler checks several characters of a long word at once.
    let within = |b: u8| (b | 0x20).wrapping_sub(b'a') < 26 || b.wrapping_sub(b'0') < 10 || b == b'?';
    let rest = &text[from..];
    let blocks = rest.chunks_exact(CHARS_PER_STEP).take_while(|block| block.iter().fold(true, |all, &b| all & within(b)));
    let length = CHARS_PER_STEP * blocks.count();
    let more = rest[length..].iter().take_while(|&&b| within(b)).count();
    &rest[..length + more]
}

/// Whether the number at this place in a text is in a bracket and counts bytes, as in `[16 bytes of data]`.
pub(in crate::text) fn counts_what_follows(text: &[u8], place: &Range<usize>) -> bool {
    let is_in_bracket = text[..place.start].last().is_some_and(|b| matches!(b, b'[' | b'('));
    is_in_bracket && text[place.end..].get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b" byte"))
}
