//! Recognises the transmission mode of bytes by the checksums and headers that fit, without framing them.

use crate::checksum::{crc_valid, lrc};
use crate::framing::Mode;
use crate::functions::{Extent, Functions, EXCEPTION_BIT};
use crate::mbap::{announced_length, layout_fits, layout_lengths};

/// The mode in which most bytes are in valid frames; `None` if there is no valid frame in any mode.
pub fn mode_by_valid_frames(functions: &Functions, bytes: &[u8]) -> Option<Mode> {
    let scores = [
        (valid_rtu_bytes(functions, bytes), Mode::Rtu),
        (valid_ascii_bytes(bytes), Mode::Ascii),
        (valid_tcp_bytes(functions, bytes), Mode::Tcp),
    ];
    // Of equal scores the first wins, because its checksum is the strongest.
    scores.into_iter().rev().max_by_key(|(score, _)| *score).filter(|(score, _)| *score > 0).map(|(_, mode)| mode)
}

/// As `mode_by_valid_frames`, for a serial line, which has no MBAP.
pub fn serial_mode_by_valid_frames(functions: &Functions, bytes: &[u8]) -> Option<Mode> {
    let (rtu, ascii) = (valid_rtu_bytes(functions, bytes), valid_ascii_bytes(bytes));
    (rtu.max(ascii) > 0).then_some(if ascii > rtu { Mode::Ascii } else { Mode::Rtu })
}

/// How many of the bytes are in valid frames of this mode. MBAP has no checksum: two frames in a row are asked for.
pub fn valid_bytes(functions: &Functions, mode: Mode, bytes: &[u8]) -> usize {
    match mode {
        Mode::Rtu => valid_rtu_bytes(functions, bytes),
        Mode::Ascii => valid_ascii_bytes(bytes),
        Mode::Tcp => consecutive_tcp_bytes(functions, bytes),
    }
}

/// How many of the bytes are in Modbus/TCP frames of which at least two follow each other, wherever those begin.
fn consecutive_tcp_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let (mut at, mut valid) = (0, 0);
    while at < bytes.len() {
        let run = valid_tcp_bytes(functions, &bytes[at..]);
        let first = announced_length(&bytes[at..]).unwrap_or(0);
        valid += if run > first { run } else { 0 };
        at += run.max(1);
    }
    valid
}

/// How many of the bytes are in valid frames of a serial line: RTU or ASCII, whichever has more.
pub fn valid_serial_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    valid_rtu_bytes(functions, bytes).max(valid_ascii_bytes(bytes))
}

/// How many of the bytes are in valid RTU frames.
pub fn valid_rtu_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    let mut valid = 0;
    while bytes.len() - at >= 4 {
        let length = valid_rtu_frame(functions, &bytes[at..]);
        valid += length;
        at += length.max(1);
    }
    valid
}

/// Where no field gives the length, at most so many more bytes are tried than the layout needs: a loopback has two, mostly.
const MAX_OPEN_BYTES: usize = 8;

/// The length of the valid RTU frame at the start of these bytes; 0 if there is none.
pub fn valid_rtu_frame(functions: &Functions, bytes: &[u8]) -> usize {
    if bytes.len() < 4 {
        return 0;
    }
    let fits = |length: usize| bytes.get(..length + 4).is_some_and(crc_valid);
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        return if bytes[2] != 0 && fits(1) { 5 } else { 0 };
    }
    let Some(row) = functions.row(code, body) else { return 0 };
    [&row.request, &row.response]
        .into_iter()
        .filter_map(|layout| match layout.extent(body) {
            Extent::Exactly(length) if fits(length) => Some(length + 4),
            Extent::Open(least) => (least..=least + MAX_OPEN_BYTES).find(|length| fits(*length)).map(|length| length + 4),
            _ => None,
        })
        // The CRC of a frame and a zero after it is valid, too.
        .min()
        .unwrap_or(0)
}

/// How many of the bytes are in valid ASCII frames, each from its last colon to the end of its line.
fn valid_ascii_bytes(bytes: &[u8]) -> usize {
    let mut valid = 0;
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        let Some(colon) = line.iter().rposition(|&b| b == b':') else { continue };
        let text = line[colon + 1..].trim_ascii_end();
        let has_line_end = colon + 1 + text.len() < line.len();
        let hex: Option<Vec<u8>> = std::str::from_utf8(text).ok().and_then(crate::hex::parse_hex);
        if has_line_end && hex.is_some_and(|hex| hex.len() >= 3 && lrc(&hex) == 0) {
            valid += line.len() - colon;
        }
    }
    valid
}

/// How many bytes from the first on are Modbus/TCP frames whose headers agree with their layouts.
fn valid_tcp_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    while let Some(length) = announced_length(&bytes[at..]) {
        match bytes.get(at + 7..at + length) {
            Some(pdu) if layout_fits(functions, pdu) => at += length,
            _ => break,
        }
    }
    at
}

/// The mode of bytes without any valid frame, by their look.
pub fn mode_by_appearance(functions: &Functions, bytes: &[u8]) -> Mode {
    // An MBAP header with a wrong length, before a PDU that is complete by its layout.
    let is_complete = |length: &usize| *length <= bytes.len();
    let mbap = announced_length(bytes).is_some() && layout_lengths(functions, bytes).iter().flatten().any(is_complete);
    match (looks_like_ascii(bytes), mbap) {
        (true, _) => Mode::Ascii,
        (false, true) => Mode::Tcp,
        (false, false) => Mode::Rtu,
    }
}

/// As `mode_by_appearance`, for a serial line.
pub fn serial_mode_by_appearance(bytes: &[u8]) -> Mode {
    if looks_like_ascii(bytes) {
        Mode::Ascii
    } else {
        Mode::Rtu
    }
}

/// Whether nine in ten bytes are those of ASCII frames, and a colon is among them.
fn looks_like_ascii(bytes: &[u8]) -> bool {
    let text = bytes.iter().filter(|b| matches!(b, b'0'..=b'9' | b'A'..=b'F' | b'a'..=b'f' | b':' | b'\r' | b'\n')).count();
    bytes.contains(&b':') && text * 10 >= bytes.len() * 9
}
