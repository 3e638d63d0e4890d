//! Packets of link type 147 that hold a part of a frame only: some programs write what one read returned.

use modlens_protocol::checksum::crc_valid;
use modlens_protocol::Ns;

/// A part follows the one before within this time: longer than any silence inside a frame, shorter than a poll.
const MAX_PAUSE: Ns = 100_000_000;

/// The longest RTU frame (serial line specification, 2.5.1).
const MAX_FRAME_BYTES: usize = 256;

/// The bytes of each interface since the last place where a frame could begin.
#[derive(Debug, Default)]
pub(super) struct FrameParts {
    interfaces: Vec<Part>,
}

#[derive(Clone, Debug, Default)]
struct Part {
    bytes: Vec<u8>,
    time: Option<Ns>,
}

impl FrameParts {
    /// Whether a frame may begin with a packet. It does not where the packets before have begun a frame that this one
    /// continues, which the CRC at its end or at a later end shows; a packet that is a frame itself always begins one.
    pub fn begins_frame(&mut self, interface: usize, bytes: &[u8], time: Option<Ns>) -> bool {
        if self.interfaces.len() <= interface {
            self.interfaces.resize(interface + 1, Part::default());
        }
        let part = &mut self.interfaces[interface];
        let pause = time.zip(part.time).map_or(0, |(now, before)| now - before);
        part.time = time;
        let is_frame = crc_valid(bytes);
        let begins = is_frame || part.bytes.is_empty() || pause > MAX_PAUSE || part.bytes.len() + bytes.len() > MAX_FRAME_BYTES;
        if begins {
            part.bytes.clear();
        }
        part.bytes.extend_from_slice(bytes);
        if is_frame || crc_valid(&part.bytes) {
            part.bytes.clear();
        }
        begins
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_in_parts_begins_once() {
        let frame = [5, 3, 4, 0, 0xFA, 1, 0x2C, 0x9F, 0x8F];
        let mut parts = FrameParts::default();
        let mut begins = |bytes: &[u8], time: Ns| parts.begins_frame(0, bytes, Some(time));
        assert!(begins(&frame, 0));
        assert!(begins(&frame[..4], 1_000_000));
        assert!(!begins(&frame[4..7], 2_000_000));
        assert!(!begins(&frame[7..], 3_000_000));
        // A damaged frame is followed by a whole one, and a part by silence.
        assert!(begins(&frame[..8], 4_000_000));
        assert!(begins(&frame, 5_000_000));
        assert!(begins(&frame[..4], 6_000_000));
        assert!(begins(&frame[4..7], 600_000_000));
    }
}
