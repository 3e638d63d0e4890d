//! How programs write bytes: hex in many dresses, decimal, escapes, words. A notation takes as much text as it can.

use crate::hex::{digit, pair, solid, BAD, DIGITS, HIGH, LOW, NO};

/// A way of writing bytes; the word is how templates name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Notation {
    /// Pairs of hex digits, with or without `0x` or `h`, with any separators.
    Hex,
    /// The same, where digits may stand alone: `1 3 0 6B`.
    Loose,
    /// Sixteen pairs at most, blanks between: a line of a dump.
    Pairs,
    /// Groups of pairs up to two blanks: a line of xxd.
    Groups,
    /// `0x` in front of each byte.
    Prefixed,
    /// `[01][03]`.
    Square,
    /// `<01><03>`.
    Angle,
    /// `{01}{03}`.
    Curly,
    /// Decimal numbers.
    Decimal,
    /// A string with escapes, up to its quote.
    Escaped,
    /// Words of hex digits, low byte first: hexdump, od -x.
    Words,
    /// Words of octal digits, low byte first: od.
    Octal,
    /// Base64.
    Base64,
    /// Characters with their bytes in parentheses: two digits are hex, three decimal.
    Named,
    /// One byte: `0x41`, `41`, `0X4`.
    Byte,
    /// One byte in decimal.
    Number,
    /// A cell of a logic analyser's table: a character, a number in quotes, `0x41`.
    Cell,
    /// Modbus ASCII: colon and hex digits, delivered as the characters on the line.
    Ascii,
}

/// What a notation saw beside bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Marks {
    /// Where the checksum should be stands a placeholder.
    pub no_checksum: bool,
}

const SEPARATORS: [bool; 256] = separators();
/// What a separator is worth: nothing.
static BETWEEN: [u16; 256] = between();
/// Bytes that are read at once where text is plain.
const BLOCK: usize = 8;
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

/// Base64 in both of its alphabets (RFC 4648).
static SIXTY_FOUR: [u8; 256] = {
    let mut table = [BAD; 256];
    let alphabet = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut i = 0;
    while i < alphabet.len() {
        table[alphabet[i] as usize] = i as u8;
        i += 1;
    }
    (table[b'-' as usize], table[b'_' as usize]) = (62, 63);
    table
};

/// Words that stand where a program, or a manual, does not print the checksum.
const PLACEHOLDERS: &[&[u8]] =
    &[b"xx", b"??", b"crc", b"crc16", b"lrc", b"crclo", b"crchi", b"crcl", b"crch", b"lo", b"hi", b"low", b"high", b"ll", b"hh"];

impl Notation {
    /// The words of templates.
    pub const WORDS: &'static [(&'static str, Self)] = &[
        ("hex", Self::Hex),
        ("loose", Self::Loose),
        ("pairs", Self::Pairs),
        ("groups", Self::Groups),
        ("0x", Self::Prefixed),
        ("[hex]", Self::Square),
        ("<hex>", Self::Angle),
        ("(hex)", Self::Curly),
        ("decimal", Self::Decimal),
        ("escaped", Self::Escaped),
        ("words", Self::Words),
        ("octal", Self::Octal),
        ("base64", Self::Base64),
        ("named", Self::Named),
        ("byte", Self::Byte),
        ("number", Self::Number),
        ("cell", Self::Cell),
        ("ascii", Self::Ascii),
    ];

    /// Reads bytes from the start of `text` into `out`; gives the length of text that they took. `stop` ends a string.
    pub fn read(self, text: &[u8], stop: Option<u8>, out: &mut Vec<u8>, marks: &mut Marks) -> Option<usize> {
        let before = out.len();
        let taken = match self {
            Self::Hex => hex(text, false, out, marks),
            Self::Loose => hex(text, true, out, marks),
            Self::Pairs => pairs(text, out),
            Self::Groups => groups(text, out),
            Self::Prefixed => prefixed(text, out, marks),
            Self::Square => bracketed(text, *b"[]", out),
            Self::Angle => bracketed(text, *b"<>", out),
            Self::Curly => bracketed(text, *b"{}", out),
            Self::Decimal => decimal(text, out),
            Self::Escaped => escaped(text, stop, out),
            Self::Words => words(text, 4, 16, out),
            Self::Octal => words(text, 6, 8, out),
            Self::Base64 => base64(text, out),
            Self::Named => named(text, out),
            Self::Byte => byte(text, out),
            Self::Number => decimal_one(text, out),
            Self::Cell => cell(text, out),
            Self::Ascii => ascii(text, out),
        };
        (out.len() > before).then_some(taken)
    }

    /// The character that it begins with, where that is always the same.
    pub fn opening(self) -> Option<u8> {
        match self {
            Self::Square => Some(b'['),
            Self::Angle => Some(b'<'),
            Self::Curly => Some(b'{'),
            Self::Ascii => Some(b':'),
            _ => None,
        }
    }

    /// Whether the last word of a short line may hold one byte only.
    pub fn pads(self) -> bool {
        matches!(self, Self::Words | Self::Octal)
    }
}

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

