//! Finds the frames in a run of bytes that a checksum or the length in an MBAP header proves.
//!
//! A checksum of 16 bits fits by chance at one place in 65,536, and a log may hold many numbers that are no bytes. So a frame
//! counts only if it is the whole run or has the layout of its function, and if it takes up half of the run or begins and
//! ends where the separators change.

use std::ops::Range;

use crate::text::encapsulation::solarman_rtu_frame;
use crate::text::frame_evidence::{is_ascii_frame, is_bare_request};
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::hex::parse_hex;
use modlens_protocol::mbap::{announced_length, layout_fits, PREFIX_BYTES};
use modlens_protocol::recognize::valid_rtu_frame;

/// The shortest frame that may stand among other bytes: an exception response.
const MIN_INNER_BYTES: usize = 5;

/// The shortest whole run whose checksum is enough, whatever its layout.
const MIN_RUN_BYTES: usize = 6;

/// The longest RTU frame (serial line specification, 2.5.1).
const MAX_RTU_BYTES: usize = 256;

/// Unit, function and LRC.
const MIN_ASCII_BYTES: usize = 3;

/// The longest frame of Modbus ASCII in characters (serial line specification, 2.5.2).
const MAX_ASCII_CHARS: usize = 513;

/// The positions of the proved frames in a run. `edges` are positions where the separators of the run change.
pub(super) fn prove(bytes: &[u8], edges: &[usize]) -> Vec<Range<usize>> {
    if is_frame(bytes) {
        return std::iter::once(0..bytes.len()).collect();
    }
    // The reader of entries takes the frame out of its wrapper.
    if solarman_rtu_frame(bytes).is_ok_and(|inner| is_frame(&bytes[inner])) {
        return std::iter::once(0..bytes.len()).collect();
    }
    let mut frames = search(bytes, edges);
    let proved: usize = frames.iter().map(Range::len).sum();
    if 2 * proved < bytes.len() {
        frames.retain(|frame| edges.contains(&frame.start) && edges.contains(&frame.end));
    }
    frames
}

/// The frames in the bytes, from the first on: those with a known layout, and those that fill the bytes between two edges.
fn search(bytes: &[u8], edges: &[usize]) -> Vec<Range<usize>> {
    let mut frames = Vec::new();
    let mut at = 0;
    while bytes.len() - at >= MIN_INNER_BYTES {
        let next_edge = edges.binary_search(&at).ok().and_then(|i| edges.get(i + 1));
        let to_edge = || next_edge.filter(|&&end| is_frame(&bytes[at..end])).map_or(0, |&end| end - at);
        let length = match frame_length(&bytes[at..]) {
            length @ MIN_INNER_BYTES.. => length,
            _ => to_edge(),
        };
        if length > 0 {
            frames.push(at..at + length);
        }
        at += length.max(1);
    }
    frames
}

/// The length of the frame at the start of these bytes; 0 if there is none.
fn frame_length(bytes: &[u8]) -> usize {
    let ascii_length = || {
        let chars = &bytes[..bytes.len().min(MAX_ASCII_CHARS)];
        let end = chars.windows(2).position(|two| two == b"\r\n").map(|at| at + 2)?;
        is_ascii_frame(&chars[..end]).then_some(end)
    };
    let tcp_length = || announced_length(bytes).filter(|&length| bytes.get(..length).is_some_and(is_tcp_frame));
    let other = || if bytes[0] == b':' { ascii_length() } else { tcp_length() };
    match valid_rtu_frame(Functions::embedded(), bytes) {
        0 => other().unwrap_or(0),
        length => length,
    }
}

/// Whether all of these bytes are one frame.
pub(super) fn is_frame(bytes: &[u8]) -> bool {
    if bytes.len() < 4 {
        return false;
    }
    let pdu = &bytes[1..bytes.len() - 2];
    let has_code = pdu[0] & !EXCEPTION_BIT != 0;
    let is_rtu = has_code && crc_valid(bytes) && (bytes.len() >= MIN_RUN_BYTES || fits_known_function(pdu));
    is_rtu || (announced_length(bytes) == Some(bytes.len()) && is_tcp_frame(bytes)) || is_ascii_frame(bytes)
}

/// Whether these bytes are an RTU frame with a valid CRC and the layout of a function that the specification has.
pub(super) fn is_checked_frame(bytes: &[u8]) -> bool {
    (MIN_INNER_BYTES..=MAX_RTU_BYTES).contains(&bytes.len())
        && crc_valid(bytes)
        && bytes[1] & !EXCEPTION_BIT != 0
        && fits_known_function(&bytes[1..bytes.len() - 2])
}

/// Whether these characters are a frame of Modbus ASCII with a valid LRC and the layout of a function that the specification has,
/// with its line end or without.
pub(super) fn is_checked_ascii(characters: &[u8]) -> bool {
    let fits = |bytes: &[u8]| bytes.len() > MIN_ASCII_BYTES && fits_known_function(&bytes[1..bytes.len() - 1]);
    is_ascii_frame(characters)
        && characters.len() <= MAX_ASCII_CHARS
        && std::str::from_utf8(characters[1..].trim_ascii_end()).ok().and_then(parse_hex).is_some_and(|bytes| fits(&bytes))
}

/// Whether the PDU after an MBAP header of the right length has the layout of its function.
fn is_tcp_frame(bytes: &[u8]) -> bool {
    (bytes.len() > PREFIX_BYTES + 2 || is_bare_request(bytes)) && fits_known_function(&bytes[PREFIX_BYTES + 1..])
}

/// Whether a PDU has the layout of a function that the specification has.
pub(super) fn fits_known_function(pdu: &[u8]) -> bool {
    let functions = Functions::embedded();
    let is_known = functions.row(pdu[0] & !EXCEPTION_BIT, &pdu[1..]).is_some();
    is_known && layout_fits(functions, pdu)
}
