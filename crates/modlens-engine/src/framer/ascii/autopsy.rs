//! What happened to an ASCII frame that did not arrive whole.
//!
//! A message is a colon, an even number of hex characters and CR LF (serial line specification, 2.5.2): a line of hex
//! characters without its colon is one, too, if its LRC is right, and an odd number of them lacks some.

use memchr::{memchr, memchr2_iter};

use crate::framer::harm::Harm;
use crate::framer::Context;
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::{judge, Direction};
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::hex::solid;

/// Characters of unit, function code and LRC: no message has fewer.
const SHORTEST: usize = 6;

/// A message that lacks its colon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Headless {
    /// Its first character.
    pub start: usize,
    /// Its first hex character.
    pub text: usize,
    /// Behind its last hex character.
    pub text_end: usize,
    /// Behind its line end.
    pub end: usize,
    /// The hex characters are all there.
    pub whole: bool,
    /// What happened.
    pub harm: Option<Harm>,
}

/// Strays that a driver leaves in front of a message, at most.
const MOST_STRAYS: usize = 3;

/// The first message without colon before any colon; `over`: nothing comes behind these bytes; `known`: units heard.
pub(super) fn headless(bytes: &[u8], over: bool, known: &[bool; 256]) -> Option<Headless> {
    let before = &bytes[..memchr(b':', bytes).unwrap_or(bytes.len())];
    let mut from = 0;
    for at in memchr2_iter(b'\r', b'\n', before) {
        let line = from..at;
        from = at + 1;
        let feed = match (before[at], bytes.get(at + 1)) {
            (b'\r', Some(b'\n')) => 1,
            (b'\r', None) if !over => return None,
            _ => 0,
        };
        let run = line.len() - before[line.clone()].iter().rev().take_while(|byte| byte.is_ascii_hexdigit()).count();
        let (begin, text) = (line.start, line.start + run);
        if at - text < SHORTEST {
            continue;
        }
        let valid = |text: usize| (at - text).is_multiple_of(2) && right(&before[text..at]);
        let found = |start, text, whole, harm| Some(Headless { start, text, text_end: at, end: at + 1 + feed, whole, harm });
        // What stands in its place may be the colon, damaged; what differs more is a stray.
        let lost = text == begin || (before[text - 1] ^ b':').count_ones() > 1;
        if valid(text) {
            let harm = lost.then_some(Harm::Lost { at: 0, count: 1 });
            return found(if lost { text } else { text - 1 }, text, true, harm);
        }
        if valid(text + 1) {
            return found(text, text + 1, true, None);
        }
        // Right behind another message, the rest of one: of a unit that the LRC names, or half a byte less.
        let rest = lost && begin == 0 && text <= MOST_STRAYS && at - text > SHORTEST;
        if rest && ((at - text) % 2 == 1 || missing(&before[text..at]).is_some_and(|unit| known[usize::from(unit)])) {
            return found(text, text, false, Some(Harm::Lost { at: 0, count: 0 }));
        }
    }
    None
}

/// The byte that these characters lack for a right LRC.
fn missing(text: &[u8]) -> Option<u8> {
    let mut bytes = Vec::with_capacity(text.len() / 2);
    solid(text, &mut bytes).then(|| lrc(&bytes))
}

/// Whether the LRC of these characters is right.
fn right(text: &[u8]) -> bool {
    let mut bytes = Vec::with_capacity(text.len() / 2);
    solid(text, &mut bytes) && bytes.len() > 2 && lrc(&bytes) == 0
}

/// What is missing between colon and line end: half a byte of hex tells that a character is.
pub(super) fn lost(text: &[u8]) -> Option<Harm> {
    let hex = text.len() % 2 == 1 && text.iter().all(u8::is_ascii_hexdigit);
    if !hex || text.len() + 1 < SHORTEST {
        return None;
    }
    // One character twice? Zeros change no sum: there, it may as well be one of three.
    let mut fewer = text[1..].to_vec();
    for at in 1..text.len() {
        // Without the character at this place; of a run, it does not matter which.
        fewer[at - 1] = text[at - 1];
        let doubled = text[at] == text[at - 1] && (at < 2 || text[at] != text[at - 2]);
        if doubled && text[at] != b'0' && right(&fewer) {
            return Some(Harm::Doubled { at: at + 1 });
        }
    }
    Some(Harm::Lost { at: text.len() + 1, count: 0 })
}

