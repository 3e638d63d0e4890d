//! What speaks for bytes being Modbus: checksums that close, headers whose length is right, layouts that fit.

use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::readings;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::hex::pair;
use modlens_protocol::mbap::announced;
use modlens_protocol::recognize::rtu_bytes;

/// Unit, function code and checksum.
const SHORTEST: usize = 4;

/// Whether the bytes end with what closes a frame: a checksum, or the length that their header announces.
pub(super) fn closes(bytes: &[u8]) -> bool {
    closed(bytes).0
}

/// The framing that the whole of the bytes proves; `None` if none or more than one does.
pub(super) fn framing(bytes: &[u8]) -> Option<Mode> {
    closed(bytes).1
}

/// Both at once: the checksum is gone through once.
pub(super) fn closed(bytes: &[u8]) -> (bool, Option<Mode>) {
    let crc = bytes.len() >= SHORTEST && crc_valid(bytes);
    let mbap = announced(bytes) == Some(bytes.len()) && bytes.len() > 8;
    match (crc, mbap) {
        (true, false) => (true, Some(Mode::Rtu)),
        (false, true) => (true, Some(Mode::Tcp)),
        (true, true) => (true, None),
        (false, false) => {
            let ascii = ascii(bytes);
            (ascii, ascii.then_some(Mode::Ascii))
        }
    }
}

/// 1 for what can only be a request, -1 for what can only be a response, else 0.
pub(super) fn direction(bytes: &[u8], framing: Option<Mode>) -> i32 {
    let pdu = match framing {
        Some(Mode::Rtu) => &bytes[1..bytes.len() - 2],
        Some(Mode::Tcp) => &bytes[7..],
        _ => return 0,
    };
    let (request, response) = readings(Functions::embedded(), pdu);
    i32::from(request) - i32::from(response)
}

fn ascii(bytes: &[u8]) -> bool {
    let Some(text) = bytes.strip_prefix(b":") else { return false };
    let text = text.trim_ascii_end();
    let sum = text.chunks(2).try_fold(0u8, |sum, two| pair(two, 0).map(|byte| sum.wrapping_add(byte)));
    text.len() >= 6 && sum == Some(0)
}

/// Bytes of a burst that are in frames with a right checksum.
pub(super) fn good(bytes: &[u8]) -> usize {
    match framing(bytes) {
        Some(Mode::Rtu) if plausible(bytes) => return bytes.len(),
        Some(Mode::Tcp | Mode::Ascii) => return bytes.len(),
        _ => {}
    }
    rtu_bytes(Functions::embedded(), bytes)
}

/// Whether a burst without checksum has the layout of a request or a response.
pub(super) fn fits_without_checksum(bytes: &[u8]) -> bool {
    bytes.len() >= 3 && bytes[1] & !EXCEPTION_BIT != 0 && readings(Functions::embedded(), &bytes[1..]) != (false, false)
}

/// No unit above 247 has function 0: a run of zeros has a right checksum, too.
fn plausible(bytes: &[u8]) -> bool {
    bytes[1] & !EXCEPTION_BIT != 0
}
