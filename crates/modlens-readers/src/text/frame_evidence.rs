//! Evidence that a run of bytes is Modbus: valid checksums, MBAP headers with the right length, PDUs with a known layout.

use modlens_protocol::checksum::crc_valid_at;
use modlens_protocol::direction::possible_directions;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Extent, Functions, EXCEPTION_BIT};
use modlens_protocol::hex::byte_at;
use modlens_protocol::mbap::{announced_length, PREFIX_BYTES};
use modlens_protocol::recognize::valid_rtu_bytes;

/// Some devices announce, and send, so many bytes more in a frame of Modbus/TCP than its PDU has.
const MAX_TRAILING_BYTES: usize = 2;

/// The header of an MBAP frame, with the unit, and the function code.
const MBAP_BYTES: usize = PREFIX_BYTES + 2;

/// The longest MBAP frame (Modbus messaging on TCP/IP, 4.1).
const MAX_MBAP_FRAME: usize = 260;

/// The shortest RTU frame: unit, function code and CRC.
const MIN_RTU_BYTES: usize = 4;

/// Whether an MBAP frame ends with a function code whose request has no data, such as Report Server ID.
pub(super) fn is_bare_request(bytes: &[u8]) -> bool {
    let functions = Functions::embedded();
    bytes.len() == MBAP_BYTES
        && functions.row(bytes[MBAP_BYTES - 1], &[]).is_some()
        && possible_directions(functions, &bytes[MBAP_BYTES - 1..]).0
}

/// Whether the bytes are a whole frame in any framing: they end with a valid checksum, or have the length that their MBAP
/// header announces.
pub(super) fn is_whole_frame(bytes: &[u8]) -> bool {
    check_frame(bytes).0
}

/// The framing in which the bytes are exactly one valid frame; `None` if there is none or more than one.
pub(super) fn proven_framing(bytes: &[u8]) -> Option<Mode> {
    check_frame(bytes).1
}

/// Whether the bytes are a whole frame, and the framing that this proves (`None` if RTU and TCP both fit). One function
/// answers both, so that the CRC is computed once.
pub(super) fn check_frame(bytes: &[u8]) -> (bool, Option<Mode>) {
    check_first(bytes, bytes.len())
}

/// The same for the first `length` bytes, which is faster if some more follow in the slice.
pub(super) fn check_first(bytes: &[u8], length: usize) -> (bool, Option<Mode>) {
    let is_rtu = length >= MIN_RTU_BYTES && crc_valid_at(bytes, length);
    let bytes = &bytes[..length];
    // A request for two registers from 0 may look like a header and a function code: 01 03 00 00 00 02 C4 0B.
    let is_bare = || !is_rtu && is_bare_request(bytes);
    let is_tcp = announced_length(bytes) == Some(bytes.len()) && (bytes.len() > MBAP_BYTES || is_bare());
    match (is_rtu, is_tcp) {
        (true, false) => (true, Some(Mode::Rtu)),
        (false, true) => (true, Some(Mode::Tcp)),
        (true, true) => (true, None),
        (false, false) => {
            let is_ascii = is_ascii_frame(bytes);
            (is_ascii, is_ascii.then_some(Mode::Ascii))
        }
    }
}

/// 1 for a frame that can only be a request, -1 for one that can only be a response, 0 for one that may be either.
pub(super) fn direction_evidence(bytes: &[u8], proven_framing: Option<Mode>) -> i32 {
    let pdu = match proven_framing {
        Some(Mode::Rtu) => &bytes[1..bytes.len() - 2],
        Some(Mode::Tcp) => &bytes[7..],
        _ => return 0,
    };
    let (request, response) = possible_directions(Functions::embedded(), pdu);
    i32::from(request) - i32::from(response)
}

/// Whether the bytes are a colon and hex digits with a valid LRC.
pub(super) fn is_ascii_frame(bytes: &[u8]) -> bool {
    let Some(text) = bytes.strip_prefix(b":") else { return false };
    let text = text.trim_ascii_end();
    let sum = text.chunks(2).try_fold(0u8, |sum, two| byte_at(two, 0).map(|byte| sum.wrapping_add(byte)));
    text.len() >= 6 && sum == Some(0)
}

/// How many bytes of a burst belong to frames with a valid checksum or length.
pub(super) fn proven_bytes(bytes: &[u8]) -> usize {
    match proven_framing(bytes) {
        Some(Mode::Rtu) if has_function_code(bytes) => return bytes.len(),
        Some(Mode::Tcp) if has_known_function(&bytes[PREFIX_BYTES + 1..]) => return bytes.len(),
        Some(Mode::Ascii) => return bytes.len(),
        _ => {}
    }
    match valid_rtu_bytes(Functions::embedded(), bytes) {
        0 => last_mbap_frame(bytes),
        proven => proven,
    }
}

/// How many bytes the MBAP frame has with which the bytes end, such as one after the headers of its packet; 0 without one.
fn last_mbap_frame(bytes: &[u8]) -> usize {
    let rest = |start: usize| &bytes[start..];
    let is_frame = |frame: &[u8]| {
        frame.len() > MBAP_BYTES && announced_length(frame) == Some(frame.len()) && has_known_function(&frame[PREFIX_BYTES + 1..])
    };
    let first = bytes.len().saturating_sub(MAX_MBAP_FRAME);
    (first..bytes.len().saturating_sub(MBAP_BYTES)).map(rest).find(|frame| is_frame(frame)).map_or(0, <[u8]>::len)
}

/// Whether a PDU has the layout of a known function. Two zeros and a length that fits are in packets of other protocols,
/// too, such as those of Bluetooth.
fn has_known_function(pdu: &[u8]) -> bool {
    let functions = Functions::embedded();
    let (code, body) = (pdu[0], &pdu[1..]);
    if code & EXCEPTION_BIT != 0 {
        return body.len() == 1 && functions.row(code & !EXCEPTION_BIT, body).is_some();
    }
    functions.row(code, body).is_some_and(|row| {
        [&row.request, &row.response].into_iter().any(|layout| match layout.extent(body) {
            Extent::Exactly(length) => (length..=length + MAX_TRAILING_BYTES).contains(&body.len()),
            _ => layout.fits(body),
        })
    })
}

/// Whether bytes that were printed without a checksum have the layout of a request or a response.
pub(super) fn has_frame_layout(bytes: &[u8]) -> bool {
    bytes.len() >= 3
        && bytes[1] & !EXCEPTION_BIT != 0
        && possible_directions(Functions::embedded(), &bytes[1..]) != (false, false)
}

/// Whether the function code is not 0, which the specification keeps free. A run of zeros has a valid CRC as well, and must not
/// count as a frame.
fn has_function_code(bytes: &[u8]) -> bool {
    bytes[1] & !EXCEPTION_BIT != 0
}
