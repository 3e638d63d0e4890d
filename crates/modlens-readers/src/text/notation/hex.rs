//! Bytes as pairs of hex digits, with the separators, prefixes and suffixes that programs print.

use memchr::memchr_iter;

use crate::text::date::stamp_length;
use crate::text::notation::tokens::{counts_what_follows, word, NotationFlags, CHARS_PER_STEP};
use modlens_protocol::hex::{
    byte_at, decode_pairs, digit_at, DIGIT_VALUES, HIGH_DIGIT_VALUES, INVALID, INVALID_DIGIT, LOW_DIGIT_VALUES,
};

/// Whether a character may separate bytes.
const SEPARATORS: [bool; 256] = separators();

/// 0 for separators and `INVALID` for all other characters, to be combined with the values of digits.
static SEPARATOR_VALUES: [u16; 256] = separator_values();

/// The most separators between two bytes. A line of separators alone would else be read to its end from each of its places.
const MAX_SEPARATORS: usize = 256;

/// The most bytes in a line of a hex dump.
const MAX_DUMP_LINE_BYTES: usize = 16;

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

const fn separator_values() -> [u16; 256] {
    let mut table = [INVALID; 256];
    let mut i = 0;
    while i < 256 {
        if SEPARATORS[i] {
            table[i] = 0;
        }
        i += 1;
    }
    table
}

/// Words that programs and manuals print in place of the checksum.
const CHECKSUM_PLACEHOLDERS: &[&[u8]] =
    &[b"xx", b"??", b"crc", b"crc16", b"lrc", b"crclo", b"crchi", b"crcl", b"crch", b"lo", b"hi", b"low", b"high", b"ll", b"hh"];

/// Reads pairs of digits that are each followed by exactly one separator, up to the first irregularity. Returns the length
/// of the text.
fn read_regular_pairs(text: &[u8], out: &mut Vec<u8>) -> usize {
    let mut blocks = text.chunks_exact(3 * CHARS_PER_STEP);
    let (mut bytes, mut count) = ([0u8; CHARS_PER_STEP], 0);
    for block in &mut blocks {
        let mut invalid = 0;
        for (byte, three) in bytes.iter_mut().zip(block.chunks_exact(3)) {
            let value = HIGH_DIGIT_VALUES[three[0] as usize] | LOW_DIGIT_VALUES[three[1] as usize];
            invalid |= value | SEPARATOR_VALUES[three[2] as usize];
            *byte = value as u8;
        }
        if invalid & INVALID != 0 {
            break;
        }
        out.extend_from_slice(&bytes);
        count += CHARS_PER_STEP;
    }
    for three in text[3 * count..].chunks_exact(3) {
        let value = HIGH_DIGIT_VALUES[three[0] as usize] | LOW_DIGIT_VALUES[three[1] as usize];
        if (value | SEPARATOR_VALUES[three[2] as usize]) & INVALID != 0 {
            break;
        }
        out.push(value as u8);
        count += 1;
    }
    // The last pair of a line has no separator after it.
    if let (2, Some(value)) = (text.len() - 3 * count, byte_at(text, 3 * count)) {
        out.push(value);
        return text.len();
    }
    3 * count
}

/// Reads a text of pairs of digits with one blank between them and nothing else into the beginning of `out`, with the bytes
/// that `hex` would read. Returns their number; `None` for any other text, and for one that leaves less than a few bytes of
/// room in `out`.
pub(in crate::text) fn spaced_pairs(text: &[u8], out: &mut [u8]) -> Option<usize> {
    let length = text.len().div_ceil(3);
    if text.len() % 3 != 2 || length + ROOM_BEHIND > out.len() {
        return None;
    }
    let (threes, last) = text.as_chunks::<3>();
    let (blocks, rest) = threes.as_chunks::<PAIRS_PER_STEP>();
    let (mut invalid, mut other) = (0, 0);
    let (starts, _) = out.as_chunks_mut::<PAIRS_PER_STEP>();
    for (block, bytes) in blocks.iter().zip(starts) {
        for (three, byte) in block.iter().zip(bytes) {
            let value = HIGH_DIGIT_VALUES[three[0] as usize] | LOW_DIGIT_VALUES[three[1] as usize];
            invalid |= value;
            other |= three[2] ^ b' ';
            *byte = value as u8;
        }
    }
    for (three, byte) in rest.iter().zip(&mut out[PAIRS_PER_STEP * blocks.len()..]) {
        let value = HIGH_DIGIT_VALUES[three[0] as usize] | LOW_DIGIT_VALUES[three[1] as usize];
        invalid |= value;
        other |= three[2] ^ b' ';
        *byte = value as u8;
    }
    out[length - 1] = byte_at(last, 0)?;
    (invalid & INVALID == 0 && other == 0).then_some(length)
}

