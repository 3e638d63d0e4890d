//! Short substrings with a valid CRC that were found to be worth nothing: what noise repeats is not weighed again each time.

/// The longest substring that is remembered.
const MAX_BYTES: usize = 8;

/// How many substrings are remembered.
const PLACES: usize = 64;

/// A substring, and where it was worth nothing: after nothing but this root, on a line without times, by a unit that is not known.
/// There its score depends on its bytes, the root, and the two costs alone.
#[derive(Clone, Copy, Default)]
struct Rejected {
    bytes: [u8; MAX_BYTES],
    length: u8,
    /// Stream offset of the root's end.
    root_end: u64,
    /// Cost in bits of the unframed bytes between the root and the substring.
    unframed_cost: f32,
    /// The path score in bits that it does not exceed.
    floor: f32,
}

/// The last substrings that were rejected.
pub struct RejectedSubstrings([Rejected; PLACES]);

impl Default for RejectedSubstrings {
    fn default() -> Self {
        Self([Rejected::default(); PLACES])
    }
}

impl RejectedSubstrings {
    /// Whether this substring was rejected after the same root at the same costs, or lower ones, so that it would be again.
    pub fn contains(&self, frame: &[u8], root_end: u64, unframed_cost: f32, floor: f32) -> bool {
        let Some(bytes) = padded(frame) else { return false };
        let known = &self.0[place(frame)];
        (known.bytes, usize::from(known.length), known.root_end) == (bytes, frame.len(), root_end)
            && known.unframed_cost <= unframed_cost
            && known.floor <= floor
    }

    /// Remembers that this substring was rejected, unless it is too long.
    pub fn insert(&mut self, frame: &[u8], root_end: u64, unframed_cost: f32, floor: f32) {
        if let Some(bytes) = padded(frame) {
            self.0[place(frame)] = Rejected { bytes, length: frame.len() as u8, root_end, unframed_cost, floor };
        }
    }
}

/// A short substring with zeros after it.
fn padded(frame: &[u8]) -> Option<[u8; MAX_BYTES]> {
    let mut bytes = [0; MAX_BYTES];
    bytes.get_mut(..frame.len())?.copy_from_slice(frame);
    Some(bytes)
}

/// Where a substring is kept, by its CRC and unit.
fn place(frame: &[u8]) -> usize {
    let crc = usize::from(frame[frame.len() - 1]) ^ usize::from(frame[frame.len() - 2]).wrapping_mul(5);
    (crc ^ usize::from(frame[0]).wrapping_mul(11)) % PLACES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_rejected_is_rejected_at_the_same_costs_and_at_higher_ones_only() {
        let mut rejected = RejectedSubstrings::default();
        let frame = [0, 0xFF, 0xFF, 0, 0];
        assert!(!rejected.contains(&frame, 7, 9.0, -40.0));
        rejected.insert(&frame, 7, 9.0, -40.0);
        assert!(rejected.contains(&frame, 7, 9.0, -40.0));
        assert!(rejected.contains(&frame, 7, 10.0, -39.0));
        assert!(!rejected.contains(&frame, 7, 8.0, -40.0), "fewer bytes before it");
        assert!(!rejected.contains(&frame, 7, 9.0, -41.0), "a lower floor");
        assert!(!rejected.contains(&frame, 8, 9.0, -40.0), "another root");
        assert!(!rejected.contains(&frame[..4], 7, 9.0, -40.0), "fewer bytes, of equal value");
        rejected.insert(&[1; 9], 7, 9.0, -40.0);
        assert!(!rejected.contains(&[1; 9], 7, 9.0, -40.0), "too long");
    }
}
