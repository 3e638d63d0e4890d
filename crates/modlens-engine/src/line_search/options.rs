//! The options of a search.

use modlens_protocol::framing::Mode;

/// What is known before the search begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SearchOptions {
    /// The driver marks line errors.
    pub marks_errors: bool,
    /// Bytes with line errors are taken out: wrong settings may give no bytes at all, so that trials end by time, too.
    pub drops_damaged: bool,
    /// The framing, if it is known: RTU or ASCII.
    pub mode: Option<Mode>,
}
