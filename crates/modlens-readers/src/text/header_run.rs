//! Frames of Modbus/TCP with functions that no table has: their headers prove them where several follow one another,
//! or where a response repeats what is in that of its request.
//!
//! Two zeros and a length that fits are in packets of other protocols as well. Identifiers that repeat, as a response repeats
//! that of its request, or that count on, do not.

use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::mbap::{announced_length, PREFIX_BYTES};

/// So many headers in a row are no coincidence.
const MIN_HEADERS: usize = 4;

/// How far an identifier counts on at most from one frame to the next; a log may lack some.
const MAX_STEP: u16 = 3;

/// The headers of a text so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeaderRun {
    last_id: Option<u16>,
    /// Unit and function of the last frame.
    last_head: [u8; 2],
    last_length: usize,
    /// Frames, the last of which may be cut, that repeat identifier, unit and function of the one before and are of another
    /// length, as a response does.
    pairs: usize,
    headers: usize,
    in_order: usize,
    bytes: usize,
    others: usize,
}

impl HeaderRun {
    /// Counts the bytes of one record.
    pub fn add(&mut self, bytes: &[u8]) {
        let announced = announced_length(bytes).filter(|_| bytes.len() >= PREFIX_BYTES + 2);
        let id = bytes.first_chunk().map_or(0, |&id| u16::from_be_bytes(id));
        let repeats = self.last_id == Some(id) && bytes.get(PREFIX_BYTES..PREFIX_BYTES + 2) == Some(&self.last_head);
        let is_other_length = announced.is_some_and(|length| length >= bytes.len() && length != self.last_length);
        self.pairs += usize::from(repeats && is_other_length && self.last_head[1] & !EXCEPTION_BIT != 0);
        if announced != Some(bytes.len()) {
            self.others += bytes.len();
            return;
        }
        self.last_head = [bytes[PREFIX_BYTES], bytes[PREFIX_BYTES + 1]];
        self.last_length = bytes.len();
        self.in_order += usize::from(self.last_id.is_some_and(|last| id.wrapping_sub(last) <= MAX_STEP));
        self.last_id = Some(id);
        self.headers += 1;
        self.bytes += bytes.len();
    }

    /// The bytes of frames that the headers prove: all, if nearly all bytes follow headers with identifiers in order.
    pub fn proven_bytes(self) -> usize {
        let is_run =
            self.headers >= MIN_HEADERS && 10 * self.in_order >= 9 * (self.headers - 1) && self.others * 10 <= self.bytes;
        let are_exchanges = self.pairs > 0 && 2 * self.pairs >= self.headers;
        if is_run || are_exchanges {
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
        assert_eq!(proven(&[7, 8, 9]), 0);
        assert_eq!(proven(&[7, 900, 12, 4000]), 0);
    }

    #[test]
    fn one_exchange_proves_its_request_although_the_response_is_cut() {
        let mut run = HeaderRun::default();
        run.add(&[0, 16, 0, 0, 0, 7, 1, 0x41, 6, 3, 0x45, 0, 4]);
        assert_eq!(run.proven_bytes(), 0);
        run.add(&[0, 16, 0, 0, 0, 0xFD, 1, 0x41, 6, 0xF9]);
        assert_eq!(run.proven_bytes(), 13);
    }
}