fn word(text: &[u8], from: usize) -> &[u8] {
    // Without branches: many bytes without a separator are looked through several at once.
    let within = |b: u8| (b | 0x20).wrapping_sub(b'a') < 26 || b.wrapping_sub(b'0') < 10 || b == b'?';
    let rest = &text[from..];
    let blocks = rest.chunks_exact(BLOCK).take_while(|block| block.iter().fold(true, |all, &b| all & within(b)));
    let length = BLOCK * blocks.count();
    let more = rest[length..].iter().take_while(|&&b| within(b)).count();
    &rest[..length + more]
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

fn hex(text: &[u8], loose: bool, out: &mut Vec<u8>, marks: &mut Marks) -> usize {
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

fn hex_token(token: &[u8], loose: bool, out: &mut Vec<u8>) -> bool {
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

fn pairs(text: &[u8], out: &mut Vec<u8>) -> usize {
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

fn groups(text: &[u8], out: &mut Vec<u8>) -> usize {
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

fn prefixed(text: &[u8], out: &mut Vec<u8>, marks: &mut Marks) -> usize {
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

fn bracketed(text: &[u8], around: [u8; 2], out: &mut Vec<u8>) -> usize {
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

fn named(text: &[u8], out: &mut Vec<u8>) -> usize {
    let mut end = 0;
    loop {
        let rest = &text[end..];
        let blanks = rest.iter().take_while(|&&b| b == b' ').count();
        let name = rest[blanks..].iter().take_while(|&&b| b != b' ').count();
        let Some(inner) = rest[blanks + name..].strip_prefix(b" (") else { return end };
        let token = word(inner, 0);
        let value = if token.len() == 3 { number(token) } else { pair(token, 0).filter(|_| token.len() == 2) };
        let Some(value) = value.filter(|_| name > 0 && inner.get(token.len()) == Some(&b')')) else { return end };
        out.push(value);
        end += blanks + name + 2 + token.len() + 1;
    }
}

fn decimal(text: &[u8], out: &mut Vec<u8>) -> usize {
    let (mut at, mut end) = (0, 0);
    loop {
        while text.get(at).is_some_and(|b| matches!(b, b' ' | b',' | b'-' | b'[' | b'(' | b';')) {
            at += 1;
        }
        let token = word(text, at);
        let Some(value) = number(token) else { return end };
        out.push(value);
        at += token.len();
        end = at;
        if text.get(at).is_some_and(|b| matches!(b, b']' | b')')) {
            return at + 1;
        }
    }
}

fn number(token: &[u8]) -> Option<u8> {
    if !(1..=3).contains(&token.len()) {
        return None;
    }
    token.iter().try_fold(0u16, |value, &b| b.is_ascii_digit().then(|| value * 10 + u16::from(b - b'0')))?.try_into().ok()
}

fn decimal_one(text: &[u8], out: &mut Vec<u8>) -> usize {
    let blanks = text.iter().take_while(|&&b| b == b' ').count();
    let token = word(text, blanks);
    out.extend(number(token));
    blanks + token.len()
}

/// A string without any escape is text for people.
fn escaped(text: &[u8], stop: Option<u8>, out: &mut Vec<u8>) -> usize {
    let (mut at, before) = (0, out.len());
    while let Some(&b) = text.get(at) {
        if Some(b) == stop {
            break;
        }
        if b != b'\\' {
            out.push(b);
            at += 1;
            continue;
        }
        let Some(&kind) = text.get(at + 1) else { break };
        let octal = text[at + 1..].iter().take(3).take_while(|b| matches!(b, b'0'..=b'7')).count();
        let (value, length) = match kind {
            b'x' => match (digit(text, at + 2), pair(text, at + 2)) {
                (_, Some(value)) => (value, 4),
                (BAD, None) => break,
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

fn words(text: &[u8], width: usize, radix: u32, out: &mut Vec<u8>) -> usize {
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

/// Eight characters at least; whether they mean anything is the checksum's to say.
fn base64(text: &[u8], out: &mut Vec<u8>) -> usize {
    let length = text.iter().take_while(|&&b| SIXTY_FOUR[b as usize] != BAD).count();
    let padding = text[length..].iter().take_while(|&&b| b == b'=').count();
    if length < 6 || (length + padding) % 4 != 0 || padding > 2 {
        return 0;
    }
    for four in text[..length].chunks(4) {
        let bits = four.iter().fold(0u32, |bits, &b| bits << 6 | u32::from(SIXTY_FOUR[b as usize])) << (6 * (4 - four.len()));
        out.extend_from_slice(&bits.to_be_bytes()[1..four.len()]);
    }
    length + padding
}

fn byte(text: &[u8], out: &mut Vec<u8>) -> usize {
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

fn cell(text: &[u8], out: &mut Vec<u8>) -> usize {
    if let [b'\'', rest @ ..] = text {
        let token = word(rest, 0);
        if let (Some(value), Some(b'\'')) = (number(token), rest.get(token.len())) {
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
        let value = if token == b"COMMA" { Some(b',') } else { number(token) };
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

fn ascii(text: &[u8], out: &mut Vec<u8>) -> usize {
    let Some(rest) = text.strip_prefix(b":") else { return 0 };
    let length = rest.iter().take_while(|&&b| DIGITS[b as usize] != BAD).count();
    if length < 6 || length % 2 != 0 {
        return 0;
    }
    let start = out.len();
    hex_token(&rest[..length], false, out);
    // `:010300000002C40B` is RTU behind a colon, as some manuals print it.
    if crate::checksum::lrc(&out[start..]) == 0 || !crate::checksum::crc_valid(&out[start..]) {
        out.truncate(start);
        out.extend_from_slice(&text[..=length]);
        out.extend_from_slice(b"\r\n");
    }
    1 + length
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(notation: Notation, text: &str) -> (Vec<u8>, &str, bool) {
        let (mut out, mut marks) = (Vec::new(), Marks::default());
        let end = notation.read(text.as_bytes(), Some(b'"'), &mut out, &mut marks).unwrap_or(0);
        (out, &text[end..], marks.no_checksum)
    }

    const FRAME: [u8; 8] = [5, 3, 0, 0x10, 0, 2, 0xC4, 0x4A];

    #[test]
    fn every_notation_reads_the_same_bytes() {
        for (notation, text) in [
            (Notation::Hex, "05 03 00 10 00 02 C4 4A"),
            (Notation::Hex, "050300100002c44a"),
            (Notation::Hex, "0x05,0x3,0x0,0x10,0x0,0x2,0xc4,0x4a"),
            (Notation::Hex, "05H 03H 00H 10H 00H 02H C4H 4AH"),
            (Notation::Hex, "05 03 **00 10** 00 02 C4 4A"),
            (Notation::Loose, "5 3 0 10 0 2 C4 4A"),
            (Notation::Pairs, "05 03 00 10  00 02 c4 4a"),
            (Notation::Groups, "0503 0010 0002 c44a"),
            (Notation::Prefixed, "0x5 0x3 0x0 0x10 0x0 0x2 0xc4 0x4a"),
            (Notation::Square, "[05][03][00][10][00][02][C4][4A]"),
            (Notation::Angle, "<05><03><00><10><00><02><C4><4A>"),
            (Notation::Curly, "{05}{03}{00}{10}{00}{02}{C4}{4A}"),
            (Notation::Decimal, "5-3-0-16-0-2-196-74"),
            (Notation::Decimal, "[5, 3, 0, 16, 0, 2, 196, 74]"),
            (Notation::Escaped, "\\x05\\x03\\x00\\x10\\x00\\x02\\xc4J"),
            (Notation::Escaped, "\\5\\3\\0\\20\\0\\2\\304J"),
            (Notation::Words, "0305 1000 0200 4ac4"),
            (Notation::Octal, "001405 010000 001000 045304"),
            (Notation::Base64, "BQMAEAACxEo="),
        ] {
            assert_eq!(read(notation, text), (FRAME.to_vec(), "", false), "{notation:?} {text}");
        }
    }

    #[test]
    fn a_notation_stops_where_bytes_end() {
        assert_eq!(read(Notation::Hex, "05 03 Rx: 01"), (vec![5, 3], " Rx: 01", false));
        assert_eq!(read(Notation::Prefixed, "0x5 0x3 old_data:"), (vec![5, 3], " old_data:", false));
        assert_eq!(read(Notation::Pairs, "05 03   ad de"), (vec![5, 3], "   ad de", false));
        assert_eq!(read(Notation::Groups, "0503  dead"), (vec![5, 3], "  dead", false));
        assert_eq!(read(Notation::Escaped, "\\x05\\\"\", 2"), (vec![5, b'"'], "\", 2", false));
        assert!(read(Notation::Hex, "hello").0.is_empty());
        assert!(read(Notation::Hex, "0010  05 03 00 10").0.is_empty());
        assert!(read(Notation::Hex, "0x0010:  0503 0010").0.is_empty());
        assert_eq!(read(Notation::Hex, "0503 0010 0002 c44a").0, FRAME);
    }

    #[test]
    fn placeholders_stand_for_a_checksum() {
        for text in ["05 03 00 -- --", "05 03 00 CRC", "05 03 00 xx xx", "05 03 00 [CRC]", "05 03 00 CRC Lo CRC Hi"] {
            let (bytes, _, no_checksum) = read(Notation::Hex, text);
            assert_eq!((bytes, no_checksum), (vec![5, 3, 0], true), "{text}");
        }
    }
}
