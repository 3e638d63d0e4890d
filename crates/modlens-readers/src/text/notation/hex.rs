//! Pairs of hex digits in the dresses of many programs.

use crate::text::notation::{word, Marks, BLOCK};
use modlens_protocol::hex::{digit, pair, solid, BAD, DIGITS, HIGH, LOW, NO};

const SEPARATORS: [bool; 256] = separators();

/// What a separator is worth: nothing.
static BETWEEN: [u16; 256] = between();

/// Most bytes on a line of a dump.
const DUMP_LINE: usize = 16;

const fn separators() -> [bool; 256] {
    let mut table = [false; 256];
    let all = b" \t,:-.;|*_`[]{}<>'\"";
    let mut i = 0;
    while i < all.len() {
        table[all[i] as usize] = true;
        i += 1;
    }
    table
}

const fn between() -> [u16; 256] {
    let mut table = [NO; 256];
    let mut i = 0;
    while i < 256 {
        if SEPARATORS[i] {
            table[i] = 0;
        }
        i += 1;
    }
    table
}

/// Words that stand where a program, or a manual, does not print the checksum.
const PLACEHOLDERS: &[&[u8]] =
    &[b"xx", b"??", b"crc", b"crc16", b"lrc", b"crclo", b"crchi", b"crcl", b"crch", b"lo", b"hi", b"low", b"high", b"ll", b"hh"];

/// Pairs with one separator behind each, as long as they go on so; gives the length of text.
fn spaced(text: &[u8], out: &mut Vec<u8>) -> usize {
    let mut blocks = text.chunks_exact(3 * BLOCK);
    let (mut bytes, mut count) = ([0u8; BLOCK], 0);
    for block in &mut blocks {
        let mut bad = 0;
        for (byte, three) in bytes.iter_mut().zip(block.chunks_exact(3)) {
            let value = HIGH[three[0] as usize] | LOW[three[1] as usize];
            bad |= value | BETWEEN[three[2] as usize];
            *byte = value as u8;
        }
        if bad & NO != 0 {
            break;
        }
        out.extend_from_slice(&bytes);
        count += BLOCK;
    }
    for three in text[3 * count..].chunks_exact(3) {
        let value = HIGH[three[0] as usize] | LOW[three[1] as usize];
        if (value | BETWEEN[three[2] as usize]) & NO != 0 {
            break;
        }
        out.push(value as u8);
        count += 1;
    }
    // The last of a line has nothing behind it.
    if let (2, Some(value)) = (text.len() - 3 * count, pair(text, 3 * count)) {
        out.push(value);
        return text.len();
    }
    3 * count
}

/// A byte with blanks behind it, or nothing: where it ends, and where they do. Digits may stand alone if `loose`.
fn spread(text: &[u8], loose: bool, out: &mut Vec<u8>) -> Option<(usize, usize)> {
    let (value, length) = match pair(text, 0) {
        Some(value) => (value, 2),
        None if loose => (Some(digit(text, 0)).filter(|&value| value != BAD)?, 1),
        None => return None,
    };
    let blanks = text[length..].iter().take_while(|&&b| b == b' ').count();
    if blanks == 0 && text.len() > length {
        return None;
    }
    out.push(value);
    Some((length, length + blanks))
}

/// Digits of an offset of 64 bits.
const LONGEST_OFFSET: usize = 16;

/// Whether this is the line of a dump, offset first: `0010  05 03 ..`. No offset is read as bytes.
fn begins_with_offset(text: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    let (prefixed, text) = text.strip_prefix(b"0x").map_or((false, text), |rest| (true, rest));
    // Nearly all text has a pair first.
    if text.get(2).is_none_or(|&b| DIGITS[b as usize] == BAD) {
        return false;
    }
    let offset = word(&text[..text.len().min(LONGEST_OFFSET + 1)], 0);
    if offset.len() > LONGEST_OFFSET {
        return false;
    }
    let behind = &text[offset.len()..];
    let bytes = behind.trim_ascii_start();
    let pairs = behind.starts_with(b" ") && pair(bytes, 0).is_some() && bytes.get(2).is_none_or(|&b| b == b' ');
    (4..=8).contains(&offset.len())
        && offset.ends_with(b"0")
        && offset.iter().all(|&b| DIGITS[b as usize] != BAD)
        && ((pairs && !prefixed) || behind.starts_with(b": "))
}

pub(super) fn hex(text: &[u8], loose: bool, out: &mut Vec<u8>, marks: &mut Marks) -> usize {
    if begins_with_offset(text) {
        return 0;
    }
    let (mut at, mut end) = (0, 0);
    loop {
        // Most text is pairs with one separator behind each.
        if !marks.no_checksum {
            let length = spaced(&text[at..], out);
            if length > 0 {
                at += length;
                end = at - usize::from(length.is_multiple_of(3));
            }
            at += text[at..].iter().take_while(|&&b| b == b' ').count();
            while let Some((length, behind)) = spread(&text[at..], loose, out) {
                end = at + length;
                at += behind;
            }
        }
        let mut dashes = 0;
        while text.get(at).is_some_and(|&b| SEPARATORS[b as usize]) {
            dashes += usize::from(text[at] == b'-');
            at += 1;
        }
        // What is cut off is no byte: `05 03 ... 72 more bytes`.
        if text[end..at].windows(3).any(|three| three == b"...") {
            return end;
        }
        // `-- --` in place of a checksum; a dash between bytes is a separator.
        if dashes >= 2 && !out.is_empty() && text[end..at].windows(2).any(|two| two == b"--") {
            marks.no_checksum = true;
            end = at;
        }
        let token = word(text, at);
        if token.is_empty() {
            return end;
        }
        let read = !marks.no_checksum && hex_token(token, loose, out);
        let filler = !read && !out.is_empty() && text.get(at + token.len()) != Some(&b'=') && placeholder(token);
        if !read && !filler {
            return end;
        }
        marks.no_checksum |= filler;
        at += token.len();
        end = at;
        // A bracket that belongs to the byte.
        if text.get(at).is_some_and(|b| matches!(b, b']' | b'}' | b'>')) {
            end += 1;
        }
    }
}

