//! Parses what may be in front of plain bytes: a timestamp and a word that says who sent them, in either order.

use crate::chunk::Side;
use crate::text::direction_words::leading;
use crate::text::timestamps::TimestampParser;
use modlens_protocol::Ns;

/// Parses the prefix of a line: the timestamp, the sender, and the rest of the line. Either may be missing.
pub(super) fn parse_prefix<'a>(line: &'a [u8], timestamps: &mut TimestampParser) -> (Option<Ns>, Option<Side>, &'a [u8]) {
    // Most lines of plain hex begin with bytes: two digits and a space are no timestamp.
    if line.len() > 4 && line[0].is_ascii_hexdigit() && line[1].is_ascii_hexdigit() && line[2] == b' ' {
        return (None, None, line);
    }
    let (time, rest) = timestamps.take_leading(line);
    let rest = if rest.len() == line.len() && rest.starts_with(b":") { rest } else { skip_separators(rest) };
    let (side, rest) = direction_word(rest);
    // The timestamp may also follow the word.
    let (time, rest) = if time.is_none() && side.is_some() {
        match timestamps.take_leading(skip_separators(rest)) {
            (Some(late), behind) => (Some(late), behind),
            _ => (time, rest),
        }
    } else {
        (time, rest)
    };
    // A word and an arrow may both say who sent the bytes: `TX: .. << 01 03` and `Req >> : 01 03`. Some programs print an arrow
    // in front of each line: `12:30:05.250 -> RX: 01 03`.
    let behind = if side.is_some() { skip_separators(rest) } else { rest };
    let (second, bytes) = direction_word(behind);
    let is_word = second.is_some() && behind.iter().find(|b| **b != b'[').is_some_and(u8::is_ascii_alphabetic);
    let is_after_arrow = is_word && !line[..line.len() - rest.len()].last().is_some_and(u8::is_ascii_alphabetic);
    (time, if is_after_arrow { second } else { side }, bytes)
}

/// The line without leading separators. A colon that begins a frame of Modbus ASCII and the dashes of an arrow are kept.
fn skip_separators(line: &[u8]) -> &[u8] {
    let separator = |b: &u8| matches!(b, b' ' | b'\t' | b':' | b',' | b';' | b'-' | b'|' | b']' | b'*' | b'`' | b'=');
    let length = line.iter().take_while(|b| separator(b)).count();
    // A colon after a space and in front of a digit begins a frame of Modbus ASCII: `Tx :0503`.
    let colon = line[..length].ends_with(b" :") && line.get(length).is_some_and(u8::is_ascii_hexdigit);
    let length = length - usize::from(colon);
    // The dashes of an arrow are no separators.
    let dashes = line[..length].iter().rev().take_while(|b| **b == b'-').count();
    let length = if dashes > 0 && line.get(length) == Some(&b'>') { length - dashes } else { length };
    &line[length..]
}

/// Parses a word or an arrow that says who sent the bytes; returns the sender and the rest of the line.
fn direction_word(line: &[u8]) -> (Option<Side>, &[u8]) {
    let Some(&first) = line.first() else { return (None, line) };
    // In most lines bytes follow at once.
    if first.is_ascii_digit() {
        return (None, line);
    }
    let word = line.strip_prefix(b"[").unwrap_or(line);
    let Some((side, length)) = leading(word) else { return (None, line) };
    let rest = &word[length..];
    // The first character of `<01><03>` is no arrow: these are bytes.
    let are_bytes = word[..length] == *b"<" && rest.get(2) == Some(&b'>');
    if are_bytes {
        (None, line)
    } else {
        (Some(side), rest)
    }
}
