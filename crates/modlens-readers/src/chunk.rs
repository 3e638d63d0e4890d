//! What enters the core: bytes off one line of one bus, with what the source knows about them.

use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Who put the bytes on the line, in the words of the log that they come from: relative to the logging process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// `Tx`, `send`, `>>`.
    Sent,
    /// `Rx`, `recv`, `<<`.
    Received,
}

/// When the bytes came.
#[derive(Clone, Copy, Debug, Default)]
pub enum Times<'a> {
    /// Not known.
    #[default]
    None,
    /// When the read returned: never before the last byte's stop bit.
    Read(Ns),
    /// When each byte's stop bit ended; as many as bytes.
    Bytes(&'a [Ns]),
}

/// Bytes and what is known of them. Only `bytes` is mandatory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Chunk<'a> {
    /// Which line of the bus: 0, or 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// The bytes.
    pub bytes: &'a [u8],
    /// When they came.
    pub times: Times<'a>,
    /// Who sent them, where the recording says so.
    pub side: Option<Side>,
    /// A record of the recording starts here: a frame is not expected to reach across.
    pub starts_record: bool,
    /// The receiver marked a parity, framing or break error in these bytes.
    pub has_line_error: bool,
    /// Which of these bytes the receiver marked, where it says so byte by byte; positions in `bytes`, rising.
    pub error_positions: &'a [u32],
    /// Bytes were lost before these.
    pub follows_loss: bool,
    /// The recording prints frames without their checksum.
    pub lacks_checksum: bool,
    /// The framing that these bytes, a whole record, prove by themselves.
    pub proven_framing: Option<Mode>,
    /// Line or packet number in the file; 0 where the offset is the place.
    pub origin: u64,
}

impl Chunk<'_> {
    /// When its last byte had come.
    pub fn time(&self) -> Option<Ns> {
        match self.times {
            Times::None => None,
            Times::Read(time) => Some(time),
            Times::Bytes(times) => times.last().copied(),
        }
    }
}
