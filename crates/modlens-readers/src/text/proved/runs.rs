//! Finds runs of bytes in a line, whatever is around them, in the notations that people and programs print.
//!
//! A run ends at a word that is no byte in its notation, and at dots that stand for what was not printed. What separates
//! the bytes does not matter. A change of the separators inside a run is remembered as an edge, because numbers of other
//! meaning may be in front of the bytes: `[44] 01 03`.

use std::ops::Range;

use crate::text::date::stamp_length;
use crate::text::notation::counts_what_follows;
use modlens_protocol::hex::{decode_pairs, digit_at, INVALID_DIGIT};

/// The most characters that may separate two bytes of a run.
const MAX_SEPARATOR_CHARS: usize = 6;

/// The most blanks that may separate two bytes of a run.
const MAX_BLANKS: usize = 12;

/// A word of so many bytes may be a frame of its own, so edges are around it.
const MIN_WORD_BYTES: usize = 4;

/// How the bytes of a run are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Style {
    /// Pairs of hex digits, also several in one word.
    Pairs,
    /// Hex numbers with `0x` in front.
    Prefixed,
    /// Hex numbers followed by `h`.
    Suffixed,
    /// Hex numbers of one or two digits.
    Loose,
    /// Decimal numbers from -128 to 255.
    Decimal,
    /// Numbers of eight binary digits.
    Binary,
    /// A string with escape sequences.
    Escaped,
    /// A word of base64.
    Base64,
    /// A colon and hex digits, as a frame of Modbus ASCII is sent.
    Ascii,
}

/// Bytes that are together in a line.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub style: Style,
    /// Their place in the line.
    pub text: Range<usize>,
    pub bytes: Vec<u8>,
    /// Positions in `bytes` where the separators change, or a long word begins or ends; ascending, the ends of the run among
    /// them.
    pub edges: Vec<usize>,
    /// A number in front of them has counted them.
    pub is_counted: bool,
    /// Where a number in front of the bytes ends, in bytes and in the line: it counts them, or a bracket closes after it.
    after_number: Option<(usize, usize)>,
}

impl Run {
    /// A run that is not made of words.
    pub fn whole(style: Style, text: Range<usize>, bytes: Vec<u8>) -> Self {
        let edges = vec![0, bytes.len()];
        Self { style, text, bytes, edges, is_counted: false, after_number: None }
    }

    /// The run with its place moved by so many characters.
    pub fn shifted(mut self, by: usize) -> Self {
        self.text = self.text.start + by..self.text.end + by;
        self.after_number = self.after_number.map(|(bytes, text)| (bytes, text + by));
        self
    }

    /// The run without a number in front of its bytes, such as their count in `(8) 01 03`.
    pub fn without_number(mut self) -> Self {
        if let Some((bytes, text)) = self.after_number.take() {
            self.bytes.drain(..bytes);
            self.text.start = text;
            self.edges = self.edges.iter().filter(|edge| **edge >= bytes).map(|edge| edge - bytes).collect();
        }
        self
    }
}

/// The bytes of one word, and the separator in front of it.
struct Word {
    separator: Range<usize>,
    first_byte: usize,
    count: usize,
}

/// All runs of hex in the line.
pub(super) fn hex_runs(line: &[u8]) -> Vec<Run> {
    runs(line, read_hex_word)
}

/// All runs of hex in a line in which a `0x` counts for the words after it as well: `0x010302 0007 F986`.
pub(super) fn half_prefixed_runs(line: &[u8]) -> Vec<Run> {
    if memchr::memmem::find(line, b"0x").is_none() {
        return Vec::new();
    }
    runs(line, |line, word, out| read_hex_word(line, word, out).map(|_| Style::Pairs))
}

/// All runs of the line in another notation than hex.
pub(super) fn number_runs(line: &[u8], style: Style) -> Vec<Run> {
    match style {
        Style::Loose => runs(line, |line, word, out| read_loose(&line[word], out).then_some(style)),
        Style::Decimal => runs(line, |line, word, out| read_decimal(line, &word, out).then_some(style)),
        Style::Binary => runs(line, |line, word, out| read_binary(&line[word], out).then_some(style)),
        _ => Vec::new(),
    }
}

