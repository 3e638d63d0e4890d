//! The bytes ahead of a frame that has begun, and whether it ends among them.

use crate::framer::rtu::search::commit::state::Completion;
use crate::input::Input;
use crate::rtu_model::crc_scan::MAX_CANDIDATE_BYTES;
use modlens_protocol::checksum::{crc_valid_at, first_valid_length};
use modlens_protocol::functions::Extent;

/// The bytes ahead that a frame which has begun may have.
pub(super) struct FrameAhead<'a> {
    /// All bytes that have come, from the first one of the frame on.
    pub(super) bytes: &'a [u8],
    /// How many of them are scanned: a frame that is no longer has been found already.
    pub(super) scanned_length: usize,
    /// The input that they are in, and the index of the first of them.
    pub(super) input: &'a Input,
    pub(super) at: usize,
}

impl<'a> FrameAhead<'a> {
    /// The most bytes that the frame can have, because none crosses a break or a record's start. More than `bytes` has where no
    /// such boundary has come yet.
    pub(super) fn max_length(&self) -> usize {
        max_frame_length(self.input, self.at)
    }

    /// Whether the frame ends after the bytes scanned with a valid CRC, if its header announces this length, which is not open.
    /// A least length is not looked up. `Unknown` where bytes are missing.
    #[inline]
    pub(super) fn look_up(&self, extent: Extent) -> Completion {
        let (length, is_exact) = match extent {
            Extent::Exactly(length) => (length, true),
            // The bytes that tell the length have not come: a least length is always more than there is.
            Extent::AtLeast(length) | Extent::Open(length) => (length, false),
        };
        if length > MAX_CANDIDATE_BYTES {
            return Completion::Never;
        }
        let is_there = length <= self.bytes.len();
        // Nearly always this is true, and where the boundaries are does not matter.
        if is_there && !(is_exact && length > self.scanned_length && crc_valid_at(self.bytes, length)) {
            return Completion::Never;
        }
        match length > self.max_length() {
            true => Completion::Never,
            false if is_there => Completion::Completes,
            false => Completion::Unknown,
        }
    }

    /// The same where the length is open and unit and function are familiar.
    pub(super) fn look_up_open(&self) -> Completion {
        let max_length = self.max_length();
        match has_valid_length(self.bytes, self.scanned_length + 1, max_length) {
            false if max_length > self.bytes.len() => Completion::Unknown,
            completes => Completion::if_found(completes),
        }
    }

    /// The bytes of the frame, if its header announces exactly a length that is more than the bytes scanned, possible, and there
    /// already.
    pub(super) fn of_exact_length(&self, extent: Extent) -> Option<&'a [u8]> {
        match extent {
            Extent::Exactly(length) if length > self.scanned_length && length <= self.max_length() => self.bytes.get(..length),
            _ => None,
        }
    }
}

/// Whether the CRC is valid in any length from `min_length` to `max_length`, both included, as far as the bytes have come.
pub(super) fn has_valid_length(bytes: &[u8], min_length: usize, max_length: usize) -> bool {
    first_valid_length(&bytes[..max_length.min(bytes.len())], min_length).is_some()
}

/// The most bytes that a frame at this index of the input can have: none crosses a break or a record's start, and none has more
/// than `MAX_CANDIDATE_BYTES`, whether these have come or not.
pub(super) fn max_frame_length(input: &Input, at: usize) -> usize {
    let rest = input.bytes().len() - at;
    let edge = input.boundary_after(at, at + rest.min(MAX_CANDIDATE_BYTES) - 1, input.break_ns);
    edge.map_or(MAX_CANDIDATE_BYTES, |edge| edge - at)
}