fn placeholder(token: &[u8]) -> bool {
    PLACEHOLDERS.iter().any(|known| token.eq_ignore_ascii_case(known))
}

pub(super) fn hex_token(token: &[u8], loose: bool, out: &mut Vec<u8>) -> bool {
    let with_prefix = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X"));
    let with_suffix = if token.len() <= 3 { token.strip_suffix(b"h").or_else(|| token.strip_suffix(b"H")) } else { None };
    let digits = with_prefix.or(with_suffix).unwrap_or(token);
    match digits.len() {
        1 if loose || with_prefix.is_some() || with_suffix.is_some() => {
            let value = digit(digits, 0);
            if value != BAD {
                out.push(value);
            }
            value != BAD
        }
        length if length >= 2 && length % 2 == 0 => solid(digits, out),
        _ => false,
    }
}

pub(super) fn pairs(text: &[u8], out: &mut Vec<u8>) -> usize {
    let (mut at, mut end, first) = (0, 0, out.len());
    while out.len() - first < DUMP_LINE {
        let blanks = text[at..].iter().take_while(|&&b| b == b' ').count();
        let limit = if end == 0 { usize::MAX } else { 2 };
        let ends = text.get(at + blanks + 2).is_none_or(|b| !b.is_ascii_alphanumeric());
        match pair(text, at + blanks).filter(|_| ends && blanks <= limit) {
            Some(value) => out.push(value),
            None => break,
        }
        end = at + blanks + 2;
        at = end;
    }
    end
}

pub(super) fn groups(text: &[u8], out: &mut Vec<u8>) -> usize {
    let start = text.iter().take_while(|&&b| b == b' ').count();
    let mut at = start;
    while let Some(value) = pair(text, at) {
        out.push(value);
        at += 2;
        if text.get(at) == Some(&b' ') && digit(text, at + 1) != BAD {
            at += 1;
        }
    }
    at
}

pub(super) fn prefixed(text: &[u8], out: &mut Vec<u8>, marks: &mut Marks) -> usize {
    let (mut at, mut end) = (0, 0);
    loop {
        while text.get(at).is_some_and(|&b| SEPARATORS[b as usize]) {
            at += 1;
        }
        if let Some(length) = prefixed_one(&text[at..], out) {
            at += length;
            end = at;
            continue;
        }
        let token = word(text, at);
        let digits = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X"));
        if digits.is_none_or(|digits| digits.len() > 2) || !hex_token(token, false, out) {
            let filler = !out.is_empty() && placeholder(token);
            marks.no_checksum |= filler;
            return if filler { text.len() } else { end };
        }
        at += token.len();
        end = at;
    }
}

/// `0x5` or `0x05` that a separator or the line's end follows.
fn prefixed_one(text: &[u8], out: &mut Vec<u8>) -> Option<usize> {
    let digits = text.strip_prefix(b"0x")?;
    let ends = |at: usize| digits.get(at).is_none_or(|&b| SEPARATORS[b as usize]);
    let (value, length) = match pair(digits, 0) {
        Some(value) => (value, 2),
        None => (Some(digit(digits, 0)).filter(|&value| value != BAD)?, 1),
    };
    ends(length).then(|| {
        out.push(value);
        2 + length
    })
}

pub(super) fn bracketed(text: &[u8], around: [u8; 2], out: &mut Vec<u8>) -> usize {
    let mut at = 0;
    while let Some(&[open, high, low, close]) = text.get(at..at + 4) {
        let value = HIGH[high as usize] | LOW[low as usize];
        let ([true, true], value @ 0..NO) = ([open == around[0], close == around[1]], value) else { break };
        let value = value as u8;
        out.push(value);
        at += 4;
        if text.get(at) == Some(&b' ') && text.get(at + 1) == Some(&around[0]) {
            at += 1;
        }
    }
    // A single one may be a number in a text.
    if at < 8 {
        out.truncate(out.len() - at / 4);
        return 0;
    }
    at
}

pub(super) fn byte(text: &[u8], out: &mut Vec<u8>) -> usize {
    let blanks = text.iter().take_while(|&&b| b == b' ' || b == b'\t').count();
    let token = word(text, blanks);
    let digits = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X")).unwrap_or(token);
    let good = matches!(digits.len(), 1 | 2) && hex_token(digits, true, out);
    if good {
        blanks + token.len()
    } else {
        0
    }
}
