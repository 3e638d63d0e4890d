//! What happened to an ASCII message that did not arrive whole.
//!
//! A message is a colon, an even number of hex characters and CR LF (serial line specification, 2.5.2). A line of hex
//! characters without a colon is a message that lost its colon if its LRC is valid, and a message with an odd number of
//! hex characters has lost at least one of them. Example: `010300000002FA` CR LF has a valid LRC and no colon.

use memchr::{memchr, memchr2_iter};

use crate::frame_result::FramerContext;
use crate::rtu_model::damage_kind::DamageKind;
use crate::weights::{MAX_COLON_FLIPS, MAX_GLITCH_BYTES};
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::{infer_direction, Direction};
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::hex::decode_pairs;

/// Hex characters of unit, function code and LRC: no message has fewer.
const MIN_HEX_CHARACTERS: usize = 6;

/// A message without a colon. Indices count from the first byte that was searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ColonlessMessage {
    /// Index of its first character.
    pub start: usize,
    /// Index of its first hex character.
    pub hex_start: usize,
    /// Index after its last hex character.
    pub hex_end: usize,
    /// Index after its line end.
    pub end: usize,
    /// All of its hex characters are there.
    pub is_complete: bool,
    /// What happened to it.
    pub damage: Option<DamageKind>,
}

/// Whether these characters after a colon are noise, and so is the colon: fewer than `MIN_HEX_CHARACTERS`, of which the first
/// is no hex character, or none at all.
pub(crate) fn is_noise_behind_colon(text: &[u8]) -> bool {
    text.len() < MIN_HEX_CHARACTERS && !text.first().is_some_and(u8::is_ascii_hexdigit)
}

/// The first message without a colon in front of the first colon.
///
/// `is_final`: no more bytes will follow. `known_units`: the units that took part in a valid frame.
pub(crate) fn find_colonless(bytes: &[u8], is_final: bool, known_units: &[bool; 256]) -> Option<ColonlessMessage> {
    let before_colon = &bytes[..memchr(b':', bytes).unwrap_or(bytes.len())];
    let mut line_start = 0;
    for line_end in memchr2_iter(b'\r', b'\n', before_colon) {
        let line = line_start..line_end;
        line_start = line_end + 1;
        let feed = match (before_colon[line_end], bytes.get(line_end + 1)) {
            (b'\r', Some(b'\n')) => 1,
            (b'\r', None) if !is_final => return None,
            _ => 0,
        };
        let found = colonless_in_line(before_colon, line.start, line_end, known_units);
        if let Some(message) = found {
            return Some(ColonlessMessage { end: line_end + 1 + feed, ..message });
        }
    }
    None
}

/// The message without a colon that ends with the line from `line_start` to `line_end`, which is the index of its CR or LF.
/// `bytes` has no colon and begins with the first unframed character. The result's `end` is `line_end`; the caller adds the
/// line end.
///
/// Only the hex characters right in front of the line end count; `None` if they are fewer than six. They are a whole message
/// (`whole_message`), else the rest of one (`rest_of_message`), else none.
fn colonless_in_line(bytes: &[u8], line_start: usize, line_end: usize, known_units: &[bool; 256]) -> Option<ColonlessMessage> {
    let line = &bytes[line_start..line_end];
    let hex_start = line_end - line.iter().rev().take_while(|byte| byte.is_ascii_hexdigit()).count();
    if line_end - hex_start < MIN_HEX_CHARACTERS {
        return None;
    }
    let text = &bytes[..line_end];
    whole_message(text, line_start, hex_start).or_else(|| rest_of_message(text, line_start, hex_start, known_units))
}

/// The message without a colon whose hex characters are all there, because their LRC is valid. They reach from `hex_start` to
/// the end of `text`, which is that of the line that starts at `line_start`.
///
/// 1. All of them have a valid LRC. A character in front that may be the damaged colon belongs to the message, and nothing is
///    lost (`damage` is `None`); else the colon is lost, and what is in front is no part of the message.
/// 2. They have a valid LRC without the first one: that one is the damaged colon.
fn whole_message(text: &[u8], line_start: usize, hex_start: usize) -> Option<ColonlessMessage> {
    let is_valid = |start: usize| (text.len() - start).is_multiple_of(2) && has_valid_lrc(&text[start..]);
    let (start, first_digit, damage) = if is_valid(hex_start) {
        if follows_damaged_colon(text, line_start, hex_start) {
            (hex_start - 1, hex_start, None)
        } else {
            (hex_start, hex_start, Some(DamageKind::LostBytes { at: 0, count: 1 }))
        }
    } else if is_valid(hex_start + 1) {
        (hex_start, hex_start + 1, None)
    } else {
        return None;
    };
    Some(ColonlessMessage { start, hex_start: first_digit, hex_end: text.len(), end: text.len(), is_complete: true, damage })
}

