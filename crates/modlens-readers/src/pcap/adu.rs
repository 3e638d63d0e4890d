//! The ADU in a frame as it stood on the wire.

use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::hex::decode_pairs;

/// Unit and PDU of a good frame in binary, and what follows them: the CRC, the whole text of an ASCII frame, or
/// nothing.
pub fn unwrap<'a>(mode: Mode, verdict: Verdict, wire: &'a [u8], scratch: &'a mut Vec<u8>) -> (&'a [u8], &'a [u8]) {
    match mode {
        Mode::Rtu if verdict == Verdict::NoChecksum => (wire, &[]),
        Mode::Rtu => wire.split_at(wire.len().saturating_sub(2)),
        Mode::Tcp => (wire.get(6..).unwrap_or(&[]), &[]),
        Mode::Ascii => {
            let digits: Vec<u8> = wire.iter().copied().filter(u8::is_ascii_hexdigit).collect();
            decode_pairs(&digits, scratch);
            if verdict != Verdict::NoChecksum {
                scratch.pop(); // the LRC
            }
            (scratch, wire)
        }
    }
}
