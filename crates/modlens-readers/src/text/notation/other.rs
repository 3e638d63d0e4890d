//! Bytes in notations other than hex: decimal, 16-bit words, escaped strings, base64, and frames of Modbus ASCII.
//!
//! Each function appends the bytes at the start of the text to `out` and returns the length of the text that they took.

use crate::text::date::stamp_length;
use crate::text::notation::hex::{byte, hex_token};
use crate::text::notation::tokens::word;
use modlens_protocol::checksum::{crc_valid, lrc};
use modlens_protocol::hex::{byte_at, digit_at, DIGIT_VALUES, INVALID_DIGIT};

/// The value of each character in base64, in both of its alphabets (RFC 4648, 4 and 5).
static BASE64_VALUES: [u8; 256] = {
    let mut table = [INVALID_DIGIT; 256];
    let alphabet = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut i = 0;
    while i < alphabet.len() {
        table[alphabet[i] as usize] = i as u8;
        i += 1;
    }
    (table[b'-' as usize], table[b'_' as usize]) = (62, 63);
    table
};

/// Reads names of characters with their value in parentheses, such as `ETX (03) k (6b)`.
pub(super) fn named(text: &[u8], out: &mut Vec<u8>) -> usize {
    let mut end = 0;
    loop {
        let rest = &text[end..];
        let blanks = rest.iter().take_while(|&&b| b == b' ').count();
        let name = rest[blanks..].iter().take_while(|&&b| b != b' ').count();
        let Some(inner) = rest[blanks + name..].strip_prefix(b" (") else { return end };
        let token = word(inner, 0);
        let value = if token.len() == 3 { decimal_byte(token) } else { byte_at(token, 0).filter(|_| token.len() == 2) };
        let Some(value) = value.filter(|_| name > 0 && inner.get(token.len()) == Some(&b')')) else { return end };
        out.push(value);
        end += blanks + name + 2 + token.len() + 1;
    }
}

/// Whether the word is a pair of hex digits with a letter, so that the numbers in front of it are hex as well.
fn is_hex_pair(token: &[u8]) -> bool {
    byte_at(token, 0).is_some() && token.len() == 2 && !token.iter().all(u8::is_ascii_digit)
}

/// Reads decimal numbers up to 255, with separators or as a list in brackets. They end at a time of day.
pub(super) fn decimal(text: &[u8], out: &mut Vec<u8>) -> usize {
    let (mut at, mut end, before) = (0, 0, out.len());
    loop {
        while text.get(at).is_some_and(|b| matches!(b, b' ' | b',' | b'-' | b'[' | b'(' | b';')) {
            at += 1;
        }
        let token = word(text, at);
        if end > 0 && is_hex_pair(token) {
            out.truncate(before);
            return 0;
        }
        let Some(value) = decimal_byte(token).filter(|_| end == 0 || stamp_length(text, at) == 0) else { return end };
        // Java prints bytes from -128 on; a dash after a number or an arrow separates.
        let is_negative = matches!(text[..at], [.., b' ' | b',' | b'[' | b'(' | b';', b'-']);
        if is_negative && value > 128 {
            return end;
        }
        out.push(if is_negative { value.wrapping_neg() } else { value });
        at += token.len();
        end = at;
        if text.get(at).is_some_and(|b| matches!(b, b']' | b')')) {
            // A single number in brackets counts something.
            let is_list = out.len() > before + 1;
            out.truncate(if is_list { out.len() } else { before });
            return if is_list { at + 1 } else { 0 };
        }
    }
}

/// Parses a decimal number of one to three digits, up to 255.
fn decimal_byte(token: &[u8]) -> Option<u8> {
    if !(1..=3).contains(&token.len()) {
        return None;
    }
    token.iter().try_fold(0u16, |value, &b| b.is_ascii_digit().then(|| value * 10 + u16::from(b - b'0')))?.try_into().ok()
}

/// Reads one decimal number up to 255.
pub(super) fn decimal_one(text: &[u8], out: &mut Vec<u8>) -> usize {
    let blanks = text.iter().take_while(|&&b| b == b' ').count();
    let token = word(text, blanks);
    out.extend(decimal_byte(token));
    blanks + token.len()
}

