//! Splits text into words, for all notations.

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
