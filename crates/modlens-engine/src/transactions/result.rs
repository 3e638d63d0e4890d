//! What pairing reports about a frame, at once or later.

use modlens_protocol::finding::Finding;
use modlens_protocol::Ns;

/// The result of pairing one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairingResult {
    /// The transaction of the frame.
    pub txn: Option<u64>,
    /// A finding on the transaction that belongs to the row of this frame.
    pub finding: Option<Finding>,
    /// The other transaction that the finding's detail names.
    pub other: Option<u64>,
}

/// A finding on a frame whose row is already written.
#[derive(Clone, Copy, Debug)]
pub struct DelayedFinding {
    /// The finding.
    pub finding: Finding,
    /// The frame that it is about.
    pub location: FrameLocation,
    /// The other transaction involved.
    pub other_txn: u64,
}

/// Which frame a finding is about, for a row that is written after that frame's own row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLocation {
    /// The transaction of the frame.
    pub txn: u64,
    /// Running number of the frame.
    pub frame: u64,
    /// The unit in the frame.
    pub unit: u8,
    /// Start of the frame.
    pub start: Option<Ns>,
    /// Line or packet number in the recording, or the stream offset.
    pub origin: u64,
}

/// Two transactions that overlap: the response to the first came after the request of the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overlap {
    /// The response to the first request.
    pub response: FrameLocation,
    /// The transaction of the second request.
    pub later_txn: u64,
    /// By the clock, the master cannot have given up the first request before the second one was sent.
    pub timeout_excluded: bool,
}
