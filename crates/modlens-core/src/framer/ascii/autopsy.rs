//! What happened to an ASCII frame that did not arrive whole.
//!
//! A message is a colon, an even number of hex characters and CR LF (serial line specification, 2.5.2): a line of hex
//! characters without its colon is one, too, if its LRC is right, and an odd number of them lacks some.

use memchr::{memchr, memchr2_iter};

use crate::checksum::lrc;
use crate::direction::{judge, Direction};
use crate::framer::harm::Harm;
use crate::framer::Context;
use crate::functions::EXCEPTION_BIT;
use crate::hex::solid;

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

/// The first message without colon before any colon; `over`: nothing comes behind these bytes.
pub(super) fn headless(bytes: &[u8], over: bool) -> Option<Headless> {
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
        if valid(text) {
            // What stands in its place may be the colon, damaged.
            let lost = text == begin;
            let harm = lost.then_some(Harm::Lost { at: 0, count: 1 });
            return found(if lost { text } else { text - 1 }, text, true, harm);
        }
        if valid(text + 1) {
            return found(text, text + 1, true, None);
        }
        // Right behind another message, the rest of one.
        if text == begin && begin == 0 && (at - text) % 2 == 1 && at - text > SHORTEST {
            return found(text, text, false, Some(Harm::Lost { at: 0, count: 0 }));
        }
    }
    None
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
        headless(text.as_bytes(), false).map(|found| (found.start, found.end, found.harm))
    }

    // 01 03 00 00 00 02 has the LRC FA (2.5.2.2: two's complement of the sum).
    #[test]
    fn a_line_without_colon_is_a_message_that_lost_it() {
        let lost = Some(Harm::Lost { at: 0, count: 1 });
        assert_eq!(found("010300000002FA\r\n:01"), Some((0, 16, lost)));
        assert_eq!(found("noise\r\n010300000002FA\r\n"), Some((7, 23, lost)));
        assert_eq!(found("010300000002FB\r\n"), None);
        assert_eq!(found("010300000002FA\r"), None, "the line feed may come");
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
