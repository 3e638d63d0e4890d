//! The input of the engine: bytes from one line of one bus, with what their source knows about them.

use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Who transmitted the bytes, seen from the program that logged them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The logging program, as logs say with `Tx`, `send` or `>>`.
    Sent,
    /// Its peer, as logs say with `Rx`, `recv` or `<<`.
    Received,
}

impl Side {
    /// The other of the two.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Sent => Self::Received,
            Self::Received => Self::Sent,
        }
    }
}

/// What is known of the times of the bytes.
#[derive(Clone, Copy, Debug, Default)]
pub enum Times<'a> {
    /// Nothing.
    #[default]
    None,
    /// The time at which the read returned, which is never before the stop bit of its last byte.
    Read(Ns),
    /// The time at which the stop bit of each byte ended, one per byte.
    Bytes(&'a [Ns]),
}

/// Bytes with what is known of them. Only `bytes` is mandatory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Chunk<'a> {
    /// Which line of the bus: 0 for the only one, 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// The bytes.
    pub bytes: &'a [u8],
    /// The times at which they were received.
    pub times: Times<'a>,
    /// Who sent them, where the recording states it.
    pub side: Option<Side>,
    /// A record of the recording starts here, so no frame is expected to continue across this place.
    pub starts_record: bool,
    /// The receiver reported a parity error, a framing error or a break for some of these bytes.
    pub has_line_error: bool,
    /// Positions in `bytes`, in ascending order, for which the receiver reported an error, if it does so byte by byte.
    pub error_positions: &'a [u32],
    /// Bytes were lost before these.
    pub follows_loss: bool,
    /// The recording prints frames without their checksum.
    pub lacks_checksum: bool,
    /// The framing that a valid checksum or length proves for these bytes, which are then a whole record.
    pub proven_framing: Option<Mode>,
    /// Number of the line or packet in the file; 0 in files where the offset is the place.
    pub origin: u64,
}

impl Chunk<'_> {
    /// When its last byte was received.
    pub fn time(&self) -> Option<Ns> {
        match self.times {
            Times::None => None,
            Times::Read(time) => Some(time),
            Times::Bytes(times) => times.last().copied(),
        }
    }
}
