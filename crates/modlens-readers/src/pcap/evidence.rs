//! Is it Modbus, in what framing, and who asks? Decided once for a connection, on its first bytes.
//!
//! On a port that is named for Modbus one whole frame is enough. Anywhere else a question and its answer are asked for,
//! or a chain of frames: the headers of other protocols are full of zeros, too.

use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::{answers, readings, Asked, Match};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::mbap::{announced, layout_fits};
use modlens_protocol::recognize::evidence;
use modlens_protocol::Ns;

/// Without a frame in so many bytes it is something else.
const ENOUGH: usize = 4096;

/// Or in so many pieces.
const PIECES: usize = 32;

/// On any port, other protocols are given up sooner.
const ENOUGH_ANYWHERE: usize = 1024;

/// Frames of one side that are a chain.
const CHAIN: usize = 3;

/// Bytes of the MBAP header with the unit.
const HEADER: usize = 7;

/// A piece of a stream that waits for the decision.
#[derive(Clone, Debug)]
pub struct Held {
    /// Who sent it: 0 or 1.
    pub side: usize,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The packet it came in.
    pub packet: u64,
    /// When.
    pub time: Option<Ns>,
    /// Bytes missing before it.
    pub missing: u32,
    /// The capture cut its packet.
    pub cut: bool,
}

/// What a connection turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Modbus in this framing; the side that asks, where its frames say so.
    Modbus(Mode, Option<usize>),
    /// Something else.
    Other,
}

/// One frame that may be Modbus.
struct Candidate<'a> {
    mode: Mode,
    side: usize,
    id: u16,
    unit: u8,
    pdu: &'a [u8],
}

/// Decides, as soon as that can be done; at the end for good.
pub fn judge(functions: &Functions, held: &[Held], known_port: bool, ended: bool) -> Option<Found> {
    let found = if known_port { on_known_port(functions, held) } else { anywhere(functions, held) };
    if found.is_some() {
        return found;
    }
    let bytes: usize = held.iter().map(|piece| piece.bytes.len()).sum();
    let enough = if known_port { ENOUGH } else { ENOUGH_ANYWHERE };
    (ended || held.len() >= PIECES || bytes >= enough).then_some(Found::Other)
}

fn on_known_port(functions: &Functions, held: &[Held]) -> Option<Found> {
    for side in 0..2 {
        let mine = || held.iter().filter(move |piece| piece.side == side);
        let all: Vec<u8> = mine().flat_map(|piece| piece.bytes.iter().copied()).collect();
        let mut start = 0;
        for piece in mine() {
            let bytes = &all[start..];
            let whole = announced(bytes).filter(|&length| length <= bytes.len());
            // A layout that does not fit is forgiven where the packet ends with the frame.
            if whole.is_some_and(|length| length == piece.bytes.len() || layout_fits(functions, &bytes[HEADER..length])) {
                return Some(Found::Modbus(Mode::Tcp, asking(functions, held)));
            }
            if rtu(functions, &piece.bytes).is_some() {
                return Some(Found::Modbus(Mode::Rtu, asking(functions, held)));
            }
            start += piece.bytes.len();
        }
        // RTU or ASCII, byte by byte or joined; what looks like the beginning of an MBAP frame may still become one.
        let begun = announced(&all).is_some();
        if let Some(mode) = evidence(functions, &all).filter(|mode| *mode == Mode::Ascii || (*mode == Mode::Rtu && !begun)) {
            return Some(Found::Modbus(mode, None));
        }
    }
    None
}

/// A question and its answer, or a chain of frames of one side.
fn anywhere(functions: &Functions, held: &[Held]) -> Option<Found> {
    let candidates: Vec<Candidate<'_>> = held.iter().flat_map(|piece| candidates(functions, piece)).collect();
    for (at, asked) in candidates.iter().enumerate() {
        let answered = candidates[at + 1..].iter().any(|other| answers_it(functions, asked, other));
        if answered && readings(functions, asked.pdu).0 {
            return Some(Found::Modbus(asked.mode, Some(asked.side)));
        }
    }
    for side in 0..2 {
        let mine = || candidates.iter().filter(|it| it.side == side);
        let pieces = held.iter().filter(|piece| piece.side == side).count();
        if mine().count() >= CHAIN.max(pieces) {
            let asks = mine().all(|it| readings(functions, it.pdu).0);
            let mode = mine().next()?.mode;
            return Some(Found::Modbus(mode, Some(if asks { side } else { 1 - side })));
        }
    }
    None
}

fn answers_it(functions: &Functions, asked: &Candidate<'_>, other: &Candidate<'_>) -> bool {
    other.side != asked.side
        && (other.mode, other.id) == (asked.mode, asked.id)
        && answers(functions, Asked { unit: asked.unit, pdu: asked.pdu }, other.unit, other.pdu) == Match::Fully
}

/// The side whose frames can be questions only, or answers only the other way round.
fn asking(functions: &Functions, held: &[Held]) -> Option<usize> {
    held.iter().flat_map(|piece| candidates(functions, piece)).find_map(|it| match readings(functions, it.pdu) {
        (true, false) => Some(it.side),
        (false, true) => Some(1 - it.side),
        _ => None,
    })
}

/// The whole frames of known functions at the start of a piece.
fn candidates<'a>(functions: &'a Functions, piece: &'a Held) -> Vec<Candidate<'a>> {
    let mut found = Vec::new();
    if let Some((unit, pdu)) = rtu(functions, &piece.bytes) {
        found.push(Candidate { mode: Mode::Rtu, side: piece.side, id: 0, unit, pdu });
        return found;
    }
    let mut rest = &piece.bytes[..];
    while let Some(length) = announced(rest).filter(|&length| length <= rest.len()) {
        let pdu = &rest[HEADER..length];
        if !known(functions, pdu) || !layout_fits(functions, pdu) {
            break;
        }
        let id = u16::from_be_bytes([rest[0], rest[1]]);
        found.push(Candidate { mode: Mode::Tcp, side: piece.side, id, unit: rest[HEADER - 1], pdu });
        rest = &rest[length..];
    }
    found
}

/// Unit and PDU, if these bytes are one RTU frame.
fn rtu<'a>(functions: &Functions, bytes: &'a [u8]) -> Option<(u8, &'a [u8])> {
    let pdu = bytes.get(1..bytes.len().checked_sub(2)?)?;
    (crc_valid(bytes) && known(functions, pdu) && layout_fits(functions, pdu)).then(|| (bytes[0], pdu))
}

fn known(functions: &Functions, pdu: &[u8]) -> bool {
    pdu.first().is_some_and(|code| functions.name(code & !EXCEPTION_BIT).is_some())
}
