//! What came before a transaction.

/// What came before a transaction on its bus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Before {
    /// Unit of the transaction before, and whether that was not answered.
    pub previous: Option<(u8, bool)>,
    /// Whether a write was among the four transactions before.
    pub written: bool,
}
