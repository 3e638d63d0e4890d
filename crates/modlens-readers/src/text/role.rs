//! What a line that matches a template of a dialect means for the bytes in it.

use crate::chunk::Side;

/// The meaning of a line that a template matches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineRole {
    /// It holds bytes; `None` where the log does not say who sent them.
    Bytes(Option<Side>),
    /// A header line, which announces the bytes in the lines after it.
    Header(Option<Side>),
    /// A header line for bytes that the log has printed before.
    DuplicateHeader,
    /// It holds bytes that a header line announced.
    Continuation,
    /// It holds bytes that are duplicates if the same bytes were delivered last, and new otherwise.
    PossibleDuplicate,
    /// It holds bytes that the log has printed before.
    Duplicate,
    /// The `*` of a dump: it stands for lines like the one before, as many as the next offset says.
    RepeatedLines,
    /// It belongs to the format but holds neither bytes nor times.
    Ignored,
}

impl LineRole {
    /// Whether lines with this meaning hold bytes that are delivered.
    pub fn holds_bytes(self) -> bool {
        matches!(self, Self::Bytes(_) | Self::Continuation | Self::PossibleDuplicate)
    }
}
