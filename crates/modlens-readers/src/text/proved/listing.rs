//! Joins frames that are listed a field a line: `Transaction ID: 0x0001`, `Length: 0006`, `Unit: 01`.
//!
//! A field is a label with letters, a colon or an equals sign, and bytes up to the end of the line or to a remark. Fields that
//! follow one another are a frame if their bytes are an MBAP header, a field ends with its unit, the header announces as many
//! bytes as there are, and the function has such a layout; or if they are an RTU frame with a valid CRC.

use crate::chunk::Side;
use crate::text::proved::frames::{is_checked_frame, is_frame};
use crate::text::proved::line_runs::{only_hex, without_marks};
use crate::text::proved::pieces::Piece;
use crate::text::proved::runs::{hex_runs, Style};
use crate::text::proved::sender::{sender, sender_below};
use modlens_protocol::hex::decode_pairs;
use modlens_protocol::mbap::{announced_length, PREFIX_BYTES};

/// The most lines between two fields of a frame: an empty one.
const MAX_LINES_BETWEEN: u64 = 2;

/// The most fields that are remembered: a frame has up to 260 bytes.
const MAX_FIELDS: usize = 260;

/// The most characters of a line with a field.
const MAX_LINE_CHARS: usize = 1000;

/// The fields since the last line that was none, and what that line reports about them.
#[derive(Clone, Debug, Default)]
pub(super) struct Listing {
    fields: Vec<Piece>,
    /// Who sent the bytes, by the words of the title above them.
    side: Option<Side>,
}

impl Listing {
    /// Adds a line. Returns the fields of the frame that is complete with it, and who sent it, if there is one.
    pub fn add(&mut self, line: &[u8], number: u64) -> Option<(Vec<Piece>, Option<Side>)> {
        let Some((start, bytes)) = field(line).or_else(|| self.further_bytes(line, number)) else {
            if !line.trim_ascii().is_empty() {
                *self = Self { fields: Vec::new(), side: sender_below(line) };
            }
            return None;
        };
        // A whole frame after a label: fields that follow repeat it.
        if is_checked_frame(&bytes) {
            *self = Self { fields: Vec::new(), side: sender(&line[..start]) };
            return None;
        }
        if self.fields.last().is_some_and(|last| last.number + MAX_LINES_BETWEEN < number) || self.fields.len() == MAX_FIELDS {
            *self = Self::default();
        }
        self.fields.push(Piece { number, line: line.to_vec(), start, bytes });
        let fields = self.fields.split_off(self.frame_start().or_else(|| self.checked_start())?);
        self.fields.clear();
        Some((fields, self.side))
    }

    /// The bytes of a line without a name right after two fields and more: the data of a frame, over several lines.
    fn further_bytes(&self, line: &[u8], number: u64) -> Option<(usize, Vec<u8>)> {
        let last = self.fields.last().filter(|last| self.fields.len() > 1 && last.number + 1 == number);
        last.and_then(|_| Some((line.len() - line.trim_ascii_start().len(), only_hex(line)?)))
    }

    /// The first field from which on the bytes are as many as a header there announces, and such a frame.
    fn frame_start(&self) -> Option<usize> {
        let (mut start, mut byte_count) = (None, 0);
        for (first, field) in self.fields.iter().enumerate().rev() {
            byte_count += field.bytes.len();
            let mut header = self.fields[first..].iter().flat_map(|field| field.bytes.iter().copied());
            let header: [u8; PREFIX_BYTES] = std::array::from_fn(|_| header.next().unwrap_or(u8::MAX));
            if announced_length(&header) == Some(byte_count) && is_listed_frame(&self.fields[first..]) {
                start = Some(first);
            }
        }
        start
    }

    /// The first field from which on the bytes are an RTU frame, with its unit and its function each in a field of its own.
    fn checked_start(&self) -> Option<usize> {
        (0..self.fields.len().saturating_sub(2)).find(|&first| {
            let fields = &self.fields[first..];
            let bytes: Vec<u8> = fields.iter().flat_map(|field| field.bytes.iter().copied()).collect();
            fields[0].bytes.len() == 1 && fields[1].bytes.len() == 1 && is_checked_frame(&bytes)
        })
    }
}

/// Whether these fields, of which there are as many bytes as the MBAP header announces, are a frame.
fn is_listed_frame(fields: &[Piece]) -> bool {
    let bytes: Vec<u8> = fields.iter().flat_map(|field| field.bytes.iter().copied()).collect();
    let mut ends = fields.iter().scan(0, |end, field| {
        *end += field.bytes.len();
        Some(*end)
    });
    // Registers in a row never end with a unit, which is one byte; the header may be in one line without it.
    let has_header = fields.first().is_some_and(|field| field.bytes.len() == PREFIX_BYTES);
    (has_header || ends.any(|end| end == PREFIX_BYTES + 1)) && is_frame(&bytes)
}

/// The bytes of a field that begins with them, such as `00 03 Length` or `0x01, // unit`.
fn leading_field(line: &[u8]) -> Option<(usize, Vec<u8>)> {
    let start = line.iter().position(|b| !b.is_ascii_whitespace())?;
    let mut bytes = Vec::new();
    for text in line[start..].split(|b| matches!(b, b' ' | b'\t')) {
        // Words of other scripts are names.
        let word = if text.is_ascii() { without_marks(text) } else { text };
        let digits = word.strip_prefix(b"0x").unwrap_or(word);
        if !word.is_empty() && (digits.len() != 2 || !decode_pairs(digits, &mut bytes)) {
            let is_name = word.len() > 2 && word.iter().all(|b| b.is_ascii_alphabetic() || !b.is_ascii());
            return (is_name && !bytes.is_empty()).then_some((start, bytes));
        }
    }
    // A line of bytes alone is none.
    None
}

/// The bytes of a field, and where they begin in the line; `None` for a line of another kind.
fn field(line: &[u8]) -> Option<(usize, Vec<u8>)> {
    let line = &line[..line.len().min(MAX_LINE_CHARS)];
    let is_mark = |at: usize| matches!(line[at], b':' | b'=') && line.get(at + 1).is_none_or(u8::is_ascii_whitespace);
    if let Some(found) = leading_field(line) {
        return Some(found);
    }
    let mark = (0..line.len()).find(|&at| is_mark(at))?;
    if !line[..mark].iter().any(u8::is_ascii_alphabetic) {
        return None;
    }
    let start = mark + 1 + line[mark + 1..].iter().position(|b| !b.is_ascii_whitespace())?;
    let text = &line[start..];
    let remark = text.iter().position(|b| matches!(b, b'(' | b'[' | b'#' | b';' | b'/' | b'<')).unwrap_or(text.len());
    let text = text[..remark].trim_ascii_end();
    match &hex_runs(text)[..] {
        [run] if run.text == (0..text.len()) && matches!(run.style, Style::Pairs | Style::Prefixed | Style::Suffixed) => {
            Some((start, run.bytes.clone()))
        }
        _ => None,
    }
}
