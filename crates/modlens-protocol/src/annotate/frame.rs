//! The blocks of a whole frame: what is around the PDU in each mode.

use super::body::{Body, MISSING};
use super::piece::{spaced_hex, Layer, Meaning, Piece};
use crate::checksum::{crc16, crc_valid, lrc};
use crate::framing::Mode;
use crate::hex::decode_pairs;
use crate::mbap::PREFIX_BYTES;

/// Unit, function code and CRC (serial line specification, section 2.5.1).
const MIN_RTU_BYTES: usize = 4;

/// Transaction, protocol, length and unit identifiers (messaging on TCP/IP, 3.1.3).
const MBAP_BYTES: usize = PREFIX_BYTES + 1;

/// The lowest unit number that is reserved on serial lines (serial line specification, 2.2).
const FIRST_RESERVED_UNIT: u8 = 248;

/// What is around the PDU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrapping {
    /// Nothing: the bytes are a PDU.
    None,
    /// A frame of a mode. Recordings that print frames without their checksum are not `has_checksum`.
    Frame {
        /// The mode.
        mode: Mode,
        /// Whether RTU and ASCII frames end in their checksum.
        has_checksum: bool,
    },
}

/// The blocks of one frame, in wire order.
pub fn annotate(frame: &[u8], wrapping: Wrapping, body: Body<'_>) -> Vec<Piece> {
    match wrapping {
        Wrapping::None => body.pieces(frame, 0),
        Wrapping::Frame { mode: Mode::Tcp, .. } => tcp(frame, body),
        Wrapping::Frame { mode: Mode::Ascii, has_checksum } => ascii(frame, body, has_checksum),
        Wrapping::Frame { mode: Mode::Rtu, has_checksum } => rtu(frame, body, has_checksum),
    }
}

/// Whether the frame of a transaction has its checksum, right or wrong. Where one that is sound does not end in it, the
/// recording prints none.
pub fn has_checksum(frame: &[u8], mode: Mode, is_sound: bool) -> bool {
    !is_sound || ends_in_checksum(frame, mode)
}

/// Whether the last bytes of a frame are its checksum; those of Modbus/TCP have none.
fn ends_in_checksum(frame: &[u8], mode: Mode) -> bool {
    match mode {
        Mode::Rtu => crc_valid(frame),
        Mode::Ascii => binary_of(frame).and_then(|binary| Some(lrc(binary.split_last()?.1) == *binary.last()?)) == Some(true),
        Mode::Tcp => false,
    }
}

/// The PDU in a frame; `None` where the frame is empty, or not decodable.
pub fn pdu_of(frame: &[u8], mode: Mode, has_checksum: bool) -> Option<Vec<u8>> {
    let inner = |bytes: &[u8], from: usize, end: usize| {
        let end = if has_checksum { end } else { 0 };
        bytes.get(from..bytes.len().saturating_sub(end)).unwrap_or_default().to_vec()
    };
    match mode {
        _ if frame.is_empty() => None,
        Mode::Tcp => Some(inner(frame, MBAP_BYTES, 0)),
        Mode::Ascii => binary_of(frame).map(|binary| inner(&binary, 1, 1)),
        Mode::Rtu => Some(inner(frame, 1, 2)),
    }
}

/// The bytes of an ASCII frame: unit, PDU and LRC.
fn binary_of(frame: &[u8]) -> Option<Vec<u8>> {
    decoded_pairs(frame.trim_ascii().get(1..).unwrap_or_default())
}

fn decoded_pairs(digits: &[u8]) -> Option<Vec<u8>> {
    let mut binary = Vec::new();
    (digits.len().is_multiple_of(2) && decode_pairs(digits, &mut binary)).then_some(binary)
}

/// The blocks of an RTU frame: unit, PDU, CRC (serial line specification, section 2.5.1).
fn rtu(frame: &[u8], body: Body<'_>, has_checksum: bool) -> Vec<Piece> {
    let checksum_bytes = if has_checksum { 2 } else { 0 };
    let min_bytes = MIN_RTU_BYTES - 2 + checksum_bytes;
    if frame.len() < min_bytes {
        return noise(frame, format!("{} bytes: too short for a frame of at least {min_bytes}", frame.len()));
    }
    let (content, tail) = frame.split_at(frame.len() - checksum_bytes);
    let mut pieces = vec![serial_unit(content[0])];
    pieces.extend(body.pieces(&content[1..], 1));
    if let &[low, high] = tail {
        let (found, expected) = (u16::from_le_bytes([low, high]), crc16(content));
        // Where the frame was cut off, its last bytes are those of a field.
        let is_cut_off = found != expected && pieces.last().is_some_and(|piece| piece.name == MISSING);
        pieces.push(if is_cut_off {
            let why = Meaning::wrong("the last bytes before the frame is cut off, not a checksum");
            Piece::new(Layer::Pdu, content.len(), tail, "cut off", spaced_hex(tail), why)
        } else {
            let meaning = checksum("CRC", found, expected, 4);
            Piece::new(Layer::Checksum, content.len(), tail, "checksum", format!("0x{found:04X}"), meaning)
        });
    }
    pieces
}

