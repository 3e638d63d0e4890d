//! Joins a frame of Modbus ASCII whose characters are printed one a line: `:`, `0`, `1`, alone or each after the same words.

use crate::chunk::Side;
use crate::text::proved::frames::is_checked_ascii;
use crate::text::proved::pieces::Piece;
use crate::text::proved::sender::{sender, sender_below};

/// The most characters of a frame without its line end (serial line specification, 2.5.2).
const MAX_CHARACTERS: usize = 511;

/// The most characters of a line, and the most lines between two of a frame: a program prints blank ones.
const MAX_LINE_CHARS: usize = 60;
const MAX_LINES_BETWEEN: u64 = 2;

/// The characters of a frame so far, and who sent it.
#[derive(Clone, Debug, Default)]
pub(super) struct Characters {
    lines: Vec<Piece>,
    side: Option<Side>,
    /// Who sends what follows, by the words of the last line that was no character.
    title: Option<Side>,
}

impl Characters {
    /// Adds a line. Returns the lines of the frame that is complete with it, and who sent it, if there is one.
    pub fn add(&mut self, line: &[u8], number: u64) -> Option<(Vec<Piece>, Option<Side>)> {
        let Some((start, character)) = character(line) else {
            if !line.trim_ascii().is_empty() {
                self.title = sender_below(line);
                self.lines.clear();
            }
            return None;
        };
        if character == b':' {
            self.lines.clear();
            self.side = self.title.or_else(|| sender(&line[..start]));
        }
        let is_near = self.lines.last().is_none_or(|last| number <= last.number + MAX_LINES_BETWEEN + 1);
        let is_next = character == b':' || (!self.lines.is_empty() && is_near && self.lines.len() < MAX_CHARACTERS);
        if !is_next {
            self.lines.clear();
            return None;
        }
        self.lines.push(Piece { number, line: line.to_vec(), start, bytes: vec![character] });
        let bytes: Vec<u8> = self.lines.iter().flat_map(|piece| piece.bytes.iter().copied()).collect();
        if !is_checked_ascii(&bytes) {
            return None;
        }
        if let Some(last) = self.lines.last_mut() {
            last.bytes.extend_from_slice(b"\r\n");
        }
        Some((std::mem::take(&mut self.lines), self.side))
    }
}

/// The character of a frame that is all that a line holds after a blank, perhaps in quotes, and its place.
fn character(line: &[u8]) -> Option<(usize, u8)> {
    let text = line.trim_ascii_end();
    let (text, quote) = match text {
        [inside @ .., quote @ (b'\'' | b'"')] => (inside, Some(*quote)),
        _ => (text, None),
    };
    let (&last, front) = text.split_last()?;
    let front = match quote {
        Some(quote) => front.strip_suffix(&[quote])?,
        None => front,
    };
    let is_apart = quote.is_some() || front.last().is_none_or(u8::is_ascii_whitespace);
    let is_of_frame = last == b':' || last.is_ascii_hexdigit();
    (is_apart && is_of_frame && line.len() <= MAX_LINE_CHARS).then_some((text.len() - 1, last))
}
