//! Hex bytes in a line, maybe behind a time and a word of direction.

use crate::chunk::Side;
use crate::text::stamp::Stamps;
use crate::text::{Line, Record};

/// Words that say who sent a line, relative to the logging process; the longest first where one begins another.
const WORDS: &[(&str, Side)] = &[
    ("transmitted", Side::Sent),
    ("received", Side::Received),
    ("sending", Side::Sent),
    ("sent", Side::Sent),
    ("send", Side::Sent),
    ("recv", Side::Received),
    ("tx", Side::Sent),
    ("rx", Side::Received),
    (">>>", Side::Sent),
    ("<<<", Side::Received),
    (">>", Side::Sent),
    ("<<", Side::Received),
    ("->", Side::Sent),
    ("<-", Side::Received),
    (">", Side::Sent),
    ("<", Side::Received),
];

/// Parses a line; its bytes go to `out`.
pub fn parse(line: &[u8], stamps: &mut Stamps, out: &mut Vec<u8>) -> Line {
    let line = line.trim_ascii();
    if line.starts_with(b"#") || line.starts_with(b"//") || line.starts_with(b";") {
        return Line::Nothing;
    }
    let (time, rest) = stamps.take(line);
    let rest = separators(rest);
    let (side, rest) = word(rest);
    // The stamp may stand behind the word, too.
    let (time, rest) = if time.is_none() && side.is_some() { stamps.take(separators(rest)) } else { (time, rest) };
    if bytes(rest, out) {
        Line::Bytes(Record { time, side, ..Record::default() })
    } else {
        out.clear();
        Line::Unparsed
    }
}

fn separators(line: &[u8]) -> &[u8] {
    let length = line.iter().take_while(|b| matches!(b, b' ' | b'\t' | b':' | b',' | b';' | b'-' | b'|' | b']')).count();
    // The dash of an arrow is no separator.
    let length = if length > 0 && line[length - 1] == b'-' && line.get(length) == Some(&b'>') { length - 1 } else { length };
    &line[length..]
}

fn word(line: &[u8]) -> (Option<Side>, &[u8]) {
    let line = line.strip_prefix(b"[").unwrap_or(line);
    for (word, side) in WORDS {
        let Some(start) = line.get(..word.len()) else { continue };
        let rest = &line[word.len()..];
        let ends = !rest.first().is_some_and(u8::is_ascii_alphanumeric) || !word.as_bytes()[0].is_ascii_alphabetic();
        if start.eq_ignore_ascii_case(word.as_bytes()) && ends {
            return (Some(*side), rest);
        }
    }
    (None, line)
}

/// The bytes of hex text in any usual spelling; false if there is anything else.
pub fn bytes(text: &[u8], out: &mut Vec<u8>) -> bool {
    let separator = |b: &u8| {
        matches!(b, b' ' | b'\t' | b':' | b',' | b'-' | b';' | b'|' | b'[' | b']' | b'{' | b'}' | b'(' | b')' | b'<' | b'>')
    };
    let before = out.len();
    let mut token_count = 0;
    for token in text.split(separator).filter(|token| !token.is_empty()) {
        token_count += 1;
        let prefixed = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X"));
        let digits = prefixed.unwrap_or(token);
        let good = match digits.len() {
            1 => prefixed.is_some(),
            length => length % 2 == 0,
        };
        if !good || !push(digits, out) {
            return false;
        }
    }
    // A single short token may be a number or a word ("add", "bed"): four bytes are a frame at least.
    out.len() > before && (token_count > 1 || out.len() - before >= 4)
}

fn push(digits: &[u8], out: &mut Vec<u8>) -> bool {
    let value = |b: u8| (b as char).to_digit(16).map(|d| d as u8);
    if let [single] = digits {
        return value(*single).map(|d| out.push(d)).is_some();
    }
    digits.chunks_exact(2).all(|pair| match (value(pair[0]), value(pair[1])) {
        (Some(high), Some(low)) => {
            out.push(high << 4 | low);
            true
        }
        _ => false,
    })
}
