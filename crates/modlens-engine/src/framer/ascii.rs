//! ASCII: colon, hex characters, LRC, CR LF (serial line specification, 2.5.2).

use memchr::{memchr, memchr3_iter};

use crate::damage::ascii;
use crate::damage::kind::DamageKind;
use crate::framer::{FrameResult, Framer, FramerContext, FramingFault, MAX_NOISE_ROW_BYTES};
use crate::input::Input;
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::infer_direction;
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::hex::{byte_at, decode_pairs};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// Length of the longest message in characters (2.5.2.2).
pub const MAX_MESSAGE_CHARACTERS: usize = 513;

/// The longest pause between two characters of a message (2.5.2.1).
const CHARACTER_TIMEOUT_NS: Ns = 1_000_000_000;

/// Confidence in bits of a valid frame: eight bits each for LRC, colon, CR and LF.
pub const VALID_FRAME_BITS: u8 = 32;

/// The framer of an ASCII line.
#[derive(Debug)]
pub struct AsciiFramer {
    /// The character accepted in place of the line feed; Diagnostics, sub-function 3, changes it (application protocol, 6.8).
    delimiter: u8,
}

impl Default for AsciiFramer {
    fn default() -> Self {
        Self { delimiter: b'\n' }
    }
}

/// Where the message behind a colon ends.
struct MessageEnd {
    /// Index behind the last character of the frame.
    frame_end: usize,
    /// Index behind the last hex character.
    hex_end: usize,
    /// The evidence that ended it.
    delimited_by: DelimitedBy,
    /// What is wrong with how it ended.
    fault: Option<FramingFault>,
}

impl AsciiFramer {
    /// Where the message that begins with the first byte, a colon, ends. Indices count from that colon. The first of these:
    ///
    /// - the next colon, which is no part of it (`Restart`);
    /// - LF without CR, a fault; CR with LF or with the delimiter that the line has set; or CR alone (`Delimiter` all three).
    ///   A CR that is the last byte so far does not end it yet, since LF may follow, unless the input is closed;
    /// - `MAX_MESSAGE_CHARACTERS` (`Limit`);
    /// - the start of a record or a silence of `CHARACTER_TIMEOUT_NS`: `Record` if `Input::is_boundary` holds there, which
    ///   goes by `input.break_ns`, else `Silence`;
    /// - the end of what has come, once the input is closed: `End` if the recording is over, else `Silence`.
    ///
    /// `None` if more bytes are needed to tell.
    fn message_end(&self, input: &Input) -> Option<MessageEnd> {
        let bytes = input.bytes();
        // The index of the first byte behind a silence or a loss, or of a record's first byte: no message reaches across it.
        let boundary = input.boundary_after(0, bytes.len().min(MAX_MESSAGE_CHARACTERS), CHARACTER_TIMEOUT_NS);
        let available = &bytes[..boundary.unwrap_or(bytes.len()).min(MAX_MESSAGE_CHARACTERS)];
        let end = |frame_end, hex_end, delimited_by, fault| Some(MessageEnd { frame_end, hex_end, delimited_by, fault });
        if let Some(at) = memchr3_iter(b':', b'\n', b'\r', available).find(|&at| at > 0) {
            match available[at] {
                b':' => return end(at, at, DelimitedBy::Restart, None),
                b'\n' => return end(at + 1, at, DelimitedBy::Delimiter, Some(FramingFault::BareLineFeed)),
                _ => match available.get(at + 1) {
                    Some(&next) if next == b'\n' || next == self.delimiter => {
                        return end(at + 2, at, DelimitedBy::Delimiter, None)
                    }
                    Some(_) => return end(at + 1, at, DelimitedBy::Delimiter, None),
                    None if available.len() < bytes.len() || input.is_closed => {
                        return end(at + 1, at, DelimitedBy::Delimiter, None)
                    }
                    None => return None,
                },
            }
        }
        let length = available.len();
        if length == MAX_MESSAGE_CHARACTERS {
            return end(length, length, DelimitedBy::Limit, None);
        }
        match boundary {
            Some(_) => {
                end(length, length, if input.is_boundary(length) { DelimitedBy::Record } else { DelimitedBy::Silence }, None)
            }
            None if input.is_ended => end(length, length, DelimitedBy::End, None),
            None if input.is_closed => end(length, length, DelimitedBy::Silence, None),
            None => None,
        }
    }

