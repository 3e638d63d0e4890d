//! The bytes of an RTU frame by the names of its parts (serial line specification, 2.5.1).

use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::functions::EXCEPTION_BIT;

/// The bytes of one RTU frame, from its unit to its CRC, both included. Whoever makes it guarantees at least four bytes: unit,
/// function code and CRC. Whether the CRC is valid is not said.
#[derive(Clone, Copy)]
pub struct FrameBytes<'a>(pub &'a [u8]);

impl<'a> FrameBytes<'a> {
    /// The first byte: the unit that the frame is addressed to or comes from.
    #[inline]
    pub fn unit(self) -> u8 {
        self.0[0]
    }

    /// The second byte: the function code, with the exception bit if it is set.
    #[inline]
    pub fn code(self) -> u8 {
        self.0[1]
    }

    /// Whether the exception bit of the function code is set, as it is in exception responses (application protocol, 7).
    #[inline]
    pub fn is_exception(self) -> bool {
        self.code() & EXCEPTION_BIT != 0
    }

    /// All bytes but unit and CRC: function code and body.
    #[inline]
    pub fn pdu(self) -> &'a [u8] {
        &self.0[1..self.0.len() - CRC_BYTES]
    }

    /// The bytes after the function code and before the CRC; may be empty.
    #[inline]
    pub fn body(self) -> &'a [u8] {
        &self.0[2..self.0.len() - CRC_BYTES]
    }

    /// The last two bytes.
    #[inline]
    pub fn crc(self) -> &'a [u8] {
        &self.0[self.0.len() - CRC_BYTES..]
    }
}