/// The rest of a message that has lost more than its colon: an unknown number of characters in front. Its hex characters
/// reach from `hex_start` to the end of `text`; their LRC is invalid.
///
/// Right after another message only: in the first line (`line_start` is 0), with at most three stray characters in front, none
/// of them a damaged colon right in front. It needs more than six hex characters, and one of two signs of a loss: their number
/// is odd, or one byte with the number of a known unit would make the LRC valid.
fn rest_of_message(text: &[u8], line_start: usize, hex_start: usize, known_units: &[bool; 256]) -> Option<ColonlessMessage> {
    let digits = &text[hex_start..];
    let may_be_rest = line_start == 0
        && hex_start <= MAX_GLITCH_BYTES
        && digits.len() > MIN_HEX_CHARACTERS
        && !follows_damaged_colon(text, line_start, hex_start);
    let lacks_known_unit = || missing_byte(digits).is_some_and(|unit| known_units[usize::from(unit)]);
    let damage = Some(DamageKind::LostBytes { at: 0, count: 0 });
    (may_be_rest && (digits.len() % 2 == 1 || lacks_known_unit())).then_some(ColonlessMessage {
        start: hex_start,
        hex_start,
        hex_end: text.len(),
        end: text.len(),
        is_complete: false,
        damage,
    })
}

/// Whether the character in front of `hex_start`, in the same line, may be the colon with a flipped bit; one that differs in
/// more bits is a stray byte.
fn follows_damaged_colon(text: &[u8], line_start: usize, hex_start: usize) -> bool {
    hex_start > line_start && (text[hex_start - 1] ^ b':').count_ones() <= MAX_COLON_FLIPS
}

/// The one byte that would make the LRC of these characters valid, wherever it stands: the LRC is a sum.
fn missing_byte(text: &[u8]) -> Option<u8> {
    let mut bytes = Vec::with_capacity(text.len() / 2);
    decode_pairs(text, &mut bytes).then(|| lrc(&bytes))
}

/// Whether these characters are the bytes of a message with a valid LRC.
fn has_valid_lrc(text: &[u8]) -> bool {
    let mut bytes = Vec::with_capacity(text.len() / 2);
    decode_pairs(text, &mut bytes) && bytes.len() > 2 && lrc(&bytes) == 0
}

/// What happened to a message with an odd number of hex characters between colon and line end: one of them was received
/// twice, or an unknown number is missing. `None` for an even number.
pub(crate) fn explain_odd_digits(text: &[u8]) -> Option<DamageKind> {
    let is_odd = text.len() % 2 == 1 && text.iter().all(u8::is_ascii_hexdigit);
    if !is_odd || text.len() + 1 < MIN_HEX_CHARACTERS {
        return None;
    }
    // Tries each character that repeats the one before it. Zeros do not change the sum, so that the LRC cannot tell whether
    // one zero is there twice; and in a run, only the first repetition is tried because the result is the same for all.
    let mut shortened = text[1..].to_vec();
    for at in 1..text.len() {
        // All characters but the one at this index.
        shortened[at - 1] = text[at - 1];
        let is_repetition = text[at] == text[at - 1] && (at < 2 || text[at] != text[at - 2]);
        if is_repetition && text[at] != b'0' && has_valid_lrc(&shortened) {
            return Some(DamageKind::DoubledByte { at: at + 1 });
        }
    }
    Some(DamageKind::LostBytes { at: text.len() + 1, count: 0 })
}

