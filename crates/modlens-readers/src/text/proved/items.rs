//! Joins frames that are listed a byte a line, each after its place: `00: 02`, `data[3] = 17`, `[0] 01`.
//!
//! A line of a list ends with a place that is one more than that of the line before, and a byte in hex, decimal or binary; a
//! few other lines may be between. A list is a frame if its bytes end with their CRC in one of these notations and have the layout of a function.

use crate::chunk::Side;
use crate::text::proved::frames::fits_known_function;
use crate::text::proved::pieces::Piece;
use crate::text::proved::sender::sender;
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::functions::EXCEPTION_BIT;

/// The fewest and the most bytes of an RTU frame with a function (serial line specification, 2.5.1).
const FRAME_BYTES: std::ops::RangeInclusive<usize> = 5..=256;

/// How many other lines may be between two of a list.
const MAX_LINES_BETWEEN: u64 = 8;

/// The most characters of a line of a list, and between place and byte.
const MAX_LINE_CHARS: usize = 120;
const MAX_SEPARATOR_CHARS: usize = 6;

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
                self.title = sender(line);
            }
            return None;
        };
        let is_far = self.lines.last().is_some_and(|(last, _)| last.number + MAX_LINES_BETWEEN < number);
        if is_far || !follows(self.place, place) || self.lines.len() == *FRAME_BYTES.end() {
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
        let is_frame = bytes.len() == self.lines.len()
            && FRAME_BYTES.contains(&bytes.len())
            && crc_valid(&bytes)
            && bytes[1] & !EXCEPTION_BIT != 0
            && fits_known_function(&bytes[1..bytes.len() - 2]);
        is_frame.then_some(bytes)
    }
}

/// Whether a place comes next after another in one of its readings.
fn follows(before: Place, place: Place) -> bool {
    let next = |(before, place): (Option<u32>, Option<u32>)| before.zip(place).is_some_and(|(one, other)| one + 1 == other);
    before.into_iter().zip(place).any(next)
}

/// The place and the byte of a line, and where the byte begins; `None` for a line of another kind.
fn item(line: &[u8]) -> Option<(Place, usize, Readings)> {
    if line.len() > MAX_LINE_CHARS {
        return None;
    }
    let mut words = line.chunk_by(|one, other| one.is_ascii_alphanumeric() == other.is_ascii_alphanumeric());
    let mut parts: Vec<(usize, &[u8])> = Vec::new();
    let mut at = 0;
    for word in words.by_ref() {
        if word[0].is_ascii_alphanumeric() {
            parts.push((at, word));
        }
        at += word.len();
    }
    let [.., (place_at, place), (start, byte)] = &parts[..] else { return None };
    let separator = &line[place_at + place.len()..*start];
    let place = number(place);
    (separator.len() <= MAX_SEPARATOR_CHARS && place != [None; 2])
        .then(|| (place, *start, readings(byte)))
        .filter(|(.., readings)| *readings != [None; 3])
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
    let hex = text.strip_prefix("0x").unwrap_or(text);
    let parsed = |text: &str, lengths: std::ops::RangeInclusive<usize>, radix| {
        lengths.contains(&text.len()).then(|| u8::from_str_radix(text, radix).ok()).flatten()
    };
    [parsed(hex, 1..=2, 16), parsed(text, 1..=3, 10), parsed(text, 8..=8, 2)]
}
