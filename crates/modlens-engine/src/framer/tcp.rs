//! Modbus/TCP: frames by the MBAP header (messaging on TCP/IP, 3.1.3).

use crate::framer::{FrameResult, Framer, FramerContext, FramingFault, MAX_NOISE_ROW_BYTES};
use crate::input::{Input, NO_TIME};
use crate::rtu_model::side::REQUEST;
use crate::weights::{CRC_CONFIDENCE_BITS, MBAP_CONFIDENCE_BITS, TCP_FRAME_BREAK_NS};
use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::direction::{expected_data_bytes, infer_direction};
use modlens_protocol::framing::{DelimitedBy, Direction, Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::line::LineSettings;
use modlens_protocol::mbap::{announced_length, layout_fits, layout_lengths, MAX_LENGTH_FIELD, PREFIX_BYTES};
use modlens_protocol::Ns;

/// The header with the unit, and the function code: the bytes by which a frame is recognised.
const HEADER_BYTES: usize = PREFIX_BYTES + 2;

/// The framer of one direction, or both, of a Modbus/TCP stream.
#[derive(Debug, Default)]
pub struct TcpFramer {
    /// How many bytes from the first on begin no frame.
    noise_bytes: usize,
}

/// Whether a whole frame is at the start of these bytes whose header and layout agree; `None` if bytes are missing and
/// those that are there do not contradict it.
fn begins_with_frame(functions: &Functions, bytes: &[u8]) -> Option<bool> {
    if bytes.len() < HEADER_BYTES {
        let has_protocol_zero = bytes.iter().skip(2).take(2).all(|&byte| byte == 0);
        return if has_protocol_zero { None } else { Some(false) };
    }
    let has_function = bytes[PREFIX_BYTES + 1] & !EXCEPTION_BIT != 0;
    let Some(length) = announced_length(bytes).filter(|_| has_function) else { return Some(false) };
    bytes.get(PREFIX_BYTES + 1..length).map(|pdu| layout_fits(functions, pdu))
}

/// Whether the read that begins here ends with the frame, or with a CRC after it.
fn is_whole_read(input: &Input, length: usize) -> bool {
    let rest = input.bytes_left_in_read(0);
    let is_read = input.read(0).is_some_and(|read| read.starts_record || read.time != NO_TIME);
    is_read && rest == length || (rest == length + CRC_BYTES && has_crc_behind(input, length))
}

/// Whether a header is that of the response that the outstanding request expects: unit, function and length fit, where
/// the function has one. That is as good as its layout, and a recording may print the beginning of a long response only.
fn answers(context: &FramerContext<'_>, bytes: &[u8], length: usize) -> bool {
    let Some(request) = context.outstanding_request else { return false };
    let Some((&code, body)) = request.pdu.split_first() else { return false };
    let fits = |row| expected_data_bytes(row, request.pdu).is_some_and(|data| length == HEADER_BYTES + 1 + data);
    bytes[PREFIX_BYTES..HEADER_BYTES] == [request.unit, code] && context.functions.row(code, body).is_none_or(fits)
}

/// Whether a gateway has left the CRC of the RTU frame after the PDU, and the read ends with it.
fn has_crc_behind(input: &Input, length: usize) -> bool {
    // Blocks of a file are no reads: a read has a time or starts a record.
    input.read(length - 1).is_some_and(|read| read.starts_record || read.time != NO_TIME)
        && input.bytes_left_in_read(length - 1) == 1 + CRC_BYTES
        && input.bytes().get(PREFIX_BYTES..length + CRC_BYTES).is_some_and(crc_valid)
}

/// Whether the length in a header is believed.
enum LengthCheck {
    /// Nothing contradicts it.
    Plausible,
    /// The frame ends after this many bytes, whatever the header announces.
    Wrong(usize),
    /// More bytes are needed to tell.
    Undecided,
}

/// The length of the frame at the first byte by its layout, as a request or as a response, if that is less than `length`, what
/// its header announces, and a whole frame begins right after it and ends before `length`, among the bytes that have come.
fn earlier_end(functions: &Functions, bytes: &[u8], length: usize) -> Option<usize> {
    let available = bytes.len().min(length - 1);
    let ends = layout_lengths(functions, bytes).into_iter().flatten().filter(|&end| end < available);
    ends.into_iter().find(|&end| begins_with_frame(functions, &bytes[end..available]) == Some(true))
}

/// The end of the record that begins with the frame at the first byte, if the frame ends there as a response by its byte count,
/// and its header announces less (`length`): a request with a field out of its limits, and then too few bytes for a frame.
fn later_end(input: &Input, functions: &Functions, length: usize) -> Option<usize> {
    let end = input.bytes_left_in_read(0);
    let is_record = input.read(0).is_some_and(|read| read.starts_record);
    let bytes = input.bytes().get(..end).filter(|_| is_record && end > length && end < length + HEADER_BYTES)?;
    let body = bytes.get(HEADER_BYTES..length)?;
    let limits = functions.row(bytes[HEADER_BYTES - 1], body)?.field_limits[REQUEST].iter();
    let is_no_request = limits.into_iter().any(|limits| limits.violated_by(body).is_some());
    (is_no_request && layout_lengths(functions, bytes).contains(&Some(end))).then_some(end)
}

/// The row of a frame whose last bytes did not come before the input was closed: all bytes that are there. `adu` gets its unit
/// and PDU, as far as they are there.
fn cut_short(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> FrameResult {
    let delimited_by = if input.is_ended { DelimitedBy::End } else { DelimitedBy::Silence };
    incomplete(input, context, input.bytes().len(), delimited_by, adu)
}

/// The row of a frame of which only the first `length` bytes are there. `adu`, which is empty, gets unit and PDU as far as they
/// came.
fn incomplete(
    input: &Input,
    context: &FramerContext<'_>,
    length: usize,
    delimited_by: DelimitedBy,
    adu: &mut Vec<u8>,
) -> FrameResult {
    adu.extend_from_slice(input.bytes().get(PREFIX_BYTES..length).unwrap_or(&[]));
    let mbap_id = transaction_identifier(input.bytes());
    let declared = context.connection_side.or_else(|| context.declared_direction_at(input, 0));
    let direction = declared.unwrap_or(Direction::Unknown);
    FrameResult { direction, mbap_id, ..FrameResult::new(Verdict::Incomplete, length, delimited_by) }
}

/// The transaction identifier of the header that begins with the first byte.
fn transaction_identifier(bytes: &[u8]) -> Option<u16> {
    bytes.first_chunk().map(|&id| u16::from_be_bytes(id))
}

impl TcpFramer {
    /// Whether the frame at the first byte ends where its header announces it. `length` is what the header announces, in bytes
    /// of the whole frame; not all of them need to have come.
    ///
    /// 1. `Wrong` if the layout ends the frame earlier (`earlier_end`).
    /// 2. `Plausible` if the layout admits the announced length, or if the frame has not come as a whole: then the caller
    ///    waits for it, and asks again.
    /// 3. Else header and layout contradict each other, and the next whole frame decides (`check_by_next_frame`).
    fn check_length(input: &Input, context: &FramerContext<'_>, length: usize) -> LengthCheck {
        let bytes = input.bytes();
        if let Some(end) = earlier_end(context.functions, bytes, length) {
            return LengthCheck::Wrong(end);
        }
        if bytes.len() < length || layout_fits(context.functions, &bytes[PREFIX_BYTES + 1..length]) {
            return LengthCheck::Plausible;
        }
        Self::check_by_next_frame(input, context.functions, length)
    }

    /// Where the next whole frame begins, if header and layout of the first one contradict each other: it is looked for at the
    /// announced end first (`length`), then at the ends by the layout, then at the end of every frame that may be, from
    /// the shortest to the longest one.
    ///
    /// At the announced end: `Plausible`; elsewhere: `Wrong`. If bytes are missing to tell at one of these places, `Undecided`
    /// until the input is closed: how the bytes were split into blocks must not matter. Without such a frame, `Plausible`:
    /// `complete` reports that the layout does not fit.
    fn check_by_next_frame(input: &Input, functions: &Functions, length: usize) -> LengthCheck {
        let bytes = input.bytes();
        let by_layout = layout_lengths(functions, bytes);
        let any_end = HEADER_BYTES..=PREFIX_BYTES + MAX_LENGTH_FIELD;
        for end in std::iter::once(length).chain(by_layout.into_iter().flatten()).chain(any_end) {
            match bytes.get(end..).and_then(|behind| begins_with_frame(functions, behind)) {
                Some(true) if end == length => return LengthCheck::Plausible,
                Some(true) => return LengthCheck::Wrong(end),
                None if !input.is_closed => return LengthCheck::Undecided,
                _ => {}
            }
        }
        LengthCheck::Plausible
    }

    /// Moves `noise_bytes` to the next index at which a frame begins (`Some(true)`), to the limit of a noise row
    /// (`Some(false)`), or to the first place that cannot be decided because bytes are missing, be it after the last one
    /// (`None`). A further call goes on from there, and looks at no earlier place again.
    fn skip_noise(&mut self, input: &Input, context: &FramerContext<'_>) -> Option<bool> {
        while self.noise_bytes < MAX_NOISE_ROW_BYTES {
            let is_there = self.noise_bytes < input.bytes().len();
            let begins = if is_there { Self::begins(input, context, self.noise_bytes) } else { None };
            if begins != Some(false) {
                return begins;
            }
            self.noise_bytes += 1;
        }
        Some(false)
    }

    /// Whether a frame begins at index `at` of the input; `None` if more bytes are needed, which cannot be once it is closed.
    ///
    /// At the first byte a header is enough, except after an edge (a record's start, a loss, a long silence) if the read does
    /// not end with the announced frame. There, and at any later index, the whole frame has to be there and its layout fit.
    fn begins(input: &Input, context: &FramerContext<'_>, at: usize) -> Option<bool> {
        let bytes = &input.bytes()[at..];
        if bytes.len() < HEADER_BYTES {
            return input.is_closed.then_some(false);
        }
        let Some(length) = announced_length(bytes) else { return Some(false) };
        // A record, or the first bytes after a loss, may begin anywhere in a frame.
        let follows_edge = input.is_boundary(0);
        if at == 0 && (!follows_edge || is_whole_read(input, length) || answers(context, bytes, length)) {
            return Some(true);
        }
        // After bytes that belong to no frame, a header alone is weak evidence.
        match bytes.get(PREFIX_BYTES + 1..length) {
            Some(pdu) => Some(pdu[0] & !EXCEPTION_BIT != 0 && layout_fits(context.functions, pdu)),
            None => input.is_closed.then_some(false),
        }
    }

    /// The row of the frame at the first byte, where a header stands (`begins`); `None` if more bytes are needed. `adu` is
    /// cleared and gets unit and PDU, as far as they belong to the frame.
    ///
    /// Where the byte count contradicts the announced length and the record ends with it, the row ends there (`later_end`).
    ///
    /// `Incomplete` in three cases: a record starts or bytes were lost before the announced end (a silence alone does not end a
    /// frame here); the length is wrong (`check_length`), which is a fault as well; or the input is closed before the announced
    /// end, by the end of the recording or, live, by a silence of `break_ns` and more (`Input::is_closed`). Else the
    /// row is that of `complete`. On a connection, whose packets are known, a header is believed without `check_length` if the
    /// packet ends with the frame, or with a CRC that a gateway left after it.
    fn frame(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        adu.clear();
        let length = announced_length(input.bytes())?;
        // No silence is as long as this, so that only the start of a record or a loss counts.
        if let Some(edge) = input.boundary_after(0, length - 1, Ns::MAX) {
            return Some(incomplete(input, context, edge, DelimitedBy::Record, adu));
        }
        if let Some(end) = later_end(input, context.functions, length) {
            let fault = Some(FramingFault::MbapLength);
            return Some(FrameResult { fault, confidence: CRC_CONFIDENCE_BITS, ..Self::complete(input, context, adu, end) });
        }
        let is_confirmed = context.connection_side.is_some() && is_whole_read(input, length);
        match if is_confirmed { LengthCheck::Plausible } else { Self::check_length(input, context, length) } {
            LengthCheck::Undecided => None,
            LengthCheck::Wrong(end) => {
                let fault = Some(FramingFault::MbapLength);
                Some(FrameResult { fault, ..incomplete(input, context, end, DelimitedBy::Frame, adu) })
            }
            LengthCheck::Plausible if input.bytes().len() >= length => Some(Self::complete(input, context, adu, length)),
            LengthCheck::Plausible => input.is_closed.then(|| cut_short(input, context, adu)),
        }
    }

    /// The row of a frame of `length` bytes, which have all come; `adu` gets its unit and PDU. It is `Ok` in any case: a layout
    /// that does not fit, or a CRC of the RTU frame left after the PDU, is a fault. Such a CRC is part of the row. The side of
    /// the connection is the direction; without one, it is inferred, and the silence in front says nothing.
    fn complete(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>, length: usize) -> FrameResult {
        adu.extend_from_slice(&input.bytes()[PREFIX_BYTES..length]);
        let pdu = &adu[1..];
        let mbap_id = transaction_identifier(input.bytes());
        let fits = layout_fits(context.functions, pdu);
        let inferred = || {
            let pause = (context.timeout_log_odds)(None);
            let declared = context.declared_direction_at(input, 0);
            infer_direction(context.functions, context.outstanding_request, adu[0], pdu, declared, pause)
        };
        let direction = context.connection_side.unwrap_or_else(inferred);
        let has_crc = has_crc_behind(input, length);
        let fault = (!fits || has_crc).then_some(FramingFault::MbapLength);
        let length = if has_crc { length + CRC_BYTES } else { length };
        let confidence = if fits { MBAP_CONFIDENCE_BITS } else { CRC_CONFIDENCE_BITS };
        let frame = FrameResult::new(Verdict::Ok, length, DelimitedBy::Length);
        FrameResult { direction, confidence, mbap_id, fault, ..frame }
    }
}

impl Framer for TcpFramer {
    /// The frame at the first byte, or one noise row of all bytes up to the next frame, as many as `MAX_NOISE_ROW_BYTES`, or
    /// up to the end once the input is closed. `None`, so no row yet, if there are no bytes, or if the bytes at the next place,
    /// or of the frame at the first byte, are too few to tell.
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let delimited_by = match self.skip_noise(input, context) {
            Some(true) if self.noise_bytes == 0 => return Self::frame(input, context, adu),
            Some(true) => DelimitedBy::Frame,
            Some(false) => DelimitedBy::Limit,
            None if !input.is_closed || self.noise_bytes == 0 => return None,
            None if input.is_ended => DelimitedBy::End,
            None => DelimitedBy::Silence,
        };
        adu.clear();
        Some(FrameResult::noise(std::mem::take(&mut self.noise_bytes), delimited_by))
    }

    fn mode(&self) -> Mode {
        Mode::Tcp
    }

    fn is_settled_at(&self, _offset: u64) -> bool {
        self.noise_bytes == 0
    }

    fn break_ns(&self, _line: Option<&LineSettings>) -> Ns {
        TCP_FRAME_BREAK_NS
    }
}
