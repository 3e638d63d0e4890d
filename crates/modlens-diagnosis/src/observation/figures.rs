//! The two numbers that show what is wrong with a frame, as far as its bytes tell: what it says, and what is there.

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::checksum::{crc16, crc_valid, lrc, CRC_BYTES};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::hex::parse_hex;
use modlens_protocol::mbap::{layout_fits, layout_lengths, PREFIX_BYTES};
use modlens_protocol::status::Status;

/// What a frame says, and what is there or belongs there.
pub type Figures = [u32; 2];

/// The place of a byte count in a frame: after the unit and the function.
const COUNT: usize = 2;

/// Of a length field, a byte count or the length of the data, the numbers of the odd frame in a row.
pub(super) fn of(batch: &Batch, row: &Transaction, has: impl Fn(Finding) -> bool) -> Option<Figures> {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    let odd = if answer.is_empty() { request } else { answer };
    if has(Finding::MbapLength) {
        let header = of_header(odd)?;
        if let Some(more) = added(odd) {
            return Some([more, 0]);
        }
        return if header[0] == header[1] { of_count(odd, PREFIX_BYTES, 0) } else { Some(header) };
    }
    if has(Finding::TransactionId) && row.mode == Mode::Tcp {
        let id = |frame: &[u8]| Some(u32::from(u16::from_be_bytes([*frame.first()?, *frame.get(1)?])));
        return Some([id(answer)?, id(request)?]).filter(|[one, other]| one != other);
    }
    if has(Finding::WrongFunction) {
        let codes = [&row.response, &row.request].map(|part| part.pdu.of(&batch.arena).first().copied());
        return Some([codes[0]? & !EXCEPTION_BIT, codes[1]?].map(u32::from));
    }
    if has(Finding::EchoMismatch) {
        let [answer, request] = [&row.response, &row.request].map(|part| part.pdu.of(&batch.arena));
        return other_word(answer, request);
    }
    if has(Finding::ResponseLength) {
        let [count, asked] = [&row.response, &row.request].map(|part| part.pdu.of(&batch.arena));
        return Some([u32::from(*count.get(1)?), asked_bytes(asked)?]);
    }
    let is_odd = has(Finding::LengthMismatch) || has(Finding::Incomplete);
    let is_whole = row.mode == Mode::Rtu && is_odd && crc_valid(odd);
    is_whole.then(|| of_count(odd, 0, CRC_BYTES))?
}

/// The checksum of a damaged frame and the one that belongs there, its first byte the high one.
pub(super) fn checksum(batch: &Batch, row: &Transaction) -> Option<Figures> {
    let damaged = match row.status {
        Status::BadResponse => &row.response,
        Status::BadRequest => &row.request,
        _ => return None,
    };
    let wire = damaged.wire.of(&batch.arena);
    if row.mode == Mode::Ascii {
        return of_characters(wire).filter(|_| row.status == Status::BadResponse);
    }
    let (body, there) = wire.split_last_chunk::<CRC_BYTES>().filter(|_| row.mode == Mode::Rtu)?;
    Some([there, &crc16(body).to_le_bytes()].map(|pair| u16::from_be_bytes(*pair).into()))
}

/// The checksum of a frame in ASCII, and the one that belongs there, where its layout is that of its function.
fn of_characters(wire: &[u8]) -> Option<Figures> {
    let bytes = parse_hex(std::str::from_utf8(wire.get(1..)?).ok()?.trim_end())?;
    let (there, body) = bytes.split_last()?;
    let is_whole = layout_fits(Functions::embedded(), body.get(1..).filter(|pdu| !pdu.is_empty())?);
    (is_whole && *there != lrc(body)).then(|| [*there, lrc(body)].map(u32::from))
}

/// The first of address and value in which the confirmation of a write differs from it: as confirmed, and as written.
fn other_word(answer: &[u8], request: &[u8]) -> Option<Figures> {
    let word = |pdu: &[u8], at: usize| Some(u32::from(u16::from_be_bytes([*pdu.get(at)?, *pdu.get(at + 1)?])));
    let pair = |at: usize| Some([word(answer, at)?, word(request, at)?]);
    [1, 3].into_iter().filter_map(pair).find(|[confirmed, written]| confirmed != written)
}

/// The length field of a header, and the bytes that follow it.
pub(crate) fn of_header(frame: &[u8]) -> Option<Figures> {
    let field = frame.get(PREFIX_BYTES - 2..PREFIX_BYTES).filter(|_| frame[2..4] == [0, 0])?;
    Some([u16::from_be_bytes([field[0], field[1]]).into(), (frame.len() - PREFIX_BYTES) as u32])
}

/// How many bytes follow a frame over Modbus/TCP whose header is right by the layout of its function, and which is none with them.
pub(crate) fn added(bytes: &[u8]) -> Option<u32> {
    let [announced, present] = of_header(bytes)?;
    let whole = PREFIX_BYTES + announced as usize;
    let lengths = layout_lengths(Functions::embedded(), bytes);
    let is_right = present > announced && lengths.contains(&Some(whole)) && !lengths.contains(&Some(bytes.len()));
    is_right.then(|| present - announced)
}

/// A byte count, and the bytes that follow it.
fn of_count(frame: &[u8], head: usize, tail: usize) -> Option<Figures> {
    let present = frame.len().checked_sub(head + COUNT + 1 + tail)?;
    Some([u32::from(frame[head + COUNT]), present as u32])
}

/// The data bytes that a request to read asks for.
fn asked_bytes(request: &[u8]) -> Option<u32> {
    let row = Functions::embedded().row(*request.first()?, &request[1..])?;
    modlens_protocol::direction::expected_data_bytes(row, request).map(|bytes| bytes as u32)
}
