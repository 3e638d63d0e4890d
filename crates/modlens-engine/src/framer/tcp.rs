//! Modbus/TCP: frames by the MBAP header (messaging on TCP/IP, 3.1.3).

use crate::framer::{FrameResult, Framer, FramerContext, FramingFault, MAX_NOISE_ROW_BYTES};
use crate::input::{Input, NO_TIME};
use crate::weights::{CRC_CONFIDENCE_BITS, MBAP_CONFIDENCE_BITS, TCP_FRAME_BREAK_NS};
use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::direction::infer_direction;
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
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

/// Whether a whole frame stands at the start of these bytes whose header and layout agree; `None` if bytes are missing and
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

/// Whether the read that begins here ends with the frame, or with a CRC behind it.
fn is_whole_read(input: &Input, length: usize) -> bool {
    let rest = input.bytes_left_in_read(0);
    let is_read = input.read(0).is_some_and(|read| read.starts_record || read.time != NO_TIME);
    is_read && rest == length || (rest == length + CRC_BYTES && has_crc_behind(input, length))
}

/// Whether a gateway has left the CRC of the RTU frame behind the PDU, and the read ends with it.
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

impl TcpFramer {
    /// Whether the frame at the first byte ends where its header announces it. `length` is what the header announces, in bytes
    /// of the whole frame; not all of them need to have come.
    ///
    /// 1. `Wrong` if the layout ends the frame earlier, as a request or as a response, and a whole frame begins right there
    ///    and ends before `length`, among the bytes that have come.
    /// 2. `Plausible` if the layout admits the announced length, or if the frame has not come as a whole: then the caller
    ///    waits for it, and asks again.
    /// 3. Else header and layout contradict each other, and the next whole frame decides, looked for first at the announced
    ///    end, then at the layout's ends, then at every end of a shorter frame than the longest one. At the announced end:
    ///    `Plausible`; elsewhere: `Wrong`. If bytes are missing to tell, `Undecided` until the input is closed. Without such a frame,
    ///    `Plausible`: `complete` reports that the layout does not fit.
    fn check_length(input: &Input, context: &FramerContext<'_>, length: usize) -> LengthCheck {
        let (bytes, functions) = (input.bytes(), context.functions);
        let by_layout = layout_lengths(functions, bytes);
        // If the layout ends the frame earlier and the next frame begins there, the header announces too much.
        let available = bytes.len().min(length - 1);
        let earlier_ends = by_layout.into_iter().flatten().filter(|&end| end < available);
        for end in earlier_ends {
            if begins_with_frame(functions, &bytes[end..available]) == Some(true) {
                return LengthCheck::Wrong(end);
            }
        }
        if bytes.len() < length || layout_fits(functions, &bytes[PREFIX_BYTES + 1..length]) {
            return LengthCheck::Plausible;
        }
        let any_end = HEADER_BYTES..PREFIX_BYTES + MAX_LENGTH_FIELD;
        for end in std::iter::once(length).chain(by_layout.into_iter().flatten()).chain(any_end) {
            // A place that has not come yet is awaited: how the bytes were split into blocks must not matter.
            match bytes.get(end..).and_then(|behind| begins_with_frame(functions, behind)) {
                Some(true) if end == length => return LengthCheck::Plausible,
                Some(true) => return LengthCheck::Wrong(end),
                None if !input.is_closed => return LengthCheck::Undecided,
                _ => {}
            }
        }
        LengthCheck::Plausible
    }

    /// Whether a frame begins at index `at` of the input; `None` if more bytes are needed, which cannot be once it is closed.
    ///
    /// At the first byte a header is enough, except behind an edge (a record's start, a loss, a long silence) if the read does
    /// not end with the announced frame. There, and at any later index, the whole frame has to be there and its layout fit.
    fn begins(input: &Input, context: &FramerContext<'_>, at: usize) -> Option<bool> {
        let bytes = &input.bytes()[at..];
        if bytes.len() < HEADER_BYTES {
            return input.is_closed.then_some(false);
        }
        let Some(length) = announced_length(bytes) else { return Some(false) };
        // A record, or the first bytes behind a loss, may begin anywhere in a frame.
        let follows_edge = input.is_boundary(0);
        if at == 0 && (!follows_edge || is_whole_read(input, length)) {
            return Some(true);
        }
        // Behind bytes that belong to no frame, a header alone is weak evidence.
        match bytes.get(PREFIX_BYTES + 1..length) {
            Some(pdu) => Some(pdu[0] & !EXCEPTION_BIT != 0 && layout_fits(context.functions, pdu)),
            None => input.is_closed.then_some(false),
        }
    }