/// Number of bytes that a message with an invalid LRC lacks by the length that it announces, or `None` if it lacks none or
/// announces no length.
///
/// `adu` has the LRC of the message, if it has a line end. A byte of which only one character came does not count as there.
pub(crate) fn missing_bytes(context: &FramerContext<'_>, adu: &[u8]) -> Option<usize> {
    let &[_, code, ref rest @ ..] = adu else { return None };
    let row = context.functions.row(code & !EXCEPTION_BIT, rest).filter(|_| code & EXCEPTION_BIT == 0)?;
    let lengths = [&row.request, &row.response].map(|layout| match layout.extent(rest) {
        Extent::Exactly(body) => Some(body + 1),
        _ => None,
    });
    let shortfall = |length: Option<usize>| length.and_then(|length| length.checked_sub(rest.len()));
    let [of_request, of_response] = lengths.map(shortfall);
    // With as many bytes as one of the two directions has, some bytes are wrong and none is missing.
    let is_complete = of_request == Some(0) || of_response == Some(0);
    (!is_complete).then(|| of_request.into_iter().chain(of_response).min()).flatten()
}

/// Who sent a damaged message, as far as its unit and function tell.
pub(crate) fn direction(context: &FramerContext<'_>, adu: &[u8]) -> Direction {
    let &[unit, code, ..] = adu else { return Direction::Unknown };
    let function = code & !EXCEPTION_BIT;
    let is_due =
        context.outstanding_request.is_some_and(|request| request.unit == unit && request.pdu.first() == Some(&function));
    if is_due || code & EXCEPTION_BIT != 0 {
        return Direction::Response;
    }
    if !context.known_units[usize::from(unit)] || context.functions.name(code).is_none() {
        return Direction::Unknown;
    }
    infer_direction(context.functions, context.outstanding_request, unit, &adu[1..], None, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Start, end and damage of the message without colon in a text that may go on, with unit 1 known.
    fn found(text: &str) -> Option<(usize, usize, Option<DamageKind>)> {
        let mut known_units = [false; 256];
        known_units[1] = true;
        find_colonless(text.as_bytes(), false, &known_units).map(|message| (message.start, message.end, message.damage))
    }

    // 01 03 00 00 00 02 has the LRC FA, the two's complement of the sum (2.5.2.2).
    #[test]
    fn a_line_without_colon_is_a_message_that_lost_it() {
        let lost = Some(DamageKind::LostBytes { at: 0, count: 1 });
        assert_eq!(found("010300000002FA\r\n:01"), Some((0, 16, lost)));
        assert_eq!(found("noise\r\n010300000002FA\r\n"), Some((7, 23, lost)));
        assert_eq!(found("010300000002FB\r\n"), None);
        assert_eq!(found("010300000002FA\r"), None, "the line feed may follow");
        // The stray byte of a line driver is no damaged colon, because four of its bits differ.
        assert_eq!(found("\u{0}010300000002FA\r\n"), Some((1, 17, lost)));
    }

    #[test]
    fn a_line_without_colon_and_unit_is_the_rest_of_a_message_of_a_known_unit() {
        let rest = Some(DamageKind::LostBytes { at: 0, count: 0 });
        assert_eq!(found("0300000002FA\r\n"), Some((0, 14, rest)));
        assert_eq!(found("\x7f0300000002FA\r\n"), Some((1, 15, rest)));
        assert_eq!(found("0300000002F9\r\n"), None, "unit 2 is not known");
    }

    #[test]
    fn another_character_in_the_place_of_the_colon_is_part_of_the_message() {
        assert_eq!(found(";010300000002FA\r\n"), Some((0, 17, None)));
        assert_eq!(found("2010300000002FA\r\n"), Some((0, 17, None)));
    }

    #[test]
    fn an_odd_number_of_hex_characters_shows_a_loss_or_a_doubled_character() {
        assert_eq!(explain_odd_digits(b"01030000002FA"), Some(DamageKind::LostBytes { at: 14, count: 0 }));
        assert_eq!(explain_odd_digits(b"0103000000022FA"), Some(DamageKind::DoubledByte { at: 13 }));
        assert_eq!(explain_odd_digits(b"0103000011112D9"), Some(DamageKind::DoubledByte { at: 10 }), "one character of a run");
        assert_eq!(explain_odd_digits(b"010300000002FA"), None);
        assert_eq!(explain_odd_digits(b"0103000x002FA"), None);
        let rest = Some(DamageKind::LostBytes { at: 0, count: 0 });
        assert_eq!(found("10300000002FA\r\n"), Some((0, 15, rest)));
    }
}
