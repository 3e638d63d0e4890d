//! What a search is given.

use modlens_protocol::Ns;

/// A read of a port while the settings are searched.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SearchRead {
    /// The owner's number of the port.
    pub port: usize,
    /// The line of a bus that is tapped on two: 1 or 2; 0 for the only one.
    pub line: u8,
    /// When the read returned, in ns.
    pub time: Ns,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Positions of bytes that the receiver has marked.
    pub errors: Vec<u32>,
    /// Bytes were lost before.
    pub follows_loss: bool,
    /// The recorder has it already.
    pub is_recorded: bool,
}
