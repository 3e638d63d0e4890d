//! Modbus/TCP: frames by the MBAP header (messaging on TCP/IP, 3.1.3).

use crate::direction::{judge, readings};
use crate::finding::Finding;
use crate::framer::{Context, Cut, CutBy, Framer, Mode, Verdict, NOISE_LIMIT};
use crate::functions::Functions;
use crate::input::Input;
use crate::line::Line;
use crate::Ns;

/// Transaction, protocol, length; the unit counts in the length.
const HEADER: usize = 6;

/// A silence in a stream over TCP says nothing before it is this long.
const BREAK: Ns = 1_000_000_000;

/// The framer of one direction, or both, of a Modbus/TCP stream.
#[derive(Debug, Default)]
pub struct Tcp {
    /// So many bytes from the first on begin no frame.
    skip: usize,
}

/// The whole length that the header at the start of `bytes` announces, if it is one.
pub fn announced(bytes: &[u8]) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([*bytes.get(4)?, *bytes.get(5)?]));
    // Unit and function code at least; 253 bytes of PDU at most.
    (bytes[2..4] == [0, 0] && (2..=254).contains(&length)).then_some(HEADER + length)
}

/// Whether a PDU of this length can be one in either direction.
pub fn layout_fits(functions: &Functions, pdu: &[u8]) -> bool {
    let (request, response) = readings(functions, pdu);
    request || response
}

impl Tcp {
    /// Whether a frame begins at `at`; `None` if more bytes are needed.
    fn begins(input: &Input, context: &Context<'_>, at: usize) -> Option<bool> {
        let bytes = &input.bytes()[at..];
        if bytes.len() < HEADER + 2 {
            return input.closed.then_some(false);
        }
        let Some(length) = announced(bytes) else { return Some(false) };
        if at == 0 {
            return Some(true);
        }
        // Behind bytes that were no frame, a header alone is weak evidence.
        match bytes.get(HEADER + 1..length) {
            Some(pdu) => Some(layout_fits(context.functions, pdu)),
            None => input.closed.then_some(false),
        }
    }

    fn frame(input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let bytes = input.bytes();
        let length = announced(bytes)?;
        adu.clear();
        let mbap_id = Some(u16::from_be_bytes([bytes[0], bytes[1]]));
        if bytes.len() < length {
            adu.extend_from_slice(&bytes[HEADER..]);
            let cut_by = if input.ended { CutBy::End } else { CutBy::Silence };
            return input.closed.then(|| Cut { verdict: Verdict::Incomplete, mbap_id, ..Cut::noise(bytes.len(), cut_by) });
        }
        adu.extend_from_slice(&bytes[HEADER..length]);
        let pdu = &adu[1..];
        let fits = layout_fits(context.functions, pdu);
        let direction = judge(context.functions, context.asked, adu[0], pdu, context.said_at(input, 0), (context.pause)(None));
        let finding = (!fits).then_some(Finding::MbapLength);
        // The header's protocol and length agree with the PDU's own.
        let confidence = if fits { 40 } else { 16 };
        Some(Cut { verdict: Verdict::Ok, direction, confidence, mbap_id, finding, ..Cut::noise(length, CutBy::Length) })
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

    fn break_ns(&self, _line: Option<&Line>) -> Ns {
        BREAK
    }
}
