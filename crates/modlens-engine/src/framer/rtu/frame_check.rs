//! The result of the fast path's check of one frame, and what a request determines of its response.

use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use modlens_protocol::direction::expected_data_bytes;
use modlens_protocol::functions::{Extent, FunctionRow};

/// The result of checking the next header.
pub enum FrameCheck {
    /// A frame: the response to the outstanding request, or a request.
    Frame(FrameLength),
    /// More bytes are needed to tell.
    NeedsMoreBytes,
    /// No frame that is beyond doubt: the search has to decide.
    NoFrame,
}

/// How many of the first bytes are a frame if their CRC is valid, whether their header announces exactly that number, and
/// whether they are a request.
///
/// All of it is packed into one number, because it passes from function to function for every frame.
#[derive(Clone, Copy)]
pub struct FrameLength(u32);

impl FrameLength {
    const EXACT: u32 = 1;
    const REQUEST: u32 = 2;

    /// Returns a length in bytes that the header announces.
    pub fn exactly(bytes: usize) -> Self {
        Self((bytes as u32) << 2 | Self::EXACT)
    }

    /// Returns the least length in bytes that the header admits; the frame may be longer.
    pub fn at_least(bytes: usize) -> Self {
        Self((bytes as u32) << 2)
    }

    /// Returns the same length, of a frame that is a request.
    pub fn as_request(self) -> Self {
        Self(self.0 | Self::REQUEST)
    }

    /// Returns the length of a frame whose body has this extent, if the extent bounds it.
    pub fn of(extent: Extent) -> Option<Self> {
        match extent {
            Extent::Exactly(length) => Some(Self::exactly(length + ENVELOPE_BYTES)),
            Extent::AtLeast(length) => Some(Self::at_least(length + ENVELOPE_BYTES)),
            Extent::Open(_) => None,
        }
    }

    /// Returns the length in bytes.
    pub fn bytes(self) -> usize {
        (self.0 >> 2) as usize
    }

    /// Returns whether the frame is a request.
    pub fn is_request(self) -> bool {
        self.0 & Self::REQUEST != 0
    }

    /// Returns whether the header announces exactly this length.
    pub fn is_exact(self) -> bool {
        self.0 & Self::EXACT != 0
    }
}

/// Returns the byte count that the response to this request begins with, and the length of the whole response frame in bytes, if
/// the request determines them and the request cannot be taken for its own response.
#[inline]
pub fn expected_response(row: &FunctionRow, pdu: &[u8]) -> Option<(u8, usize)> {
    let count = expected_data_bytes(row, pdu).filter(|_| !row.has_equal_layouts)?;
    let count = u8::try_from(count).ok()?;
    match row.response.extent(&[count]) {
        // For instance 24 inputs from an address 0x03xx on: the request has the length and the first bytes of its response.
        Extent::Exactly(length) if length == pdu.len() - 1 && pdu.get(1) == Some(&count) => None,
        Extent::Exactly(length) if length + ENVELOPE_BYTES <= MAX_CANDIDATE_BYTES => Some((count, length + ENVELOPE_BYTES)),
        _ => None,
    }
}

/// Returns whether the frame of this length at the head of these bytes is followed by the same frame again; `None` if more
/// bytes are needed to tell.
pub(crate) fn is_followed_by_copy(bytes: &[u8], length: usize) -> Option<bool> {
    let second = bytes.get(length..).unwrap_or(&[]);
    let compared = second.len().min(length);
    if second[..compared] != bytes[..compared] {
        return Some(false);
    }
    (compared == length).then_some(true)
}