/// Reads a string with C escape sequences up to the character `stop`; letters of Latin-1 are bytes. A string without any escape sequence is prose and
/// yields no bytes.
pub(super) fn escaped(text: &[u8], stop: Option<u8>, out: &mut Vec<u8>) -> usize {
    let (mut at, before) = (0, out.len());
    while let Some(&b) = text.get(at) {
        if Some(b) == stop {
            break;
        }
        if b != b'\\' {
            // Python prints a string with the letters of Latin-1 as they are, and a file has them in UTF-8.
            let letter = if let [lead @ (0xC2 | 0xC3), next @ 0x80..=0xBF, ..] = text[at..] {
                Some((lead & 3) << 6 | next & 0x3F)
            } else {
                None
            };
            out.push(letter.unwrap_or(b));
            at += 1 + usize::from(letter.is_some());
            continue;
        }
        let Some(&kind) = text.get(at + 1) else { break };
        let octal = text[at + 1..].iter().take(3).take_while(|b| matches!(b, b'0'..=b'7')).count();
        let (value, length) = match kind {
            b'x' => match (digit_at(text, at + 2), byte_at(text, at + 2)) {
                (_, Some(value)) => (value, 4),
                (INVALID_DIGIT, None) => break,
                (single, None) => (single, 3),
            },
            b'0'..=b'7' => {
                (text[at + 1..=at + octal].iter().fold(0u8, |value, b| value.wrapping_mul(8).wrapping_add(b - b'0')), 1 + octal)
            }
            b'n' => (b'\n', 2),
            b'r' => (b'\r', 2),
            b't' => (b'\t', 2),
            b'a' => (7, 2),
            b'b' => (8, 2),
            b'f' => (12, 2),
            b'v' => (11, 2),
            b'e' => (27, 2),
            other => (other, 2),
        };
        out.push(value);
        at += length;
    }
    if !text[..at].contains(&b'\\') {
        out.truncate(before);
    }
    at
}

/// Reads 16-bit words of exactly `width` digits in this radix, low byte first.
pub(super) fn words(text: &[u8], width: usize, radix: u32, out: &mut Vec<u8>) -> usize {
    let (mut at, mut end) = (0, 0);
    loop {
        at += text[at..].iter().take_while(|&&b| b == b' ').count();
        let token = word(text, at);
        let value = std::str::from_utf8(token).ok().filter(|token| token.len() == width);
        let Some(value) = value.and_then(|token| u16::from_str_radix(token, radix).ok()) else { return end };
        out.extend_from_slice(&value.to_le_bytes());
        at += token.len();
        end = at;
    }
}

/// Reads base64 of at least eight characters with padding. Any word may be base64, so only a checksum shows whether it is.
pub(super) fn base64(text: &[u8], out: &mut Vec<u8>) -> usize {
    let length = text.iter().take_while(|&&b| BASE64_VALUES[b as usize] != INVALID_DIGIT).count();
    let padding = text[length..].iter().take_while(|&&b| b == b'=').count();
    if length < 6 || (length + padding) % 4 != 0 || padding > 2 {
        return 0;
    }
    for four in text[..length].chunks(4) {
        let bits = four.iter().fold(0u32, |bits, &b| bits << 6 | u32::from(BASE64_VALUES[b as usize])) << (6 * (4 - four.len()));
        out.extend_from_slice(&bits.to_be_bytes()[1..four.len()]);
    }
    length + padding
}

/// Reads one byte from a cell: a decimal number in single quotes, a character in double quotes, `0x41`, the word `COMMA`,
/// a decimal number of two or three digits, or the character itself.
pub(super) fn cell(text: &[u8], out: &mut Vec<u8>) -> usize {
    if let [b'\'', rest @ ..] = text {
        let token = word(rest, 0);
        if let (Some(value), Some(b'\'')) = (decimal_byte(token), rest.get(token.len())) {
            out.push(value);
            return token.len() + 2;
        }
    }
    if let [b'"', byte, b'"', ..] = *text {
        out.push(byte);
        return 3;
    }
    if text.starts_with(b"0x") || text.starts_with(b"0X") {
        return byte(text, out);
    }
    let token = word(text, 0);
    if token.len() >= 2 {
        let value = if token == b"COMMA" { Some(b',') } else { decimal_byte(token) };
        out.extend(value);
        return token.len();
    }
    match text.first() {
        Some(&b) if b != b',' => {
            out.push(b);
            1
        }
        _ => 0,
    }
}

/// Reads a frame of Modbus ASCII, and completes it with the CR and LF that logs do not print.
pub(super) fn ascii(text: &[u8], out: &mut Vec<u8>) -> usize {
    let Some(rest) = text.strip_prefix(b":") else { return 0 };
    let length = rest.iter().take_while(|&&b| DIGIT_VALUES[b as usize] != INVALID_DIGIT).count();
    if length < 6 || length % 2 != 0 {
        return 0;
    }
    let start = out.len();
    hex_token(&rest[..length], false, out);
    // Some manuals print an RTU frame after a colon, as in `:010300000002C40B`: its bytes are delivered, not its digits.
    if lrc(&out[start..]) == 0 || !crc_valid(&out[start..]) {
        out.truncate(start);
        out.extend_from_slice(&text[..=length]);
        out.extend_from_slice(b"\r\n");
    }
    1 + length
}
