//! Frames of Modbus/TCP with functions that no table has: their headers prove them where several follow one another.
//!
//! Two zeros and a length that fits are in packets of other protocols as well. Identifiers that repeat, as a response repeats
//! that of its request, or that count on, do not.

use modlens_protocol::mbap::{announced_length, PREFIX_BYTES};

/// So many headers in a row are no coincidence.
const MIN_HEADERS: usize = 4;

/// How far an identifier counts on at most from one frame to the next; a log may lack some.
const MAX_STEP: u16 = 3;

/// The headers of a text so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeaderRun {
    last_id: Option<u16>,
    headers: usize,
    in_order: usize,
    bytes: usize,
    others: usize,
}

impl HeaderRun {
    /// Counts the bytes of one record.
    pub fn add(&mut self, bytes: &[u8]) {
        if announced_length(bytes) != Some(bytes.len()) || bytes.len() < PREFIX_BYTES + 2 {
            self.others += bytes.len();
            return;
        }
        let id = u16::from_be_bytes([bytes[0], bytes[1]]);
        self.in_order += usize::from(self.last_id.is_some_and(|last| id.wrapping_sub(last) <= MAX_STEP));
        self.last_id = Some(id);
        self.headers += 1;
        self.bytes += bytes.len();
    }

    /// The bytes of frames that the headers prove: all, if nearly all bytes follow headers with identifiers in order.
    pub fn proven_bytes(self) -> usize {
        let is_proven =
            self.headers >= MIN_HEADERS && 10 * self.in_order >= 9 * (self.headers - 1) && self.others * 10 <= self.bytes;
        if is_proven {
            self.bytes
        } else {
            0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn proven(ids: &[u16]) -> usize {
        let mut run = HeaderRun::default();
        for id in ids {
            let [high, low] = id.to_be_bytes();
            run.add(&[high, low, 0, 0, 0, 4, 1, 0x41, 6, 3]);
        }
        run.proven_bytes()
    }

    #[test]
    fn headers_in_order_prove_frames_of_any_function() {
        assert_eq!(proven(&[7, 7, 8, 8]), 40);
        assert_eq!(proven(&[0xFFFF, 0xFFFF, 0, 0]), 40);
        assert_eq!(proven(&[7, 7, 8]), 0);
        assert_eq!(proven(&[7, 900, 12, 4000]), 0);
    }
}