/// Collects the runs of the words that `read` accepts; it appends their bytes and says in which notation they are.
fn runs(line: &[u8], read: impl Fn(&[u8], Range<usize>, &mut Vec<u8>) -> Option<Style>) -> Vec<Run> {
    let mut all: Vec<Run> = Vec::new();
    let mut words: Vec<Word> = Vec::new();
    let mut bytes = Vec::new();
    let mut is_open = false;
    let mut at = 0;
    while let Some(word) = next_word(line, at) {
        let separator = at..word.start;
        at = word.end;
        let stamp = stamp_length(line, word.start);
        if stamp > 0 {
            (at, is_open) = (word.start + stamp, false);
            continue;
        }
        bytes.clear();
        let style = read(line, word.clone(), &mut bytes);
        is_open &= style.is_some() && all.last().map(|run| run.style) == style && may_separate(&line[separator.clone()]);
        // `[16 bytes of data]` is a count.
        let is_count = is_open && counts_what_follows(line, &word);
        is_open &= !is_count;
        let Some(style) = style.filter(|_| !is_count) else { continue };
        if !is_open {
            close(line, all.last_mut(), &mut words);
            all.push(Run {
                style,
                text: word.clone(),
                bytes: Vec::new(),
                edges: Vec::new(),
                is_counted: false,
                after_number: None,
            });
            is_open = true;
        }
        let Some(run) = all.last_mut() else { break };
        words.push(Word { separator, first_byte: run.bytes.len(), count: bytes.len() });
        run.bytes.extend_from_slice(&bytes);
        run.text.end = word.end;
    }
    close(line, all.last_mut(), &mut words);
    all
}

/// Finds the edges of a run from its words, which it forgets.
fn close(line: &[u8], run: Option<&mut Run>, words: &mut Vec<Word>) {
    let Some(run) = run else { return };
    let usual = usual_separator(line, words.get(1..).unwrap_or(&[]));
    if let [first, second, ..] = &words[..] {
        let mark = &line[second.separator.clone()];
        let is_apart = usual.as_deref().is_none_or(|usual| !same_separator(mark, usual));
        let closes = mark.iter().any(|b| matches!(b, b')' | b']' | b'}')) && (words.len() == 2 || is_apart);
        let counts = first.count == 1 && counts_bytes(&line[run.text.start..second.separator.start], run.bytes.len() - 1);
        let is_number = first.count <= 2
            && second.count >= first.count
            && match run.style {
                // The request of unit 7 has seven bytes after the unit.
                Style::Pairs => closes || (counts && is_apart && words.len() > 4),
                Style::Decimal => closes && counts,
                _ => false,
            };
        run.after_number = is_number.then_some((first.count, second.separator.end));
        run.is_counted = is_number && counts;
    }
    run.edges.push(0);
    for word in words.drain(..).skip(1) {
        let is_long = word.count >= MIN_WORD_BYTES;
        if is_long || usual.as_deref().is_some_and(|usual| !same_separator(&line[word.separator.clone()], usual)) {
            run.edges.push(word.first_byte);
        }
        if is_long {
            run.edges.push(word.first_byte + word.count);
        }
    }
    run.edges.push(run.bytes.len());
    run.edges.dedup();
}

/// Whether a number says how many bytes follow it.
fn counts_bytes(text: &[u8], bytes: usize) -> bool {
    std::str::from_utf8(text).is_ok_and(|text| text.parse() == Ok(bytes))
}

/// The separator that stands most often in front of these words.
fn usual_separator(line: &[u8], words: &[Word]) -> Option<Vec<u8>> {
    let mut counts: Vec<(&[u8], usize)> = Vec::new();
    for word in words {
        let text = &line[word.separator.clone()];
        match counts.iter().position(|(known, _)| same_separator(known, text)) {
            Some(at) => counts[at].1 += 1,
            None if counts.len() < 8 => counts.push((text, 1)),
            None => {}
        }
    }
    counts.into_iter().rev().max_by_key(|(_, count)| *count).map(|(text, _)| text.to_vec())
}

/// Whether two separators are equal but for the number of their blanks.
fn same_separator(one: &[u8], other: &[u8]) -> bool {
    let marks = |text: &[u8]| text.iter().copied().filter(|b| !matches!(b, b' ' | b'\t')).collect::<Vec<u8>>();
    one == other || marks(one) == marks(other)
}

/// The next word from `at` on: letters and digits.
fn next_word(line: &[u8], at: usize) -> Option<Range<usize>> {
    let start = at + line.get(at..)?.iter().position(u8::is_ascii_alphanumeric)?;
    // The mark of hex in IEC 61131 and in Basic: `16#01`, `&H01`.
    let behind = line[start..].strip_prefix(b"16#").filter(|rest| rest.first().is_some_and(u8::is_ascii_hexdigit));
    let is_basic =
        start > at && line[start - 1] == b'&' && matches!(line[start..], [b'H' | b'h', digit, ..] if digit.is_ascii_hexdigit());
    let start = behind.map_or(start + usize::from(is_basic), |rest| line.len() - rest.len());
    let length = line[start..].iter().take_while(|b| b.is_ascii_alphanumeric()).count();
    Some(start..start + length)
}

