//! Whether a log shows bytes again that it has printed before.

use super::{DeviceStream, EntryAssembler, EntryBytes, DUPLICATE};
use crate::chunk::Side;
use crate::text::frame_evidence::check_frame;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::PREFIX_BYTES;
use modlens_protocol::Ns;

/// A copy of a frame is at most so many lines after it.
const MAX_LINES_TO_COPY: u64 = 10;

/// The functions whose response repeats the request: Write Single Coil and Register, Diagnostics, Mask Write Register
/// (application protocol, 6.5, 6.6, 6.8, 6.16).
const ECHOED: [u8; 4] = [5, 6, 8, 22];

/// Whether the frame may be a request or the response that repeats it.
fn is_echoed(bytes: &[u8]) -> bool {
    let at = if check_frame(bytes).1 == Some(Mode::Tcp) { 7 } else { 1 };
    bytes.get(at).is_some_and(|code| ECHOED.contains(code))
}

/// A line that is logged twice has the second copy at most so much later: a program takes longer to read twice.
const MAX_TO_LOG_TWICE: Ns = 1_000_000;

/// A frame is received in so much time at the longest: 256 characters at 4800 Bd, and pauses of the system.
const MAX_TO_RECEIVE: Ns = 1_000_000_000;

/// Unit, function and byte count: less may begin two frames.
const MIN_BEGINNING: usize = 3;

impl EntryAssembler {
    /// Whether the log has printed these bytes last.
    pub fn has_printed(&self, bytes: &[u8]) -> bool {
        self.printed_before(0, bytes) == bytes.len()
    }

    /// How many of the bytes the log has printed last: all of them, or what is before the new ones in a buffer that grows.
    pub(super) fn printed_before(&self, key: usize, bytes: &[u8]) -> usize {
        let Some(stream) = self.streams.get(key) else { return 0 };
        let grows = stream.side == Some(Side::Received) && bytes.starts_with(&stream.group);
        let before = bytes.strip_suffix(&stream.group[..]).unwrap_or(bytes);
        // What was left of earlier reads is printed again after the last one in its line, and in front of it in the next.
        let is_rest = stream.number == self.number && stream.previous.ends_with(bytes);
        let has_rest_in_front = stream.side == Some(Side::Received) && before.len() < bytes.len() && !stream.group.is_empty();
        let are_both = bytes.strip_prefix(&stream.group[..]).is_some_and(|rest| !rest.is_empty() && rest == stream.previous);
        let ends_with_last = before.len() < bytes.len() && stream.previous.ends_with(before);
        let is_part = stream.group.starts_with(bytes) || stream.group.ends_with(bytes);
        if is_part || ends_with_last || has_rest_in_front || are_both || is_rest {
            bytes.len()
        } else if grows {
            stream.group.len()
        } else {
            0
        }
    }

    /// How many bytes a receive buffer held before that the next line prints with more after them: all of a frame so far.
    pub(super) fn grown(&self, entry_bytes: &EntryBytes<'_>) -> usize {
        let Some(stream) = self.streams.get(entry_bytes.key).filter(|stream| stream.is_mid_frame) else { return 0 };
        let side = entry_bytes.side.or(self.side_of_others).filter(|_| !self.ignores_sides);
        let is_next = stream.number + 1 == entry_bytes.number && stream.side == side && side != Some(Side::Sent);
        let is_soon = stream.time.zip(entry_bytes.time).is_none_or(|(one, other)| (0..=MAX_TO_RECEIVE).contains(&(other - one)));
        let before = stream.group.len();
        let has_more = entry_bytes.bytes.len() > before && entry_bytes.bytes.starts_with(&stream.group);
        if is_next && is_soon && has_more && before >= MIN_BEGINNING {
            before
        } else {
            0
        }
    }

    /// Whether this frame is the one that was delivered last, and a few lines ago. A request that its response echoes is no
    /// copy, unless the log says that the same party sent both.
    pub fn is_copy(&self, bytes: &[u8], side: Option<Side>) -> bool {
        let is_last = |stream: &&DeviceStream| stream.group == bytes && !stream.is_mid_frame;
        let Some(stream) = self.streams.first().filter(is_last) else { return false };
        let is_known = side.is_some() && stream.side.is_some();
        let may_be_echo = !is_known && stream.same_frames == 1 && is_echoed(bytes);
        (!is_known || side == stream.side) && !may_be_echo && self.number <= stream.number + MAX_LINES_TO_COPY
    }

    /// Whether this frame is the one that was delivered before the last one, and a few lines ago, by the same party.
    pub fn is_earlier_copy(&self, bytes: &[u8]) -> bool {
        let is_near = |stream: &&DeviceStream| self.number <= stream.number + MAX_LINES_TO_COPY && !stream.is_mid_frame;
        self.streams.first().filter(is_near).is_some_and(|stream| stream.previous == bytes)
    }

    /// The frame that was delivered a few lines before the line of this number.
    pub fn frame_before(&self, number: u64) -> Option<&[u8]> {
        let is_near = |stream: &&DeviceStream| !stream.is_mid_frame && number <= stream.number + MAX_LINES_TO_COPY;
        self.streams.first().filter(is_near).map(|stream| &stream.group[..])
    }

    /// Whether these bytes are the RTU form of the MBAP frame that was delivered last: servers take the header off, put a CRC
    /// after the unit and the PDU, and print that as well. A gateway that passes a frame on has received one and sent the other.
    pub(super) fn is_inner_copy(&self, entry_bytes: &EntryBytes<'_>, framing: Option<Mode>) -> bool {
        let Some(stream) = self.streams.get(entry_bytes.key).filter(|_| framing == Some(Mode::Rtu)) else { return false };
        let inner = &entry_bytes.bytes[..entry_bytes.bytes.len() - CRC_BYTES];
        if stream.group.get(PREFIX_BYTES..) != Some(inner) {
            return false;
        }
        // Where the log does not say who sent them, a response that echoes its request is no copy.
        let may_be_echo = entry_bytes.side.is_none() && is_echoed(entry_bytes.bytes);
        let is_same_side = entry_bytes.side == stream.side && !may_be_echo;
        let is_near = entry_bytes.number <= stream.number + MAX_LINES_TO_COPY;
        is_same_side && is_near && check_frame(&stream.group).1 == Some(Mode::Tcp)
    }

    /// Whether the line repeats the one before, as where two handlers of a logger print it: the same answer over Modbus/TCP, with
    /// the same transaction identifier, from the same party, and at the same time as far as the clock shows.
    pub(super) fn is_logged_twice(&self, entry_bytes: &EntryBytes<'_>, framing: Option<Mode>) -> bool {
        let Some(stream) = self.streams.get(entry_bytes.key) else { return false };
        let is_near =
            stream.time.zip(entry_bytes.time).is_some_and(|(one, other)| (0..=MAX_TO_LOG_TWICE).contains(&(other - one)));
        let is_received = entry_bytes.side == Some(Side::Received) && stream.side == entry_bytes.side;
        is_near
            && is_received
            && framing == Some(Mode::Tcp)
            && stream.number + 1 == entry_bytes.number
            && stream.group == entry_bytes.bytes
    }

    /// Counts a frame that was delivered already.
    pub fn skip_copy(&mut self, bytes: &[u8]) {
        self.skip(self.number, bytes, DUPLICATE);
    }
}
