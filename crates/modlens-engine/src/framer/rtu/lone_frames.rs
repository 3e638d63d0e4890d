//! Frames that stood alone in noise, so that the same accident of the checksum is not believed because it comes again.
//!
//! That a CRC is valid is evidence once. Where the same bytes come again after the same bytes, as in the telegrams of another
//! protocol or a poll received at a wrong baud rate, its being valid again was certain. Only a response proves such a request.

use crate::weights::{LONE_FRAMES_PER_ANSWER_FACTOR, MAX_LONE_FRAMES};

/// Slots of the table.
const SLOTS: usize = 256;

/// Bytes in front of a frame by which its surroundings are distinguished from others.
pub const SURROUNDING_BYTES: usize = 4;

/// What stood alone in noise, and how often.
pub struct LoneFrames {
    slots: Box<[LoneFrame; SLOTS]>,
}

/// A frame with the bytes before it.
#[derive(Clone, Copy, Default)]
struct LoneFrame {
    /// A hash of these bytes.
    key: u64,
    /// How often they came.
    seen: u32,
    /// How often a response proved that they were a request.
    answered: u32,
}

impl Default for LoneFrames {
    fn default() -> Self {
        Self { slots: Box::new([LoneFrame::default(); SLOTS]) }
    }
}

/// The key of a frame and of the bytes in front of it: `bytes` are both.
pub fn key_of(bytes: &[u8]) -> u64 {
    // FNV-1a.
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

impl LoneFrames {
    /// Whether these bytes came before, and are seldom or never answered.
    pub fn is_recurring(&self, key: u64) -> bool {
        let slot = &self.slots[slot_of(key)];
        slot.key == key && slot.seen > LONE_FRAMES_PER_ANSWER_FACTOR * slot.answered
    }

    /// Counts a frame that is alone.
    pub fn record(&mut self, key: u64) {
        let slot = &mut self.slots[slot_of(key)];
        if slot.key != key {
            *slot = LoneFrame { key, ..LoneFrame::default() };
        }
        slot.seen += 1;
        if slot.seen > MAX_LONE_FRAMES {
            (slot.seen, slot.answered) = (slot.seen / 2, slot.answered / 2);
        }
    }

    /// A response answered the frame.
    pub fn record_response(&mut self, key: u64) {
        let slot = &mut self.slots[slot_of(key)];
        if slot.key == key {
            slot.answered += 1;
        }
    }
}

fn slot_of(key: u64) -> usize {
    (key >> 48) as usize % SLOTS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_recurs_unanswered_is_told_from_what_is_answered() {
        let mut table = LoneFrames::default();
        let (accident, request) = (key_of(b"accident"), key_of(b"request"));
        assert!(!table.is_recurring(accident));
        for _ in 0..1000 {
            table.record(accident);
            table.record(request);
            table.record_response(request);
        }
        assert!(table.is_recurring(accident));
        assert!(!table.is_recurring(request));
        // A unit that falls silent is believed for a while.
        table.record(request);
        assert!(!table.is_recurring(request));
    }
}
