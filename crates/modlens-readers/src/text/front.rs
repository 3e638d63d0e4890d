//! What stands in front of plain bytes: a time, a word that says who sent them, in either order.

use crate::chunk::Side;
use crate::text::stamp::Stamps;
use modlens_protocol::Ns;

/// Words that say who sent a line, relative to the logging process; the longest first where one begins another.
const WORDS: &[(&str, Side)] = &[
    ("transmitted", Side::Sent),
    ("received", Side::Received),
    ("response", Side::Received),
    ("request", Side::Sent),
    ("sending", Side::Sent),
    ("sent", Side::Sent),
    ("send", Side::Sent),
    ("recv", Side::Received),
    ("write", Side::Sent),
    ("read", Side::Received),
    ("tx", Side::Sent),
    ("rx", Side::Received),
    (">>>", Side::Sent),
    ("<<<", Side::Received),
    (">>", Side::Sent),
    ("<<", Side::Received),
    ("-->", Side::Sent),
    ("<--", Side::Received),
    ("->", Side::Sent),
    ("<-", Side::Received),
    (">", Side::Sent),
    ("<", Side::Received),
];

/// Time, side, and the rest of the line.
pub(super) fn take<'a>(line: &'a [u8], stamps: &mut Stamps) -> (Option<Ns>, Option<Side>, &'a [u8]) {
    // Bytes begin most lines of plain hex: two digits and no colon behind them are no time.
    if line.len() > 4 && line[0].is_ascii_hexdigit() && line[1].is_ascii_hexdigit() && line[2] == b' ' {
        return (None, None, line);
    }
    let (time, rest) = stamps.take(line);
    let rest = if rest.len() == line.len() && rest.starts_with(b":") { rest } else { separators(rest) };
    let (side, rest) = word(rest);
    // The stamp may stand behind the word, too.
    let (time, rest) = if time.is_none() && side.is_some() {
        match stamps.take(separators(rest)) {
            (Some(late), behind) => (Some(late), behind),
            _ => (time, rest),
        }
    } else {
        (time, rest)
    };
    // `TX: .. << 01 03` and `Req >> : 01 03`: a word and an arrow say the same thing twice.
    let rest = if side.is_some() { separators(rest) } else { rest };
    (time, side, word(rest).1)
}

fn separators(line: &[u8]) -> &[u8] {
    let separator = |b: &u8| matches!(b, b' ' | b'\t' | b':' | b',' | b';' | b'-' | b'|' | b']' | b'*' | b'`' | b'=');
    let length = line.iter().take_while(|b| separator(b)).count();
    // `Tx :0503`: a colon behind a blank and in front of a digit begins a frame of Modbus ASCII.
    let colon = line[..length].ends_with(b" :") && line.get(length).is_some_and(u8::is_ascii_hexdigit);
    let length = length - usize::from(colon);
    // The dashes of an arrow are no separators.
    let dashes = line[..length].iter().rev().take_while(|b| **b == b'-').count();
    let length = if dashes > 0 && line.get(length) == Some(&b'>') { length - dashes } else { length };
    &line[length..]
}

fn word(line: &[u8]) -> (Option<Side>, &[u8]) {
    let Some(&first) = line.first() else { return (None, line) };
    // Most lines go on with bytes.
    if first.is_ascii_digit() {
        return (None, line);
    }
    let line = line.strip_prefix(b"[").unwrap_or(line);
    let Some(begins) = line.first().map(u8::to_ascii_lowercase) else { return (None, line) };
    for (word, side) in WORDS.iter().filter(|(word, _)| word.as_bytes()[0] == begins) {
        let Some(start) = line.get(..word.len()) else { continue };
        let rest = &line[word.len()..];
        let ends = !rest.first().is_some_and(u8::is_ascii_alphanumeric) || !word.as_bytes()[0].is_ascii_alphabetic();
        if start.eq_ignore_ascii_case(word.as_bytes()) && ends {
            // `<01><03>` are bytes.
            let bytes = *word == "<" && rest.get(2) == Some(&b'>');
            return if bytes { (None, line) } else { (Some(*side), rest) };
        }
    }
    (None, line)
}
