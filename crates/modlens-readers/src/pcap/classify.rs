//! Decides from the first bytes of a connection whether it carries Modbus, in which framing, and which side is the client.
//!
//! On a port that is known for Modbus one whole frame is enough. On any other port a request with its response or several
//! frames in a row are needed, because the headers of other protocols are full of zeros, too.

use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::{match_response, possible_directions, RequestRef, ResponseMatch};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::mbap::{announced_length, layout_fits};
use modlens_protocol::recognize::mode_by_valid_frames;
use modlens_protocol::Ns;

/// A connection on a known port without a frame in so many bytes is not Modbus.
const MAX_UNDECIDED_BYTES: usize = 4096;

/// A connection without a frame in so many segments is not Modbus.
const MAX_UNDECIDED_SEGMENTS: usize = 32;

/// On other ports a connection is given up after fewer bytes.
const MAX_UNDECIDED_BYTES_ON_ANY_PORT: usize = 1024;

/// So many frames of one side in a row prove Modbus without a response.
const MIN_FRAMES_IN_A_ROW: usize = 3;

/// Bytes of the MBAP header, unit identifier included (MODBUS Messaging on TCP/IP, 3.1.3).
const MBAP_BYTES: usize = 7;

/// Bytes of a stream that are kept until the decision is taken.
#[derive(Clone, Debug)]
pub struct BufferedChunk {
    /// Who sent it: 0 or 1.
    pub side: usize,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Number of the packet that they came in.
    pub packet: u64,
    /// When the packet was captured.
    pub time: Option<Ns>,
    /// How many bytes are missing from the capture before them.
    pub missing: u32,
    /// The capture kept only a part of the packet.
    pub cut: bool,
}

/// What a connection turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Classification {
    /// Modbus in this framing, and the side (0 or 1) of the client, where the frames show it.
    Modbus(Mode, Option<usize>),
    /// Something else.
    Other,
}

/// A whole frame that has the layout of Modbus.
struct FrameCandidate<'a> {
    mode: Mode,
    side: usize,
    /// Transaction identifier; 0 in frames without MBAP header.
    transaction_id: u16,
    unit: u8,
    pdu: &'a [u8],
}

/// Classifies a connection by its bytes so far; `None` means that more bytes are needed. If it has ended, the decision is
/// taken with what there is.
pub fn classify(functions: &Functions, held: &[BufferedChunk], is_known_port: bool, has_ended: bool) -> Option<Classification> {
    let found = if is_known_port { on_known_port(functions, held) } else { anywhere(functions, held) };
    if found.is_some() {
        return found;
    }
    let bytes: usize = held.iter().map(|segment| segment.bytes.len()).sum();
    let limit = if is_known_port { MAX_UNDECIDED_BYTES } else { MAX_UNDECIDED_BYTES_ON_ANY_PORT };
    (has_ended || held.len() >= MAX_UNDECIDED_SEGMENTS || bytes >= limit).then_some(Classification::Other)
}

/// The framing of the whole frame that the bytes of a segment begin with; `None` if they begin with none.
pub fn framing_of_segment(functions: &Functions, bytes: &[u8]) -> Option<Mode> {
    let mbap_frame = || {
        let length = announced_length(bytes).filter(|&length| length <= bytes.len())?;
        (length == bytes.len() || layout_fits(functions, &bytes[MBAP_BYTES..length])).then_some(Mode::Tcp)
    };
    let rtu_frame = parse_rtu(functions, bytes).map(|_| Mode::Rtu);
    rtu_frame.or_else(mbap_frame).or_else(|| mode_by_valid_frames(functions, bytes))
}

/// Looks for one whole frame, where the port number already speaks for Modbus.
fn on_known_port(functions: &Functions, held: &[BufferedChunk]) -> Option<Classification> {
    for side in 0..2 {
        let mine = || held.iter().filter(move |segment| segment.side == side);
        let all: Vec<u8> = mine().flat_map(|segment| segment.bytes.iter().copied()).collect();
        let mut start = 0;
        for segment in mine() {
            let bytes = &all[start..];
            let whole = announced_length(bytes).filter(|&length| length <= bytes.len());
            // If the packet ends exactly where the header says, an unknown layout does not speak against Modbus.
            if whole.is_some_and(|length| length == segment.bytes.len() || layout_fits(functions, &bytes[MBAP_BYTES..length])) {
                return Some(Classification::Modbus(Mode::Tcp, client_side(functions, held)));
            }
            if parse_rtu(functions, &segment.bytes).is_some() {
                return Some(Classification::Modbus(Mode::Rtu, client_side(functions, held)));
            }
            start += segment.bytes.len();
        }
        // Frames of RTU or ASCII may be split or joined arbitrarily. What looks like the beginning of an MBAP frame may
        // still become one, so it is not taken for RTU.
        let may_be_mbap = announced_length(&all).is_some();
        if let Some(mode) =
            mode_by_valid_frames(functions, &all).filter(|mode| *mode == Mode::Ascii || (*mode == Mode::Rtu && !may_be_mbap))
        {
            return Some(Classification::Modbus(mode, None));
        }
    }
    None
}