/// So many pairs are decoded at once.
const PAIRS_PER_STEP: usize = 4;

/// So many bytes are left after those of a line, because CRCs are computed in steps of several bytes.
const ROOM_BEHIND: usize = 16;

/// Reads one byte that is followed by spaces or by the end of the text. Returns the length of the byte, without and with
/// the spaces. `allow_single_digits` also accepts a byte of one digit.
fn read_spaced_byte(text: &[u8], allow_single_digits: bool, out: &mut Vec<u8>) -> Option<(usize, usize)> {
    let (value, length) = match byte_at(text, 0) {
        Some(value) => (value, 2),
        None if allow_single_digits => (Some(digit_at(text, 0)).filter(|&value| value != INVALID_DIGIT)?, 1),
        None => return None,
    };
    let blanks = text[length..].iter().take_while(|&&b| b == b' ').count();
    if blanks == 0 && text.len() > length {
        return None;
    }
    out.push(value);
    Some((length, length + blanks))
}

/// The most digits of an offset: 64 bits.
const MAX_OFFSET_DIGITS: usize = 16;

/// Whether this is a line of a dump with its offset in front, as in `0010  05 03 ..` or `[0010] 05 03 ..`. An offset must not
/// be read as bytes.
fn begins_with_offset(text: &[u8]) -> bool {
    let text = text.trim_ascii_start();
    let text = text.strip_prefix(b"| ").unwrap_or(text);
    let text = text.strip_prefix(b"[").unwrap_or(text);
    let (prefixed, text) = text.strip_prefix(b"0x").map_or((false, text), |rest| (true, rest));
    // Most text begins with a pair of digits, which settles the question at once.
    if text.get(2).is_none_or(|&b| DIGIT_VALUES[b as usize] == INVALID_DIGIT) {
        return false;
    }
    let offset = word(&text[..text.len().min(MAX_OFFSET_DIGITS + 1)], 0);
    if offset.len() > MAX_OFFSET_DIGITS {
        return false;
    }
    let behind = &text[offset.len()..];
    let behind = behind.strip_prefix(b"]").unwrap_or(behind);
    let bytes = behind.trim_ascii_start();
    let pairs = behind.starts_with(b" ") && byte_at(bytes, 0).is_some() && bytes.get(2).is_none_or(|&b| b == b' ');
    // Offsets count lines of 16 bytes, so their last digit is 0.
    (4..=8).contains(&offset.len())
        && offset.ends_with(b"0")
        && offset.iter().all(|&b| DIGIT_VALUES[b as usize] != INVALID_DIGIT)
        && ((pairs && !prefixed) || behind.starts_with(b": "))
}

/// Reads bytes with any separators, and stops at a time of day and at the first word that is neither a byte nor a placeholder
/// for the checksum. Returns the length of the text.
pub(super) fn hex(text: &[u8], allow_single_digits: bool, out: &mut Vec<u8>, flags: &mut NotationFlags) -> usize {
    if allow_single_digits && is_list_of_numbers(text) {
        return 0;
    }
    let (before, flags_before) = (out.len(), *flags);
    let length = hex_words(text, allow_single_digits, out, flags);
    let Some(time) = time_within(text, length) else { return length };
    out.truncate(before);
    *flags = flags_before;
    hex_words(&text[..time], allow_single_digits, out, flags)
}

/// Whether the text begins with an array of JSON or JavaScript, `[0,1,0,16]`: its numbers are decimal and have no leading zeros.
fn is_list_of_numbers(text: &[u8]) -> bool {
    let Some(inside) = text.trim_ascii_start().strip_prefix(b"[") else { return false };
    let Some(end) = memchr::memchr(b']', inside) else { return false };
    let is_number = |part: &[u8]| match part.trim_ascii() {
        [digit] => digit.is_ascii_digit(),
        [b'1'..=b'9', rest @ ..] => rest.len() <= 2 && rest.iter().all(u8::is_ascii_digit),
        _ => false,
    };
    let parts = || inside[..end].split(|&b| b == b',');
    parts().nth(1).is_some() && parts().all(is_number)
}

/// Where the first time of day begins that comes after other words in so much of the text.
fn time_within(text: &[u8], length: usize) -> Option<usize> {
    let starts = memchr_iter(b':', &text[..length]).filter(|&colon| colon > 2 && text.get(colon + 3) == Some(&b':'));
    starts.map(|colon| colon - 2).find(|&at| !text[at - 1].is_ascii_alphanumeric() && stamp_length(text, at) > 0)
}

