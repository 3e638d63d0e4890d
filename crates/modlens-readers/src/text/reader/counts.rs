//! Numbers around the bytes of a line that a dialect of any program takes for bytes as well.

use crate::text::date::time_of_day;
use crate::text::frame_evidence;
use crate::text::proved::is_words;
use crate::text::template::LineMatch;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

/// The fewest bytes that a number in front of them may count.
const MIN_COUNTED: usize = 3;

/// Hours, minutes and seconds.
const TIME_NUMBERS: usize = 3;

/// Fewer bytes than these in a line of words are numbers.
const MIN_BYTES_IN_WORDS: usize = 4;

/// Whether what was found is a time of day, such as `10:00:05`, which is never bytes.
pub(super) fn are_time(line: &[u8], found: &LineMatch, bytes: &[u8]) -> bool {
    bytes.len() == TIME_NUMBERS
        && line.get(found.bytes_start..).is_some_and(|text| {
            let start = text.iter().take_while(|b| !b.is_ascii_alphanumeric()).count();
            time_of_day(&text[start..]).is_some_and(|(_, rest)| rest.first().is_none_or(|b| !b.is_ascii_hexdigit()))
        })
}

/// Whether the first of the bytes that were found in the line is a number which counts the others, as in `TX [8] 01 03 ..`, or
/// that of the line, as in `[3] 01 03 ..`: what separates it from them is not what separates those, and with it the bytes are no
/// frame.
pub(super) fn begins_with_count(line: &[u8], found: &LineMatch, bytes: &[u8]) -> bool {
    if bytes.len() <= MIN_COUNTED || frame_evidence::is_whole_frame(bytes) || found.bytes_end > line.len() {
        return false;
    }
    let text = &line[found.bytes_start..found.bytes_end];
    let Some(start) = text.iter().position(u8::is_ascii_alphanumeric) else { return false };
    let mut parts = text[start..].chunk_by(|one, other| one.is_ascii_alphanumeric() == other.is_ascii_alphanumeric());
    let (Some(count), Some(behind), _, Some(usual)) = (parts.next(), parts.next(), parts.next(), parts.next()) else {
        return false;
    };
    let is_count = std::str::from_utf8(count).ok().and_then(|text| text.parse().ok()) == Some(bytes.len() - 1);
    let is_in_bracket = line[..found.bytes_start + start].last().is_some_and(|b| matches!(b, b'[' | b'('));
    let closes = behind.first().is_some_and(|b| matches!(b, b']' | b')'));
    let is_alone = is_in_bracket && closes && !usual.iter().any(|b| matches!(b, b'[' | b'(' | b']' | b')'));
    let is_label = || is_alone && (count.len() == 1 || begins_frame(&bytes[1..]) && !begins_frame(bytes));
    behind != usual && (is_count || is_label())
}

/// Whether bytes are a frame, or begin with a unit and a function that the specification has.
fn begins_frame(bytes: &[u8]) -> bool {
    let is_known = |code: u8| Functions::embedded().name(code & !EXCEPTION_BIT).is_some();
    frame_evidence::is_whole_frame(bytes) || matches!(bytes, [1..=247, code, ..] if is_known(*code))
}

/// Whether so few bytes in a line of words are only numbers in it.
pub(super) fn are_numbers(line: &[u8], bytes: &[u8]) -> bool {
    bytes.len() < MIN_BYTES_IN_WORDS && is_words(line)
}