/// Looks for a request with its response, or for several frames of one side in a row.
fn anywhere(functions: &Functions, held: &[BufferedChunk]) -> Option<Classification> {
    let frames: Vec<FrameCandidate<'_>> = held.iter().flat_map(|segment| whole_frames(functions, segment)).collect();
    for (at, request) in frames.iter().enumerate() {
        let has_response = frames[at + 1..].iter().any(|other| is_response_to(functions, request, other));
        if has_response && possible_directions(functions, request.pdu).0 {
            return Some(Classification::Modbus(request.mode, Some(request.side)));
        }
    }
    for side in 0..2 {
        let mine = || frames.iter().filter(|it| it.side == side);
        let count = held.iter().filter(|segment| segment.side == side).count();
        if mine().count() >= MIN_FRAMES_IN_A_ROW.max(count) {
            let asks = mine().all(|it| possible_directions(functions, it.pdu).0);
            let mode = mine().next()?.mode;
            return Some(Classification::Modbus(mode, Some(if asks { side } else { 1 - side })));
        }
    }
    None
}

/// Whether `other` is the response to the request `request` in every field that a response repeats.
fn is_response_to(functions: &Functions, request: &FrameCandidate<'_>, other: &FrameCandidate<'_>) -> bool {
    other.side != request.side
        && (other.mode, other.transaction_id) == (request.mode, request.transaction_id)
        && match_response(functions, RequestRef { unit: request.unit, pdu: request.pdu }, other.unit, other.pdu)
            == ResponseMatch::Fully
}

/// The side of the client: that of the first frame that can only be a request, or the opposite of that of the first one
/// that can only be a response.
fn client_side(functions: &Functions, held: &[BufferedChunk]) -> Option<usize> {
    held.iter().flat_map(|segment| whole_frames(functions, segment)).find_map(|it| match possible_directions(functions, it.pdu) {
        (true, false) => Some(it.side),
        (false, true) => Some(1 - it.side),
        _ => None,
    })
}

/// The whole frames with a known function at the start of the bytes of one segment.
fn whole_frames<'a>(functions: &'a Functions, segment: &'a BufferedChunk) -> Vec<FrameCandidate<'a>> {
    let mut found = Vec::new();
    if let Some((unit, pdu)) = parse_rtu(functions, &segment.bytes) {
        found.push(FrameCandidate { mode: Mode::Rtu, side: segment.side, transaction_id: 0, unit, pdu });
        return found;
    }
    let mut rest = &segment.bytes[..];
    while let Some(length) = announced_length(rest).filter(|&length| length <= rest.len()) {
        let pdu = &rest[MBAP_BYTES..length];
        if !has_known_function(functions, pdu) || !layout_fits(functions, pdu) {
            break;
        }
        let transaction_id = u16::from_be_bytes([rest[0], rest[1]]);
        found.push(FrameCandidate { mode: Mode::Tcp, side: segment.side, transaction_id, unit: rest[MBAP_BYTES - 1], pdu });
        rest = &rest[length..];
    }
    found
}

/// Unit and PDU if the bytes are exactly one RTU frame with a known function.
fn parse_rtu<'a>(functions: &Functions, bytes: &'a [u8]) -> Option<(u8, &'a [u8])> {
    let pdu = bytes.get(1..bytes.len().checked_sub(2)?)?;
    (crc_valid(bytes) && has_known_function(functions, pdu) && layout_fits(functions, pdu)).then(|| (bytes[0], pdu))
}

/// Whether the function code of the PDU, without the exception bit, is in the table of functions.
fn has_known_function(functions: &Functions, pdu: &[u8]) -> bool {
    pdu.first().is_some_and(|code| functions.name(code & !EXCEPTION_BIT).is_some())
}