/// Reads such words, also where they are a time of day.
fn hex_words(text: &[u8], allow_single_digits: bool, out: &mut Vec<u8>, flags: &mut NotationFlags) -> usize {
    if begins_with_offset(text) {
        return 0;
    }
    let (mut at, mut end) = (0, 0);
    loop {
        // Most text consists of pairs with one separator after each.
        if !flags.no_checksum {
            let length = read_regular_pairs(&text[at..], out);
            if length > 0 {
                at += length;
                end = at - usize::from(length.is_multiple_of(3));
            }
            at += text[at..].iter().take_while(|&&b| b == b' ').count();
            while let Some((length, behind)) = read_spaced_byte(&text[at..], allow_single_digits, out) {
                end = at + length;
                at += behind;
            }
        }
        let separators = leading_separators(&text[at..]);
        let dashes = memchr_iter(b'-', separators).count();
        at += separators.len();
        // Dots mean that the program printed only a part: the numbers after them are no bytes, as in
        // `05 03 ... 72 more bytes`.
        if text[end..at].windows(3).any(|three| three == b"...") {
            return end;
        }
        // `-- --` is a placeholder for the checksum, while a single dash between bytes is a separator.
        if dashes >= 2 && !out.is_empty() && text[end..at].windows(2).any(|two| two == b"--") {
            flags.no_checksum = true;
            end = at;
        }
        let token = word(text, at);
        if token.is_empty() {
            return end;
        }
        // The letter in front of a string of Python, as in `b'0503'`, is no byte.
        if allow_single_digits && token.eq_ignore_ascii_case(b"b") && matches!(text.get(at + 1), Some(b'\'' | b'"')) {
            return end;
        }
        // Nor is a letter that ends a label, as in `[D] A: 0503`.
        let is_letter = allow_single_digits && matches!(token, [letter] if letter.is_ascii_alphabetic());
        if is_letter && matches!(text.get(at + 1..at + 3), Some([b':' | b']' | b')', b' '])) {
            return end;
        }
        if !out.is_empty() && counts_what_follows(text, &(at..at + token.len())) {
            return end;
        }
        let read = !flags.no_checksum && hex_token(token, allow_single_digits, out);
        let is_placeholder =
            !read && !out.is_empty() && text.get(at + token.len()) != Some(&b'=') && is_checksum_placeholder(token);
        if !read && !is_placeholder {
            return end;
        }
        flags.no_checksum |= is_placeholder;
        at += token.len();
        end = at;
        // A closing bracket belongs to the byte.
        if text.get(at).is_some_and(|b| matches!(b, b']' | b'}' | b'>')) {
            end += 1;
        }
    }
}

/// The separators that the text begins with.
fn leading_separators(text: &[u8]) -> &[u8] {
    let count = text.iter().take(MAX_SEPARATORS).take_while(|&&b| SEPARATORS[b as usize]).count();
    &text[..count]
}

/// Whether the word is in place of a checksum.
fn is_checksum_placeholder(token: &[u8]) -> bool {
    CHECKSUM_PLACEHOLDERS.iter().any(|known| token.eq_ignore_ascii_case(known))
}

/// Decodes a word of hex digits, with or without `0x` or `h`, and appends its bytes to `out`. Returns false if it is none.
pub(super) fn hex_token(token: &[u8], allow_single_digits: bool, out: &mut Vec<u8>) -> bool {
    let with_prefix = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X"));
    let with_suffix = if token.len() <= 3 { token.strip_suffix(b"h").or_else(|| token.strip_suffix(b"H")) } else { None };
    let digits = with_prefix.or(with_suffix).unwrap_or(token);
    match digits.len() {
        1 if allow_single_digits || with_prefix.is_some() || with_suffix.is_some() => {
            let value = digit_at(digits, 0);
            if value != INVALID_DIGIT {
                out.push(value);
            }
            value != INVALID_DIGIT
        }
        length if length >= 2 && length % 2 == 0 => decode_pairs(digits, out),
        _ => false,
    }
}