/// Bytes that are missing from a message whose LRC is wrong, by what it announces of its length: `adu` has its LRC, if
/// it has a line end, and half a byte does not count.
pub(super) fn lacks(context: &Context<'_>, adu: &[u8]) -> Option<usize> {
    let &[_, code, ref rest @ ..] = adu else { return None };
    let row = context.functions.row(code & !EXCEPTION_BIT, rest).filter(|_| code & EXCEPTION_BIT == 0)?;
    let lengths = [&row.request, &row.response].map(|layout| match layout.extent(rest) {
        Extent::Exactly(body) => Some(body + 1),
        _ => None,
    });
    let less = |length: Option<usize>| length.and_then(|length| length.checked_sub(rest.len()));
    // As many as one of the two sides would send: then some of them are wrong.
    let [asks, tells] = lengths.map(less);
    (asks != Some(0) && tells != Some(0)).then(|| asks.into_iter().chain(tells).min()).flatten()
}

/// Who sent it, as far as unit and function tell.
pub(super) fn direction(context: &Context<'_>, adu: &[u8]) -> Direction {
    let &[unit, code, ..] = adu else { return Direction::Unknown };
    let asked = context.asked.is_some_and(|asked| asked.unit == unit && asked.pdu.first() == Some(&(code & !EXCEPTION_BIT)));
    if asked || code & EXCEPTION_BIT != 0 {
        return Direction::Response;
    }
    if !context.known_units[usize::from(unit)] || context.functions.name(code).is_none() {
        return Direction::Unknown;
    }
    judge(context.functions, context.asked, unit, &adu[1..], None, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Option<(usize, usize, Option<Harm>)> {
        let mut known = [false; 256];
        known[1] = true;
        headless(text.as_bytes(), false, &known).map(|found| (found.start, found.end, found.harm))
    }

    // 01 03 00 00 00 02 has the LRC FA (2.5.2.2: two's complement of the sum).
    #[test]
    fn a_line_without_colon_is_a_message_that_lost_it() {
        let lost = Some(Harm::Lost { at: 0, count: 1 });
        assert_eq!(found("010300000002FA\r\n:01"), Some((0, 16, lost)));
        assert_eq!(found("noise\r\n010300000002FA\r\n"), Some((7, 23, lost)));
        assert_eq!(found("010300000002FB\r\n"), None);
        assert_eq!(found("010300000002FA\r"), None, "the line feed may come");
        // The stray of a driver is no damaged colon: four of its bits differ.
        assert_eq!(found("\u{0}010300000002FA\r\n"), Some((1, 17, lost)));
    }

    #[test]
    fn a_line_without_colon_and_unit_is_the_rest_of_one_of_a_unit_that_was_heard() {
        let rest = Some(Harm::Lost { at: 0, count: 0 });
        assert_eq!(found("0300000002FA\r\n"), Some((0, 14, rest)));
        assert_eq!(found("\x7f0300000002FA\r\n"), Some((1, 15, rest)));
        assert_eq!(found("0300000002F9\r\n"), None, "unit 2 was not");
    }

    #[test]
    fn another_character_in_the_place_of_the_colon_is_part_of_the_message() {
        assert_eq!(found(";010300000002FA\r\n"), Some((0, 17, None)));
        assert_eq!(found("2010300000002FA\r\n"), Some((0, 17, None)));
    }

    #[test]
    fn half_a_byte_tells_of_a_loss() {
        assert_eq!(lost(b"01030000002FA"), Some(Harm::Lost { at: 14, count: 0 }));
        assert_eq!(lost(b"0103000000022FA"), Some(Harm::Doubled { at: 13 }));
        assert_eq!(lost(b"0103000011112D9"), Some(Harm::Doubled { at: 10 }), "one of a run");
        assert_eq!(lost(b"010300000002FA"), None);
        assert_eq!(lost(b"0103000x002FA"), None);
        let rest = Some(Harm::Lost { at: 0, count: 0 });
        assert_eq!(found("10300000002FA\r\n"), Some((0, 15, rest)));
    }
}
