//! Where something is in a recording.

use modlens_protocol::Ns;

/// A place in a recording: the number of a transaction and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the transaction; 0 where none is near.
    pub number: u64,
    /// Start of it, since the beginning of the recording.
    pub elapsed: Option<Ns>,
    /// Start of it.
    pub time: Option<Ns>,
}
