//! ASCII: colon, hex characters, LRC, CR LF (serial line specification, 2.5.2).

use memchr::{memchr, memchr3_iter};

use crate::damage::ascii;
use crate::framer::{FrameResult, Framer, FramerContext, FramingFault, MAX_NOISE_ROW_BYTES};
use crate::input::Input;
use crate::rtu_model::damage_kind::DamageKind;
use crate::weights::LRC_CONFIDENCE_BITS;
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

/// Where the message after a colon ends.
struct MessageEnd {
    /// Index after the last character of the frame.
    frame_end: usize,
    /// Index after the last hex character.
    hex_end: usize,
    /// The evidence that ended it.
    delimited_by: DelimitedBy,
    /// What is wrong with how it ended.
    fault: Option<FramingFault>,
}

impl AsciiFramer {
    /// Where the message that begins with the first byte, a colon, ends. Indices count from that colon. `None` if more bytes
    /// are needed to tell.
    ///
    /// No message is longer than `MAX_MESSAGE_CHARACTERS`, and none reaches across the start of a record, a loss or a silence of
    /// `CHARACTER_TIMEOUT_NS` (the edge). In front of these, the first colon, CR or LF after the first byte ends it
    /// (`end_at_character`), else one of these themselves (`end_without_delimiter`).
    fn message_end(&self, input: &Input) -> Option<MessageEnd> {
        let bytes = input.bytes();
        let edge = input.boundary_after(0, bytes.len().min(MAX_MESSAGE_CHARACTERS), CHARACTER_TIMEOUT_NS);
        let available = &bytes[..edge.unwrap_or(bytes.len()).min(MAX_MESSAGE_CHARACTERS)];
        match memchr3_iter(b':', b'\n', b'\r', available).find(|&at| at > 0) {
            Some(at) => {
                let is_all = input.is_closed || available.len() < bytes.len();
                self.end_at_character(available, at, is_all)
            }
            None => end_without_delimiter(input, available.len(), edge.is_some()),
        }
    }

    /// Where a message ends by the colon, LF or CR at index `at` of its bytes; `is_all`: no more bytes can belong to it.
    ///
    /// - At a colon, which is no part of it (`Restart`).
    /// - After LF without CR, which is a fault.
    /// - After CR with LF, or CR with the delimiter that the line has set.
    /// - After CR alone, if another character follows or `is_all`. `None` if LF may still follow.
    fn end_at_character(&self, bytes: &[u8], at: usize, is_all: bool) -> Option<MessageEnd> {
        let end = |frame_end, delimited_by, fault| Some(MessageEnd { frame_end, hex_end: at, delimited_by, fault });
        match (bytes[at], bytes.get(at + 1)) {
            (b':', _) => end(at, DelimitedBy::Restart, None),
            (b'\n', _) => end(at + 1, DelimitedBy::Delimiter, Some(FramingFault::BareLineFeed)),
            (_, Some(&next)) if next == b'\n' || next == self.delimiter => end(at + 2, DelimitedBy::Delimiter, None),
            (_, None) if !is_all => None,
            _ => end(at + 1, DelimitedBy::Delimiter, None),
        }
    }

    /// The row of a message that begins with the first byte, which is not a colon: `Incomplete`; `adu` gets unit and PDU as far
    /// as they came. `length`: how many bytes are looked at. `None` if no message without colon (`damage::ascii`) is in
    /// front of the first colon. If one begins further on, the bytes in front of it, as noise.
    fn colonless_message(input: &Input, context: &FramerContext<'_>, length: usize, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let bytes = &input.bytes()[..length];
        let message = ascii::find_colonless(bytes, input.is_closed, context.known_units)?;
        if message.start > 0 {
            return Some(FrameResult::noise(message.start, DelimitedBy::Restart));
        }
        let has_lrc = decode_hex(&bytes[message.hex_start..message.hex_end], adu) && message.is_complete;
        adu.truncate(adu.len() - usize::from(has_lrc));
        let direction = ascii::direction(context, adu);
        let result = FrameResult::noise(message.end, DelimitedBy::Delimiter);
        Some(FrameResult { verdict: Verdict::Incomplete, direction, damage: message.damage, ..result })
    }

    /// The first row of bytes that do not begin with a colon: noise, or a message without its colon (`colonless_message`).
    /// `None` if more bytes are needed to tell. Looks at no more than `MAX_NOISE_ROW_BYTES`.
    ///
    /// Noise ends at the first of these: a colon (`Restart`); the start of a record or a silence of `CHARACTER_TIMEOUT_NS`
    /// (`Silence` for either); `MAX_NOISE_ROW_BYTES` (`Limit`); the end of what has come, once the input is closed.
    fn without_colon(input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let available = input.bytes().len().min(MAX_NOISE_ROW_BYTES);
        if let Some(row) = Self::colonless_message(input, context, available, adu) {
            return Some(row);
        }
        let edge = input.boundary_after(0, available, CHARACTER_TIMEOUT_NS);
        if let Some(at) = memchr(b':', &input.bytes()[..edge.unwrap_or(available)]) {
            return Some(FrameResult::noise(at, DelimitedBy::Restart));
        }
        match edge {
            Some(edge) => Some(FrameResult::noise(edge, DelimitedBy::Silence)),
            None if available == MAX_NOISE_ROW_BYTES => Some(FrameResult::noise(available, DelimitedBy::Limit)),
            None => end_of_closed_input(input).map(|delimited_by| FrameResult::noise(available, delimited_by)),
        }
    }

