//! Whether settings that were found still hold.

use crate::session::Session;

/// Settings that were found by listening are searched again after so many bytes without a valid frame.
const MAX_DAMAGED_BYTES: u64 = 500;

/// Watches a bus whose settings were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCheck {
    /// What was counted when the last valid frame was seen.
    valid_frames: u64,
    damaged_bytes: u64,
}

impl LineCheck {
    /// The bytes since the last valid frame, where they are so many that the settings have to be searched again.
    pub fn damage(&mut self, session: &Session, bus: usize) -> Option<u64> {
        let stats = session.stats();
        let (frames, damaged) = (stats.valid_frames_of(bus), stats.damaged_bytes_of(bus));
        if frames != self.valid_frames {
            *self = Self { valid_frames: frames, damaged_bytes: damaged };
            return None;
        }
        let since = damaged - self.damaged_bytes;
        if since < MAX_DAMAGED_BYTES {
            return None;
        }
        self.damaged_bytes = damaged;
        Some(since)
    }
}