    /// The first row of bytes that do not begin with a colon: noise, or a message without its colon, which is `Incomplete`; of
    /// that, `adu` gets unit and PDU as far as they came. Looks at no more than `MAX_NOISE_ROW_BYTES`.
    ///
    /// A message without colon in front of the first colon is looked for first (`damage::ascii`); if it begins further on, the
    /// bytes in front of it are noise. Without one, all bytes are noise up to the first colon, or up to the first record's
    /// start or silence of `CHARACTER_TIMEOUT_NS` if that comes earlier (`Silence` for either), or up to the limit, or up to
    /// the end of what has come once the input is closed. `None` if more bytes are needed to tell.
    fn without_colon(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let bytes = input.bytes();
        let available = &bytes[..bytes.len().min(MAX_NOISE_ROW_BYTES)];
        match ascii::find_colonless(available, input.is_closed, context.known_units) {
            Some(message) if message.start > 0 => return Some(FrameResult::noise(message.start, DelimitedBy::Restart)),
            Some(message) => {
                let has_lrc = decode_hex(&available[message.hex_start..message.hex_end], adu) && message.is_complete;
                adu.truncate(adu.len() - usize::from(has_lrc));
                let direction = ascii::direction(context, adu);
                let result = FrameResult::noise(message.end, DelimitedBy::Delimiter);
                return Some(FrameResult { verdict: Verdict::Incomplete, direction, damage: message.damage, ..result });
            }
            None => {}
        }
        if let Some(boundary) = input.boundary_after(0, available.len(), CHARACTER_TIMEOUT_NS) {
            let colon = memchr(b':', &available[..boundary]);
            return Some(
                colon.map_or(FrameResult::noise(boundary, DelimitedBy::Silence), |at| {
                    FrameResult::noise(at, DelimitedBy::Restart)
                }),
            );
        }
        match memchr(b':', available) {
            Some(at) => Some(FrameResult::noise(at, DelimitedBy::Restart)),
            None if available.len() == MAX_NOISE_ROW_BYTES => Some(FrameResult::noise(MAX_NOISE_ROW_BYTES, DelimitedBy::Limit)),
            None if input.is_closed => {
                Some(FrameResult::noise(available.len(), if input.is_ended { DelimitedBy::End } else { DelimitedBy::Silence }))
            }
            None => None,
        }
    }