    /// The row of the message that begins with the first byte, a colon, and ends at `end`. `adu` gets unit and PDU; the last
    /// byte of an `Incomplete` message stays in it, although it may be the LRC.
    ///
    /// A colon with hardly a hex character after it is noise (`is_noise_behind_colon`).
    ///
    /// A message that is damaged by its number of characters is `Incomplete` (`completeness`; not where the recording
    /// prints no checksums). Of the others, one with an even number of hex characters and nothing else is `Ok` if its LRC is
    /// valid, even without line end, and `NoChecksum` where the recording prints none; all else is `BadChecksum`.
    ///
    /// A good message with unit and function gets direction, confidence and faults from `complete_valid`; the direction of
    /// any other is what unit and function tell.
    fn frame(&mut self, input: &Input, context: &FramerContext<'_>, end: &MessageEnd, adu: &mut Vec<u8>) -> FrameResult {
        let text = &input.bytes()[1..end.hex_end];
        let is_hex = decode_hex(text, adu);
        let has_valid_lrc = is_hex && adu.len() > 2 && lrc(adu) == 0;
        let prints_no_checksum = input.read(0).is_some_and(|read| read.lacks_checksum);
        let mut result = FrameResult { fault: end.fault, ..FrameResult::noise(end.frame_end, end.delimited_by) };
        if ascii::is_noise_behind_colon(text) {
            adu.clear();
            return result;
        }
        if !prints_no_checksum {
            if let Completeness::Incomplete(damage) = completeness(context, end, text, adu, has_valid_lrc) {
                let direction = ascii::direction(context, adu);
                return FrameResult { verdict: Verdict::Incomplete, direction, damage, ..result };
            }
            adu.pop();
        }
        result.verdict = whole_verdict(is_hex, prints_no_checksum, has_valid_lrc);
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
        result.confidence = LRC_CONFIDENCE_BITS;
        // Diagnostics, sub-function 3: Change ASCII Input Delimiter.
        if let [_, 8, 0, 3, delimiter, ..] = *adu {
            self.delimiter = delimiter;
        }
    }
}

/// The verdict on a message that has all of its characters. `is_hex`: they are an even number of hex digits and nothing else.
fn whole_verdict(is_hex: bool, prints_no_checksum: bool, has_valid_lrc: bool) -> Verdict {
    match is_hex {
        true if prints_no_checksum => Verdict::NoChecksum,
        true if has_valid_lrc => Verdict::Ok,
        _ => Verdict::BadChecksum,
    }
}

/// Where a message ends without colon, CR or LF, whose `length` bytes are all up to its edge, up to `MAX_MESSAGE_CHARACTERS`,
/// or, with neither, all that have come. The first of these:
///
/// - `MAX_MESSAGE_CHARACTERS` (`Limit`);
/// - the edge, if it has one (`has_edge`): `Record` if `Input::is_boundary` holds there, which goes by `input.break_ns`, else
///   `Silence`;
/// - the end of what has come, once the input is closed.
///
/// `None` if more bytes are needed to tell.
fn end_without_delimiter(input: &Input, length: usize, has_edge: bool) -> Option<MessageEnd> {
    let delimited_by = if length == MAX_MESSAGE_CHARACTERS {
        DelimitedBy::Limit
    } else if has_edge && input.is_boundary(length) {
        DelimitedBy::Record
    } else if has_edge {
        DelimitedBy::Silence
    } else {
        end_of_closed_input(input)?
    };
    Some(MessageEnd { frame_end: length, hex_end: length, delimited_by, fault: None })
}

/// What the last of all bytes are delimited by: `End` if the recording is over, `Silence` if the line has been silent for so
/// long that the input is closed; `None` if more bytes may follow.
fn end_of_closed_input(input: &Input) -> Option<DelimitedBy> {
    match (input.is_ended, input.is_closed) {
        (true, _) => Some(DelimitedBy::End),
        (_, true) => Some(DelimitedBy::Silence),
        _ => None,
    }
}

/// Whether a message came with all of its characters.
enum Completeness {
    /// It did, as far as their number shows.
    Complete,
    /// It did not; with what happened to it, if that is known.
    Incomplete(Option<DamageKind>),
}

/// Whether a message came with all of its characters. `text` has those between colon and `end`, `adu` the bytes that they
/// stand for, as far as they could be decoded.
///
/// 1. No line end and no valid LRC: incomplete. A sender stops at any character; but an odd number of hex characters with
///    exactly one byte missing is a message whose line end and last character of the LRC the tap has lost, three in all.
/// 2. An odd number of hex characters: incomplete; one is lost or doubled (`explain_odd_digits`).
/// 3. An invalid LRC, an even number of hex characters, and one byte fewer than announced: incomplete; two are lost.
/// 4. All other messages are complete.
fn completeness(context: &FramerContext<'_>, end: &MessageEnd, text: &[u8], adu: &[u8], has_valid_lrc: bool) -> Completeness {
    let lost = |count| Some(DamageKind::LostBytes { at: text.len() + 1, count });
    let is_odd = text.len() % 2 == 1;
    let lacks_one_byte = || text.iter().all(u8::is_ascii_hexdigit) && ascii::missing_bytes(context, adu) == Some(1);
    if end.delimited_by != DelimitedBy::Delimiter && !has_valid_lrc {
        return Completeness::Incomplete(if is_odd && lacks_one_byte() { lost(3) } else { None });
    }
    match ascii::explain_odd_digits(text) {
        Some(damage) => Completeness::Incomplete(Some(damage)),
        None if !has_valid_lrc && !is_odd && lacks_one_byte() => Completeness::Incomplete(lost(2)),
        None => Completeness::Complete,
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
            // Some devices begin their answers with another sign.
            b'>' => {
                let end = self.message_end(input)?;
                let result = self.frame(input, context, &end, adu);
                if result.verdict == Verdict::Ok {
                    return Some(result);
                }
                adu.clear();
                Self::without_colon(input, context, adu)
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
