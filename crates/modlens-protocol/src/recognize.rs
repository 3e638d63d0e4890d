//! Which framing bytes are in, by the checksums and headers that fit, without framing them.

use crate::checksum::{crc_valid, lrc};
use crate::framing::Mode;
use crate::functions::{Extent, Functions, EXCEPTION_BIT};
use crate::mbap::{announced, layout_fits, natural};

/// The framing under which most bytes are in good frames.
pub fn evidence(functions: &Functions, bytes: &[u8]) -> Option<Mode> {
    let scores =
        [(rtu_bytes(functions, bytes), Mode::Rtu), (ascii_bytes(bytes), Mode::Ascii), (tcp_bytes(functions, bytes), Mode::Tcp)];
    // Equal scores: the first, which has the strongest checksum.
    scores.into_iter().rev().max_by_key(|(score, _)| *score).filter(|(score, _)| *score > 0).map(|(_, mode)| mode)
}

/// How many of the bytes are in good frames of a serial line.
pub fn evidence_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    rtu_bytes(functions, bytes).max(ascii_bytes(bytes))
}

/// How many of the bytes are in good RTU frames.
pub fn rtu_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    let mut good = 0;
    while bytes.len() - at >= 4 {
        let length = rtu_frame(functions, &bytes[at..]);
        good += length;
        at += length.max(1);
    }
    good
}

fn rtu_frame(functions: &Functions, bytes: &[u8]) -> usize {
    let fits = |length: usize| bytes.get(..length + 4).is_some_and(crc_valid);
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        return if bytes[2] != 0 && fits(1) { 5 } else { 0 };
    }
    let Some(row) = functions.row(code, body) else { return 0 };
    [&row.request, &row.response]
        .into_iter()
        .find_map(|layout| match layout.extent(body) {
            Extent::Exactly(length) if fits(length) => Some(length + 4),
            _ => None,
        })
        .unwrap_or(0)
}

fn ascii_bytes(bytes: &[u8]) -> usize {
    let mut good = 0;
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        let Some(colon) = line.iter().rposition(|&b| b == b':') else { continue };
        let text = line[colon + 1..].trim_ascii_end();
        let ended = colon + 1 + text.len() < line.len();
        let hex: Option<Vec<u8>> = std::str::from_utf8(text).ok().and_then(crate::hex::parse_hex);
        if ended && hex.is_some_and(|hex| hex.len() >= 3 && lrc(&hex) == 0) {
            good += line.len() - colon;
        }
    }
    good
}

fn tcp_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    while let Some(length) = announced(&bytes[at..]) {
        match bytes.get(at + 7..at + length) {
            Some(pdu) if layout_fits(functions, pdu) => at += length,
            _ => break,
        }
    }
    at
}

/// The framing of bytes without any good frame.
pub fn looks_like(functions: &Functions, bytes: &[u8]) -> Mode {
    // A header of MBAP whose length lies, before a PDU that is whole by its layout.
    let whole = |length: &usize| *length <= bytes.len();
    let mbap = announced(bytes).is_some() && natural(functions, bytes).iter().flatten().any(whole);
    match (looks_like_text(bytes), mbap) {
        (true, _) => Mode::Ascii,
        (false, true) => Mode::Tcp,
        (false, false) => Mode::Rtu,
    }
}

fn looks_like_text(bytes: &[u8]) -> bool {
    let text = bytes.iter().filter(|b| matches!(b, b'0'..=b'9' | b'A'..=b'F' | b'a'..=b'f' | b':' | b'\r' | b'\n')).count();
    bytes.contains(&b':') && text * 10 >= bytes.len() * 9
}
