//! Joins frames that are listed a byte a line, alone or each after its place: `0x02,`, `00: 02`, `data[3] = 17`, `[0] 01`.
//!
//! A line of a list ends with a place that is one more than that of the line before, and a byte in hex, decimal or binary; a
//! few other lines may be between. A list is a frame if its bytes end with their CRC in one of these notations, or are characters of Modbus ASCII
//! with their LRC, and have the layout of a function.

use crate::chunk::Side;
use crate::text::proved::frames::{is_checked_ascii, is_checked_frame};
use crate::text::proved::pieces::Piece;
use crate::text::proved::sender::{sender, sender_below};

/// The most bytes of a frame in RTU, and characters of one in ASCII (serial line specification, 2.5.1 and 2.5.2).
const MAX_FRAME_BYTES: usize = 513;

/// How many other lines may be between two of a list.
const MAX_LINES_BETWEEN: u64 = 8;

/// The most characters of a line of a list, and between place and byte.
const MAX_LINE_CHARS: usize = 120;
const MAX_SEPARATOR_CHARS: usize = 6;

/// The most characters of a line that holds a byte and nothing else.
const MAX_ALONE_CHARS: usize = 24;

/// Types of variables that hold a byte, which stand between the place and the byte.
const TYPES: [&str; 4] = ["byte", "usint", "uint8", "char"];

/// A byte as hex, decimal and binary digits; `None` where they are none.
type Readings = [Option<u8>; 3];

/// A place as decimal and as hex digits.
type Place = [Option<u32>; 2];

/// The lines of a list so far, and who sent it.
#[derive(Clone, Debug, Default)]
pub(super) struct Items {
    lines: Vec<(Piece, Readings)>,
    place: Place,
    side: Option<Side>,
    /// Who sent what follows, by the words of the last line that was no item.
    title: Option<Side>,
}

impl Items {
    /// Adds a line. Returns the lines of the frame that is complete with it, and who sent it, if there is one.
    pub fn add(&mut self, line: &[u8], number: u64) -> Option<(Vec<Piece>, Option<Side>)> {
        let Some((place, start, readings)) = item(line) else {
            if !line.trim_ascii().is_empty() {
                self.title = sender_below(line);
                // Without places, nothing else shows what belongs together.
                if self.place == [None; 2] {
                    self.lines.clear();
                }
            }
            return None;
        };
        let is_far = self.lines.last().is_some_and(|(last, _)| last.number + MAX_LINES_BETWEEN < number);
        if is_far || !follows(self.place, place) || self.lines.len() == MAX_FRAME_BYTES {
            self.lines.clear();
            self.side = self.title.take().or_else(|| sender(&line[..start]));
        }
        self.place = place;
        self.lines.push((Piece { number, line: line.to_vec(), start, bytes: Vec::new() }, readings));
        let bytes = (0..readings.len()).find_map(|notation| self.frame(notation))?;
        let lines = self.lines.drain(..).zip(bytes);
        Some((lines.map(|((piece, _), byte)| Piece { bytes: vec![byte], ..piece }).collect(), self.side))
    }

    /// The bytes of the list in this notation, if they are a frame.
    fn frame(&self, notation: usize) -> Option<Vec<u8>> {
        let bytes: Vec<u8> = self.lines.iter().map_while(|(_, readings)| readings[notation]).collect();
        let is_frame = || is_checked_frame(&bytes) || is_checked_ascii(&bytes);
        (bytes.len() == self.lines.len() && is_frame()).then_some(bytes)
    }
}

/// Whether a place comes next after another in one of its readings.
fn follows(before: Place, place: Place) -> bool {
    let next = |(before, place): (Option<u32>, Option<u32>)| before.zip(place).is_some_and(|(one, other)| one + 1 == other);
    (before == place && place == [None; 2]) || before.into_iter().zip(place).any(next)
}

/// The place and the byte of a line, and where the byte begins; the place is missing where the byte is all that is in the line,
/// as `0x01,`. `None` for a line of another kind.
fn item(line: &[u8]) -> Option<(Place, usize, Readings)> {
    if line.len() > MAX_LINE_CHARS {
        return None;
    }
    let words = line.chunk_by(|one, other| one.is_ascii_alphanumeric() == other.is_ascii_alphanumeric());
    let mut parts: Vec<(usize, &[u8])> = Vec::new();
    let mut at = 0;
    for word in words {
        // The mark of hex in IEC 61131, and the type of a variable.
        let is_mark = word == b"16" && line.get(at + 2) == Some(&b'#');
        if word[0].is_ascii_alphanumeric() && !is_mark && !TYPES.iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes())) {
            parts.push((at, word));
        }
        at += word.len();
    }
    if let [(start, byte)] = parts[..] {
        let is_alone = line.len() <= MAX_ALONE_CHARS && parts.len() == 1;
        let readings = readings(byte);
        return (is_alone && readings != [None; 3]).then_some(([None; 2], start, readings));
    }
    let [.., (place_at, place), (start, byte_word)] = parts[..] else { return None };
    let separator = &line[place_at + place.len()..start];
    let marks = separator.iter().filter(|b| !b.is_ascii_alphanumeric()).count();
    let byte = readings(byte_word);
    // Programs print a byte as a decimal and as a hex number: `64 (0x40)`.
    let is_same = separator.contains(&b'(') && byte[0].is_some() && readings(place)[1] == byte[0];
    let place = if is_same { [None; 2] } else { number(place) };
    (marks <= MAX_SEPARATOR_CHARS && (is_same || place != [None; 2]))
        .then_some((place, start, byte))
        .filter(|(.., readings)| *readings != [None; 3])
}

/// Whether a line holds nothing but a byte, perhaps after its place or a name: `0x01,`, `[3] 17`, `buf = 0x6`.
pub(in crate::text) fn is_byte_line(line: &[u8]) -> bool {
    let is_named = || {
        let start = memchr::memmem::rfind(line, b"0x").filter(|&at| at > 0 && line[..at].trim_ascii_end().ends_with(b"="));
        let digits = start.map(|at| line[at + 2..].trim_ascii().len());
        start.is_some_and(|at| line[at + 2..].trim_ascii().iter().all(u8::is_ascii_hexdigit)) && matches!(digits, Some(1 | 2))
    };
    line.len() <= MAX_LINE_CHARS && (item(line).is_some() || is_named())
}

/// The byte of a line that holds nothing else, where its notation is beyond doubt: `0x01,`, `64 (0x40)`.
pub(in crate::text) fn byte_of_line(line: &[u8]) -> Option<u8> {
    let last = line.windows(2).rposition(|two| two.eq_ignore_ascii_case(b"0x"))?;
    let (_, start, [byte, ..]) = item(line)?;
    byte.filter(|_| start == last)
}

/// A word of digits as a decimal and as a hex number.
fn number(word: &[u8]) -> Place {
    let text = std::str::from_utf8(word).unwrap_or_default();
    let text = text.strip_prefix("0x").unwrap_or(text);
    if text.len() > 4 {
        return [None; 2];
    }
    [text.parse().ok(), u32::from_str_radix(text, 16).ok()]
}

/// A word as a byte in each notation.
fn readings(word: &[u8]) -> Readings {
    let text = std::str::from_utf8(word).unwrap_or_default();
    let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text);
    let parsed = |text: &str, lengths: std::ops::RangeInclusive<usize>, radix| {
        lengths.contains(&text.len()).then(|| u8::from_str_radix(text, radix).ok()).flatten()
    };
    [parsed(hex, 1..=2, 16), parsed(text, 1..=3, 10), parsed(text, 8..=8, 2)]
}