/// Reads the pairs of one line of a hex dump. They end at a gap of more than two spaces, after which the line is repeated
/// as characters. Returns the length of the text.
pub(super) fn pairs(text: &[u8], out: &mut Vec<u8>) -> usize {
    let (mut at, mut end, first) = (0, 0, out.len());
    while out.len() - first < MAX_DUMP_LINE_BYTES {
        let blanks = text[at..].iter().take_while(|&&b| b == b' ').count();
        let limit = if end == 0 { usize::MAX } else { 2 };
        let ends = text.get(at + blanks + 2).is_none_or(|b| !b.is_ascii_alphanumeric());
        match byte_at(text, at + blanks).filter(|_| ends && blanks <= limit) {
            Some(value) => out.push(value),
            None => break,
        }
        end = at + blanks + 2;
        at = end;
    }
    end
}

/// Reads groups of pairs with single spaces between the groups. Returns the length of the text.
pub(super) fn groups(text: &[u8], out: &mut Vec<u8>) -> usize {
    let start = text.iter().take_while(|&&b| b == b' ').count();
    let mut at = start;
    while let Some(value) = byte_at(text, at) {
        out.push(value);
        at += 2;
        if text.get(at) == Some(&b' ') && digit_at(text, at + 1) != INVALID_DIGIT {
            at += 1;
        }
    }
    at
}

/// Reads bytes that each have `0x` in front, and stops at the first word that has not. Returns the length of the text.
pub(super) fn prefixed(text: &[u8], out: &mut Vec<u8>, flags: &mut NotationFlags) -> usize {
    let (mut at, mut end) = (0, 0);
    loop {
        at += leading_separators(&text[at..]).len();
        if let Some(length) = read_prefixed_byte(&text[at..], out) {
            at += length;
            end = at;
            continue;
        }
        let token = word(text, at);
        let digits = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X"));
        if digits.is_none_or(|digits| digits.len() > 2) || !hex_token(token, false, out) {
            let is_placeholder = !out.is_empty() && is_checksum_placeholder(token);
            flags.no_checksum |= is_placeholder;
            return if is_placeholder { text.len() } else { end };
        }
        at += token.len();
        end = at;
    }
}

/// Reads one or two such numbers; no more stand there.
pub(super) fn prefixed_value(text: &[u8], out: &mut Vec<u8>, flags: &mut NotationFlags) -> usize {
    let before = out.len();
    let length = prefixed(text, out, flags);
    if out.len() > before + 2 {
        out.truncate(before);
        return 0;
    }
    length
}

/// Reads `0x5` or `0x05`, followed by a separator or the end of the text. Returns the length of the text.
fn read_prefixed_byte(text: &[u8], out: &mut Vec<u8>) -> Option<usize> {
    let digits = text.strip_prefix(b"0x")?;
    let ends = |at: usize| digits.get(at).is_none_or(|&b| SEPARATORS[b as usize]);
    let (value, length) = match byte_at(digits, 0) {
        Some(value) => (value, 2),
        None => (Some(digit_at(digits, 0)).filter(|&value| value != INVALID_DIGIT)?, 1),
    };
    ends(length).then(|| {
        out.push(value);
        2 + length
    })
}

/// Reads bytes that are each enclosed in the brackets `around`. Returns the length of the text.
pub(super) fn bracketed(text: &[u8], around: [u8; 2], out: &mut Vec<u8>) -> usize {
    let (mut at, mut count) = (0, 0);
    while text.get(at) == Some(&around[0]) {
        // Some people print `< 01 >< 03 >`.
        let blank = usize::from(text.get(at + 1) == Some(&b' '));
        let inner = at + 1 + blank;
        let close = text.get(inner + 2 + blank);
        let Some(&[high, low]) = text.get(inner..inner + 2).filter(|_| close == Some(&around[1])) else { break };
        let value @ 0..INVALID = HIGH_DIGIT_VALUES[high as usize] | LOW_DIGIT_VALUES[low as usize] else { break };
        out.push(value as u8);
        count += 1;
        at = inner + 3 + blank;
        if text.get(at) == Some(&b' ') && text.get(at + 1) == Some(&around[0]) {
            at += 1;
        }
    }
    // A single byte in brackets may be a number in prose.
    if count < 2 {
        out.truncate(out.len() - count);
        return 0;
    }
    at
}

/// Reads one byte of one or two hex digits, with or without `0x`. Returns the length of the text.
pub(super) fn byte(text: &[u8], out: &mut Vec<u8>) -> usize {
    let blanks = text.iter().take_while(|&&b| b == b' ' || b == b'\t').count();
    let token = word(text, blanks);
    let digits = token.strip_prefix(b"0x").or_else(|| token.strip_prefix(b"0X")).unwrap_or(token);
    let is_byte = matches!(digits.len(), 1 | 2) && hex_token(digits, true, out);
    if is_byte {
        blanks + token.len()
    } else {
        0
    }
}