    /// The row of the message that begins with the first byte, a colon, and ends at `end`. `adu` gets unit and PDU; the last
    /// byte of an `Incomplete` message stays in it, although it may be the LRC.
    ///
    /// 1. No line end and no valid LRC: `Incomplete`. Bytes were lost only if just the end of the LRC and the line end are
    ///    missing; else the sender may have stopped.
    /// 2. An odd number of hex characters: `Incomplete`, with one lost or doubled.
    /// 3. One byte fewer than the message announces, and an invalid LRC: `Incomplete`, with two characters lost.
    /// 4. Everything else: `Ok` with a valid LRC, even without line end, and `BadChecksum` without one, or with characters that
    ///    are not hex.
    ///
    /// Where the recording prints no checksums, 1 to 3 do not apply: an even number of hex characters is `NoChecksum`, all
    /// else `BadChecksum`. A sound message with unit and function gets direction, confidence and faults from
    /// `complete_valid`, which may change the line's delimiter; the direction of any other is what unit and function tell.
    fn frame(&mut self, input: &Input, context: &FramerContext<'_>, end: &MessageEnd, adu: &mut Vec<u8>) -> FrameResult {
        let text = &input.bytes()[1..end.hex_end];
        let is_hex = decode_hex(text, adu);
        let mut result = FrameResult { verdict: Verdict::Incomplete, ..FrameResult::noise(end.frame_end, end.delimited_by) };
        result.fault = end.fault;
        let has_valid_lrc = is_hex && adu.len() > 2 && lrc(adu) == 0;
        let prints_no_checksum = input.read(0).is_some_and(|read| read.lacks_checksum);
        if !prints_no_checksum && end.delimited_by != DelimitedBy::Delimiter && !has_valid_lrc {
            result.direction = ascii::direction(context, adu);
            // A sender stops at any character. A tap that loses the line end and one character of the LRC leaves an odd
            // number of characters and exactly one byte missing.
            let is_odd = text.len() % 2 == 1 && text.iter().all(u8::is_ascii_hexdigit);
            let lost_end = is_odd && ascii::missing_bytes(context, adu) == Some(1);
            result.damage = lost_end.then_some(DamageKind::LostBytes { at: text.len() + 1, count: 3 });
            return result;
        }
        if let Some(damage) = ascii::explain_odd_digits(text).filter(|_| !prints_no_checksum) {
            let direction = ascii::direction(context, adu);
            return FrameResult { direction, damage: Some(damage), ..result };
        }
        result.verdict = match is_hex {
            true if prints_no_checksum => Verdict::NoChecksum,
            true if has_valid_lrc => Verdict::Ok,
            _ => Verdict::BadChecksum,
        };
        // One whole byte, two characters, is missing by the announced length: then the LRC is invalid for that reason.
        if result.verdict == Verdict::BadChecksum && is_hex && ascii::missing_bytes(context, adu) == Some(1) {
            let direction = ascii::direction(context, adu);
            let damage = Some(DamageKind::LostBytes { at: text.len() + 1, count: 2 });
            return FrameResult { verdict: Verdict::Incomplete, direction, damage, ..result };
        }
        if !prints_no_checksum {
            adu.pop();
        }
        if result.verdict.is_good() && adu.len() >= 2 {
            self.complete_valid(&mut result, input, context, text, adu);
        } else {
            result.direction = ascii::direction(context, adu);
        }
        result
    }

    /// Adds the direction, the confidence and the faults of a valid message, and adopts the delimiter that it sets.
    fn complete_valid(&mut self, result: &mut FrameResult, input: &Input, context: &FramerContext<'_>, text: &[u8], adu: &[u8]) {
        if text.iter().any(u8::is_ascii_lowercase) {
            result.fault = result.fault.or(Some(FramingFault::LowerCaseHex));
        }
        let pause = (context.timeout_log_odds)(input.pause_before(0));
        result.direction = infer_direction(
            context.functions,
            context.outstanding_request,
            adu[0],
            &adu[1..],
            context.declared_direction_at(input, 0),
            pause,
        );
        result.confidence = VALID_FRAME_BITS;
        // Diagnostics, sub-function 3: Change ASCII Input Delimiter.
        if let [_, 8, 0, 3, delimiter, ..] = *adu {
            self.delimiter = delimiter;
        }
    }
}

/// Decodes hex characters into `out`; false if there are other characters or an odd number. The leading bytes that could be
/// decoded stay in `out` either way.
fn decode_hex(text: &[u8], out: &mut Vec<u8>) -> bool {
    out.clear();
    if !decode_pairs(text, out) {
        out.extend((0..text.len() / 2).map_while(|at| byte_at(text, 2 * at)));
        return false;
    }
    text.len().is_multiple_of(2)
}

impl Framer for AsciiFramer {
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        adu.clear();
        match input.bytes().first()? {
            b':' => {
                let end = self.message_end(input)?;
                Some(self.frame(input, context, &end, adu))
            }
            _ => Self::without_colon(input, context, adu),
        }
    }

    fn mode(&self) -> Mode {
        Mode::Ascii
    }

    fn is_settled_at(&self, _offset: u64) -> bool {
        true
    }

    fn break_ns(&self, _line: Option<&LineSettings>) -> Ns {
        CHARACTER_TIMEOUT_NS
    }
}