/// The blocks of a TCP frame: MBAP header and PDU (messaging on TCP/IP, section 3.1.3).
fn tcp(frame: &[u8], body: Body<'_>) -> Vec<Piece> {
    let &[id_high, id_low, protocol_high, protocol_low, length_high, length_low, unit, ..] = frame else {
        return noise(frame, format!("{} bytes: too short for the MBAP header of {MBAP_BYTES}", frame.len()));
    };
    let id = u16::from_be_bytes([id_high, id_low]);
    let protocol = u16::from_be_bytes([protocol_high, protocol_low]);
    let length = usize::from(u16::from_be_bytes([length_high, length_low]));
    let follow = frame.len() - PREFIX_BYTES;
    let protocol_text = match protocol {
        0 => Meaning::valid("Modbus"),
        _ => Meaning::wrong("not Modbus: the protocol identifier must be 0"),
    };
    let length_text = if length == follow {
        Meaning::valid(format!("{length} bytes follow"))
    } else {
        Meaning::wrong(format!("the length field says {length}, but {follow} bytes follow"))
    };
    let header = |offset: usize, end: usize, name: &str, value: String, meaning: Meaning| {
        Piece::new(Layer::Mbap, offset, &frame[offset..end], name, value, meaning)
    };
    let mut pieces = vec![
        header(0, 2, "mbap_id", id.to_string(), Meaning::valid("transaction identifier")),
        header(2, 4, "protocol", protocol.to_string(), protocol_text),
        header(4, 6, "length", length.to_string(), length_text),
        header(6, MBAP_BYTES, "unit", unit.to_string(), Meaning::valid(format!("unit {unit}"))),
    ];
    let end = frame.len().min(MBAP_BYTES.max(PREFIX_BYTES + length));
    pieces.extend(body.pieces(&frame[MBAP_BYTES..end], MBAP_BYTES));
    let tail = &frame[end..];
    if !tail.is_empty() {
        let why = Meaning::wrong("beyond the length that the header announces");
        pieces.push(Piece::new(Layer::Frame, end, tail, "extra", spaced_hex(tail), why));
    }
    pieces
}

/// The blocks of an ASCII frame.
///
/// Byte i of unit, PDU and LRC is in the two characters from 1 + 2i (serial line specification, section 2.5.2), so the
/// blocks of the binary frame are moved to the offsets of their characters.
fn ascii(frame: &[u8], body: Body<'_>, has_checksum: bool) -> Vec<Piece> {
    let text = frame.strip_suffix(b"\n").unwrap_or(frame);
    let text = text.strip_suffix(b"\r").unwrap_or(text);
    let binary = text.strip_prefix(b":").and_then(decoded_pairs).unwrap_or_default();
    if binary.len() < if has_checksum { 3 } else { 2 } {
        return noise(frame, "not an ASCII frame: a colon and pairs of hex digits are expected".to_owned());
    }
    let end = if has_checksum { binary.len() - 1 } else { binary.len() };
    let mut inner = vec![serial_unit(binary[0])];
    inner.extend(body.pieces(&binary[1..end], 1));
    if let &[found] = &binary[end..] {
        let meaning = checksum("LRC", found.into(), lrc(&binary[..end]).into(), 2);
        inner.push(Piece::new(Layer::Checksum, end, &[found], "checksum", format!("0x{found:02X}"), meaning));
    }
    let mut pieces = vec![Piece::new(Layer::Frame, 0, &frame[..1], "start", ":".to_owned(), Meaning::valid("start of frame"))];
    pieces.extend(inner.into_iter().map(|piece| {
        let offset = 1 + 2 * piece.offset;
        let bytes = frame[offset..offset + 2 * piece.bytes.len()].to_vec();
        Piece { offset, bytes, ..piece }
    }));
    pieces.push(delimiter(&frame[text.len()..], text.len()));
    pieces
}

fn delimiter(tail: &[u8], offset: usize) -> Piece {
    let (shown, meaning) = match tail {
        b"\r\n" => ("CR LF", Meaning::valid("end of frame")),
        b"\r" => ("CR", Meaning::wrong(NO_END)),
        b"\n" => ("LF", Meaning::wrong(NO_END)),
        _ => ("", Meaning::wrong(NO_END)),
    };
    Piece::new(Layer::Frame, offset, tail, "end", shown.to_owned(), meaning)
}

const NO_END: &str = "the frame should end in CR LF";

/// The block of a unit number on a serial line; only there are broadcasts and reserved numbers.
fn serial_unit(unit: u8) -> Piece {
    let meaning = match unit {
        0 => Meaning::valid("broadcast to all units; none responds"),
        FIRST_RESERVED_UNIT.. => Meaning::wrong(format!("unit {unit}, a reserved number")),
        _ => Meaning::valid(format!("unit {unit}")),
    };
    Piece::new(Layer::Frame, 0, &[unit], "unit", unit.to_string(), meaning)
}

fn checksum(kind: &str, found: u16, expected: u16, width: usize) -> Meaning {
    if found == expected {
        return Meaning::valid(format!("{kind} OK"));
    }
    Meaning::wrong(format!("{kind} error: 0x{expected:0width$X} expected, 0x{found:0width$X} found"))
}

fn noise(frame: &[u8], why: String) -> Vec<Piece> {
    vec![Piece::new(Layer::Frame, 0, frame, "noise", spaced_hex(frame), Meaning::wrong(why))]
}
