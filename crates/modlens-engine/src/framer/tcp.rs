//! Modbus/TCP: frames by the MBAP header (messaging on TCP/IP, 3.1.3).

use crate::framer::{Context, Cut, Framer, FramingFault, NOISE_LIMIT};
use crate::input::{Input, NO_TIME};
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::judge;
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::line::LineSettings;
use modlens_protocol::mbap::{announced, layout_fits, natural, HEADER, LONGEST};
use modlens_protocol::Ns;

/// A silence in a stream over TCP says nothing before it is this long.
const BREAK: Ns = 1_000_000_000;

/// Confidence where the header's protocol and length agree with the PDU's own.
pub const VALID_FRAME_BITS: u8 = 40;

/// The framer of one direction, or both, of a Modbus/TCP stream.
#[derive(Debug, Default)]
pub struct Tcp {
    /// So many bytes from the first on begin no frame.
    skip: usize,
}

/// Whether a whole frame stands at the start of these bytes whose header and layout agree; `None` if bytes are missing.
fn stands(functions: &Functions, bytes: &[u8]) -> Option<bool> {
    if bytes.len() < HEADER + 2 {
        let like = bytes.iter().skip(2).take(2).all(|&byte| byte == 0);
        return if like { None } else { Some(false) };
    }
    let Some(length) = announced(bytes).filter(|_| bytes[HEADER + 1] & !EXCEPTION_BIT != 0) else { return Some(false) };
    bytes.get(HEADER + 1..length).map(|pdu| layout_fits(functions, pdu))
}

/// Whether the read that begins here ends with the frame, or with the checksum behind it.
fn whole_read(input: &Input, length: usize) -> bool {
    let rest = input.rest_of_read(0);
    let is_read = input.read(0).is_some_and(|read| read.record || read.time != NO_TIME);
    is_read && rest == length || (rest == length + CRC_BYTES && checksum_behind(input, length))
}

/// Whether a gateway has left the checksum of RTU in, and the read ends with it.
fn checksum_behind(input: &Input, length: usize) -> bool {
    // Blocks of a file are no reads: only those with a time or a record's mark are.
    input.read(length - 1).is_some_and(|read| read.record || read.time != NO_TIME)
        && input.rest_of_read(length - 1) == 1 + CRC_BYTES
        && input.bytes().get(HEADER..length + CRC_BYTES).is_some_and(modlens_protocol::checksum::crc_valid)
}

/// What becomes of the length in a header.
enum Length {
    /// Nothing contradicts it.
    Believed,
    /// The frame ends here, whatever the header says.
    Lies(usize),
    /// More bytes are needed to tell.
    Undecided,
}

impl Tcp {
    /// Whether a frame ends where its header says; where another one stands earlier, it lies.
    fn told(input: &Input, context: &Context<'_>, length: usize) -> Length {
        let (bytes, functions) = (input.bytes(), context.functions);
        let natural = natural(functions, bytes);
        // Where the layout ends the frame earlier and the next one stands there, the header says too much.
        let there = bytes.len().min(length - 1);
        let inside = natural.into_iter().flatten().filter(|&end| end < there);
        if let Some(end) = inside.into_iter().find(|&end| stands(functions, &bytes[end..there]) == Some(true)) {
            return Length::Lies(end);
        }
        if bytes.len() < length || layout_fits(functions, &bytes[HEADER + 1..length]) {
            return Length::Believed;
        }
        let candidates = std::iter::once(length).chain(natural.into_iter().flatten()).chain(HEADER + 2..HEADER + LONGEST);
        for end in candidates {
            // A place that is not there yet is waited for: in which pieces bytes come must not matter.
            match bytes.get(end..).and_then(|behind| stands(functions, behind)) {
                Some(true) if end == length => return Length::Believed,
                Some(true) => return Length::Lies(end),
                None if !input.closed => return Length::Undecided,
                _ => {}
            }
        }
        Length::Believed
    }