/// Whether the text between two words may separate bytes of one run. Dots stand for bytes that were not printed; a colon with
/// a blank, an arrow and an equals sign end what is in front of bytes.
fn may_separate(text: &[u8]) -> bool {
    let are_dots = text.windows(3).any(|three| three == b"..." || three == "\u{2026}".as_bytes());
    let is_sign = |sign: &[u8]| text.windows(sign.len()).any(|part| part == sign);
    let ends_front = text.contains(&b'=') || [&b": "[..], b":\t", b">>", b"<<", b"->", b"<-"].into_iter().any(is_sign);
    !are_dots && !ends_front && (text.len() <= MAX_SEPARATOR_CHARS || (text.len() <= MAX_BLANKS && text.trim_ascii().is_empty()))
}

/// Reads a word of hex digits: pairs, `0x5`, `0x0503`, `0x050x03`, `x05`, `05h`.
fn read_hex_word(line: &[u8], word: Range<usize>, out: &mut Vec<u8>) -> Option<Style> {
    let text = &line[word];
    if let [b'0', b'x' | b'X', digits @ ..] = text {
        return read_prefixed(text, digits, out).then_some(Style::Prefixed);
    }
    match text {
        [b'x' | b'X', digits @ ..] if digits.len() == 2 => decode_pairs(digits, out).then_some(Style::Prefixed),
        [b'0', digits @ .., b'h' | b'H'] if digits.len() == 2 => decode_pairs(digits, out).then_some(Style::Suffixed),
        [digits @ .., b'h' | b'H'] if matches!(digits.len(), 1 | 2) => read_loose(digits, out).then_some(Style::Suffixed),
        _ => (text.len().is_multiple_of(2) && decode_pairs(text, out)).then_some(Style::Pairs),
    }
}

/// Reads the digits after `0x`, and further bytes with `0x` that follow without a separator.
fn read_prefixed(text: &[u8], digits: &[u8], out: &mut Vec<u8>) -> bool {
    match digits.len() {
        1 => read_loose(digits, out),
        length if length.is_multiple_of(2) && decode_pairs(digits, out) => true,
        _ => {
            let before = out.len();
            let is_glued = text.len().is_multiple_of(4)
                && text.chunks(4).all(|four| matches!(four, [b'0', b'x' | b'X', high, low] if decode_pairs(&[*high, *low], out)));
            if !is_glued {
                out.truncate(before);
            }
            is_glued
        }
    }
}

/// Reads one or two hex digits.
fn read_loose(text: &[u8], out: &mut Vec<u8>) -> bool {
    match text.len() {
        1 => {
            let value = digit_at(text, 0);
            if value != INVALID_DIGIT {
                out.push(value);
            }
            value != INVALID_DIGIT
        }
        2 => decode_pairs(text, out),
        _ => false,
    }
}

/// Reads a decimal number from -128 to 255; a minus after a digit is a separator.
fn read_decimal(line: &[u8], word: &Range<usize>, out: &mut Vec<u8>) -> bool {
    let text = &line[word.clone()];
    if text.len() > 3 || !text.iter().all(u8::is_ascii_digit) {
        return false;
    }
    let value = text.iter().fold(0i32, |value, b| value * 10 + i32::from(b - b'0'));
    let front = &line[..word.start];
    let may_be_before = |b: &u8| matches!(b, b' ' | b'\t' | b',' | b';' | b':' | b'=' | b'[' | b'(' | b'{');
    let is_negative = front.ends_with(b"-") && front[..front.len() - 1].last().is_none_or(may_be_before);
    let value = if is_negative { -value } else { value };
    let is_byte = (-128..256).contains(&value);
    if is_byte {
        out.push((value & 0xFF) as u8);
    }
    is_byte
}

/// Reads eight binary digits.
fn read_binary(text: &[u8], out: &mut Vec<u8>) -> bool {
    let is_byte = text.len() == 8 && text.iter().all(|b| matches!(b, b'0' | b'1'));
    if is_byte {
        out.push(text.iter().fold(0, |value, b| value << 1 | (b - b'0')));
    }
    is_byte
}