    /// The row of the frame at the first byte, where a header stands (`begins`); `None` if more bytes are needed. `adu` is
    /// cleared and gets unit and PDU, as far as they belong to the frame.
    ///
    /// `Incomplete` in three cases: a record starts or bytes were lost before the announced end (a silence alone does not end a
    /// frame here); the length is wrong (`check_length`), which is a fault as well; or the input is closed before the announced
    /// end, by the end of the recording or, live, by a silence of `break_ns` and more (`Input::is_closed`). Else the
    /// row is that of `complete`. On a connection, whose packets are known, a header is believed without `check_length` if the
    /// packet ends with the frame, or with a CRC that a gateway left behind it.
    fn frame(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let bytes = input.bytes();
        let length = announced_length(bytes)?;
        adu.clear();
        let mbap_id = Some(u16::from_be_bytes([bytes[0], bytes[1]]));
        let incomplete = |length: usize, delimited_by: DelimitedBy| FrameResult {
            verdict: Verdict::Incomplete,
            mbap_id,
            ..FrameResult::noise(length, delimited_by)
        };
        // No silence is as long as this, so that only the start of a record or a loss counts.
        if let Some(edge) = input.boundary_after(0, length - 1, Ns::MAX) {
            adu.extend_from_slice(bytes.get(PREFIX_BYTES..edge).unwrap_or(&[]));
            return Some(incomplete(edge, DelimitedBy::Record));
        }
        // On a connection, a packet that ends with the frame confirms the header.
        let is_confirmed = context.connection_side.is_some() && is_whole_read(input, length);
        match if is_confirmed { LengthCheck::Plausible } else { Self::check_length(input, context, length) } {
            LengthCheck::Plausible => {}
            LengthCheck::Undecided => return None,
            LengthCheck::Wrong(end) => {
                adu.extend_from_slice(&bytes[PREFIX_BYTES..end]);
                let fault = Some(FramingFault::MbapLength);
                return Some(FrameResult { fault, ..incomplete(end, DelimitedBy::Frame) });
            }
        }
        if bytes.len() < length {
            adu.extend_from_slice(&bytes[PREFIX_BYTES..]);
            let delimited_by = if input.is_ended { DelimitedBy::End } else { DelimitedBy::Silence };
            return input.is_closed.then(|| incomplete(bytes.len(), delimited_by));
        }
        adu.extend_from_slice(&bytes[PREFIX_BYTES..length]);
        Some(Self::complete(input, context, adu, length, mbap_id))
    }

    /// The row of a frame of `length` bytes, which have all come; `adu` has its unit and PDU. It is `Ok` in any case: a layout
    /// that does not fit, or a CRC of the RTU frame left behind the PDU, is a fault. Such a CRC is part of the row. The side of
    /// the connection is the direction; without one, it is inferred, and the silence in front says nothing.
    fn complete(input: &Input, context: &FramerContext<'_>, adu: &[u8], length: usize, mbap_id: Option<u16>) -> FrameResult {
        let pdu = &adu[1..];
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
        let noise = FrameResult::noise(length, DelimitedBy::Length);
        FrameResult { verdict: Verdict::Ok, direction, confidence, mbap_id, fault, ..noise }
    }
}

impl Framer for TcpFramer {
    /// The frame at the first byte, or one noise row of all bytes up to the next frame, as many as `MAX_NOISE_ROW_BYTES`, or
    /// up to the end once the input is closed.
    ///
    /// `noise_bytes` counts the bytes from the first one on that begin no frame, so that a further call looks at none of them
    /// again; each turn of the loop looks at one more place. It is 0 again behind a noise row. `None`, so no row yet, if there
    /// are no bytes, or if the bytes at the next place, or of the frame at the first byte, are too few to tell.
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        loop {
            let available = input.bytes().len();
            let at = self.noise_bytes;
            let begins = if at < available { Self::begins(input, context, at) } else { None };
            match begins {
                Some(true) if at == 0 => return Self::frame(input, context, adu),
                Some(false) if at + 1 < MAX_NOISE_ROW_BYTES => self.noise_bytes += 1,
                None if !(input.is_closed && at > 0) => return None,
                begins => {
                    let length = if begins == Some(false) { at + 1 } else { at };
                    let delimited_by = match begins {
                        Some(true) => DelimitedBy::Frame,
                        Some(false) => DelimitedBy::Limit,
                        None if input.is_ended => DelimitedBy::End,
                        None => DelimitedBy::Silence,
                    };
                    self.noise_bytes = 0;
                    adu.clear();
                    return Some(FrameResult::noise(length, delimited_by));
                }
            }
        }
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