    /// Whether a frame begins at `at`; `None` if more bytes are needed.
    fn begins(input: &Input, context: &Context<'_>, at: usize) -> Option<bool> {
        let bytes = &input.bytes()[at..];
        if bytes.len() < HEADER + 2 {
            return input.closed.then_some(false);
        }
        let Some(length) = announced(bytes) else { return Some(false) };
        // A record, or what follows missing bytes, may begin anywhere in a frame.
        let behind_edge = input.hard_edge(0);
        if at == 0 && (!behind_edge || whole_read(input, length)) {
            return Some(true);
        }
        // Behind bytes that were no frame, a header alone is weak evidence.
        match bytes.get(HEADER + 1..length) {
            Some(pdu) => Some(pdu[0] & !EXCEPTION_BIT != 0 && layout_fits(context.functions, pdu)),
            None => input.closed.then_some(false),
        }
    }

    fn frame(input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let bytes = input.bytes();
        let length = announced(bytes)?;
        adu.clear();
        let mbap_id = Some(u16::from_be_bytes([bytes[0], bytes[1]]));
        if let Some(edge) = input.edge_after(0, length - 1, Ns::MAX) {
            adu.extend_from_slice(bytes.get(HEADER..edge).unwrap_or(&[]));
            return Some(Cut { verdict: Verdict::Incomplete, mbap_id, ..Cut::noise(edge, CutBy::Record) });
        }
        // On a connection, a packet that ends with the frame bears the header out.
        let borne_out = context.certain.is_some() && whole_read(input, length);
        match if borne_out { Length::Believed } else { Self::told(input, context, length) } {
            Length::Believed => {}
            Length::Undecided => return None,
            Length::Lies(end) => {
                adu.extend_from_slice(&bytes[HEADER..end]);
                let fault = Some(FramingFault::MbapLength);
                return Some(Cut { verdict: Verdict::Incomplete, mbap_id, fault, ..Cut::noise(end, CutBy::Frame) });
            }
        }
        if bytes.len() < length {
            adu.extend_from_slice(&bytes[HEADER..]);
            let cut_by = if input.ended { CutBy::End } else { CutBy::Silence };
            return input.closed.then(|| Cut { verdict: Verdict::Incomplete, mbap_id, ..Cut::noise(bytes.len(), cut_by) });
        }
        adu.extend_from_slice(&bytes[HEADER..length]);
        let pdu = &adu[1..];
        let fits = layout_fits(context.functions, pdu);
        let judged = || judge(context.functions, context.asked, adu[0], pdu, context.said_at(input, 0), (context.pause)(None));
        let direction = context.certain.unwrap_or_else(judged);
        let left_in = checksum_behind(input, length);
        let fault = (!fits || left_in).then_some(FramingFault::MbapLength);
        let length = if left_in { length + CRC_BYTES } else { length };
        let confidence = if fits { VALID_FRAME_BITS } else { 16 };
        Some(Cut { verdict: Verdict::Ok, direction, confidence, mbap_id, fault, ..Cut::noise(length, CutBy::Length) })
    }
}

impl Framer for Tcp {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        loop {
            let waiting = input.bytes().len();
            let begins = if self.skip < waiting { Self::begins(input, context, self.skip) } else { None };
            match begins {
                Some(true) if self.skip == 0 => return Self::frame(input, context, adu),
                Some(false) if self.skip + 1 < NOISE_LIMIT => self.skip += 1,
                None if !(input.closed && self.skip > 0) => return None,
                found => {
                    let length = if found == Some(false) { self.skip + 1 } else { self.skip };
                    let cut_by = match found {
                        Some(true) => CutBy::Frame,
                        Some(false) => CutBy::Limit,
                        None if input.ended => CutBy::End,
                        None => CutBy::Silence,
                    };
                    self.skip = 0;
                    adu.clear();
                    return Some(Cut::noise(length, cut_by));
                }
            }
        }
    }

    fn mode(&self) -> Mode {
        Mode::Tcp
    }

    fn settled(&self, _offset: u64) -> bool {
        self.skip == 0
    }

    fn break_ns(&self, _line: Option<&LineSettings>) -> Ns {
        BREAK
    }
}
