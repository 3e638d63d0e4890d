//! Reads the frames in lines that no dialect knows: any run of bytes that a checksum or an MBAP header proves, whatever words,
//! quotes, arrows, brackets or counters are around it.
//!
//! `runs` finds bytes in all notations, `frames` says which of them are frames, `sender` takes the direction from the words in
//! front of them. A line whose text in front of the bytes (`shapes`) was seen in front of frames is read even if its bytes
//! prove nothing, because damaged frames are what people look for. `pieces` joins frames that are printed over several lines,
//! `listing` those that are printed a field a line, `items` those with the place of each byte in front of it, `characters` those
//! of ASCII with a character a line. `labels` learns what stands below lines without bytes.

mod candidates;
mod characters;
mod found;
mod frames;
mod items;
mod kinds;
mod labels;
mod line_runs;
mod listing;
mod pieces;
mod runs;
mod sender;
mod shapes;
mod statements;

use std::ops::Range;

use crate::chunk::Side;
use crate::text::frame_evidence::has_frame_layout;
use candidates::{candidates, fronts, mentions};
use characters::Characters;
use found::{found, with_fronts, MIN_LISTED_BYTES, MIN_NEIGHBOUR_BYTES};
use items::Items;
use labels::Labels;
use line_runs::{damaged_ascii_runs, part_end, proved_runs, shifted, style_of_frames};
use listing::Listing;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use pieces::{Piece, Pieces};
use runs::{hex_runs, number_runs, Run, Style};
use shapes::{any_shape, shape, Shape, Shapes};
use statements::Statements;

pub(super) use candidates::{is_column, other_hex, rest_of, MIN_REST_BYTES};
pub(super) use found::{Found, Worth};
pub(super) use items::{byte_of_line, is_byte_line};
pub(super) use line_runs::{
    hex_beside_dates, hex_bytes, hex_front, is_words, longest_hex, named_digits, only_hex, single_bytes, single_digits,
};
pub(super) use sender::{denies, ends_with_index, label_of_remark, sender, sender_below};

/// What the lines so far have shown.
#[derive(Clone, Debug, Default)]
pub(super) struct ProvedHex {
    shapes: Shapes,
    statements: Statements,
    pieces: Pieces,
    listing: Listing,
    items: Items,
    characters: Characters,
    labels: Labels,
    /// The text holds a frame of Modbus ASCII.
    has_ascii: bool,
}

impl ProvedHex {
    /// Takes over the shapes that another reader of the same text has learned.
    pub fn learn_from(&mut self, other: &Self) {
        self.shapes = other.shapes.clone();
    }

    /// Who sent the bytes after this text, as far as the text of the whole log shows it.
    pub fn learned_sender(&self, front: &[u8]) -> Option<Side> {
        self.statements.side(any_shape(front, Style::Pairs))
    }

    /// Whether the text has one line of this statement and no more.
    pub fn is_single(&self, shape: Shape) -> bool {
        self.statements.is_single(shape)
    }

    /// Whether the text has any statement of one line.
    pub fn has_single(&self) -> bool {
        self.statements.has_single()
    }

    /// Whether the line after each one of this statement says the same again, and who sent it.
    pub fn is_told_again(&self, shape: Shape) -> bool {
        self.statements.is_told_again(shape)
    }

    /// Whether this text in front of bytes has a name, so that it may say who sent them.
    pub fn is_label(front: &[u8]) -> bool {
        shape(front, Style::Pairs).is_some()
    }

    /// Learns from the lines at the beginning of a text which statements print frames, and who sent them.
    pub fn learn_statements(&mut self, lines: impl Iterator<Item = Vec<u8>>) {
        let may_hold_bytes = |line: &Vec<u8>| line.iter().filter(|b| b.is_ascii_hexdigit()).count() >= MIN_LISTED_BYTES;
        let mut all = Vec::new();
        for line in lines {
            let found = if may_hold_bytes(&line) { mentions(&line) } else { Vec::new() };
            self.labels.add(&line, &found);
            self.has_ascii |= found.iter().any(|one| one.is_frame && one.style == Style::Ascii);
            all.extend(found);
        }
        self.statements = Statements::learn(&all);
    }

    /// Who sent the bytes below this label, as the frames below its like show.
    pub fn learned_label(&self, text: &[u8]) -> Option<Side> {
        self.labels.side(text)
    }

    /// How many requests without checksum are followed by a response that fits, of how many.
    pub fn exchanges(&self) -> (usize, usize) {
        self.statements.exchanges
    }

    /// Finds the bytes of frames in a line; `number` is that of the line.
    pub fn read(&mut self, line: &[u8], number: u64) -> Vec<Found> {
        if let Some((fields, side)) = self.listing.add(line, number) {
            return vec![listed(fields, side, number)];
        }
        if let Some((lines, side)) = self.items.add(line, number) {
            return vec![listed(lines, side, number)];
        }
        if let Some((lines, side)) = self.characters.add(line, number) {
            return vec![listed(lines, side, number)];
        }
        if !line.iter().any(u8::is_ascii_digit) {
            return Vec::new();
        }
        let mut all = Vec::new();
        let mut start = 0;
        while start < line.len() {
            let end = part_end(line, start);
            all.extend(self.read_part(&line[..end], start, number));
            start = end;
        }
        all
    }

    /// Reads the line from `start` on.
    fn read_part(&mut self, line: &[u8], start: usize, number: u64) -> Vec<Found> {
        let proved = proved_runs(line, start);
        if !proved.is_empty() {
            let style = style_of_frames(&proved);
            let mut found = with_fronts(line, start, &proved);
            for one in found.iter_mut().filter(|one| one.worth == Worth::Frame) {
                self.shapes.add(one.shape);
                one.side = one.side.or_else(|| self.statements.side(any_shape(&line[one.front.clone()], style)));
            }
            return found;
        }
        let damaged = if self.has_ascii { damaged_ascii_runs(&line[start..]) } else { Vec::new() };
        if !damaged.is_empty() {
            let fronts = fronts(line, start, shifted(damaged, start));
            return fronts.map(|(front, run)| found(line, front, run.bytes, None, Worth::LikeFrames)).collect();
        }
        let known = self.runs_like_frames(line, start);
        if known.is_empty() {
            let hex = shifted(hex_runs(&line[start..]), start);
            let decimal = shifted(number_runs(&line[start..], Style::Decimal), start);
            let decimal: Vec<Run> = decimal.into_iter().map(Run::without_number).filter(is_counted).collect();
            let runs = if decimal.is_empty() { hex } else { decimal };
            return self.complete_pieces(line, start, &runs, number);
        }
        known
    }

    /// The runs that stand where other lines have frames.
    fn runs_like_frames(&self, line: &[u8], start: usize) -> Vec<Found> {
        let found = candidates(line, start).into_iter().map(|runs| {
            let fronts = fronts(line, start, runs);
            fronts.filter_map(|(front, run)| self.run_like_frame(line, front, run)).collect::<Vec<_>>()
        });
        found.into_iter().find(|found| !found.is_empty()).unwrap_or_default()
    }

    /// The bytes of a run that stands where other lines have frames.
    fn run_like_frame(&self, line: &[u8], front: Range<usize>, run: Run) -> Option<Found> {
        let (known, any) = (shape(&line[front.clone()], run.style), any_shape(&line[front.clone()], run.style));
        let is_long = known.is_some() || run.bytes.len() >= MIN_LISTED_BYTES;
        let is_known = self.shapes.contains(known) || (is_long && self.statements.contains(any));
        // A number in front of words, as `000012: Write Request`.
        let is_number = known.is_none() && run.bytes.len() < MIN_NEIGHBOUR_BYTES && is_words(&line[run.text.end..]);
        if !is_known || is_number || !ends_clearly(line, &run) {
            return None;
        }
        let lacks_checksum = self.statements.lacks_checksum(any)
            && has_frame_layout(&run.bytes)
            && run.bytes.get(1).is_some_and(|code| Functions::embedded().row(code & !EXCEPTION_BIT, &run.bytes[2..]).is_some());
        let mut found = found(line, front, run.bytes, Some(any), Worth::LikeFrames);
        found.side = found.side.or_else(|| self.statements.side(any));
        found.lacks_checksum = lacks_checksum;
        Some(found)
    }

    /// Adds the longest run of the line to those of the lines before it. Returns the blocks of a frame that it completes.
    fn complete_pieces(&mut self, line: &[u8], start: usize, hex: &[Run], number: u64) -> Vec<Found> {
        let Some(run) = hex.iter().max_by_key(|run| (run.bytes.len(), run.style != Style::Pairs, run.text.start)) else {
            return Vec::new();
        };
        let Some(shape) = shape(&line[start..run.text.start], run.style).filter(|_| line.len() < 1000) else { return Vec::new() };
        let piece = Piece { number, line: line.to_vec(), start: run.text.start, bytes: run.bytes.clone() };
        let Some(pieces) = self.pieces.add(shape, piece) else { return Vec::new() };
        self.shapes.add(Some(shape));
        let found = |piece: Piece| Found {
            front: 0..piece.start,
            bytes: piece.bytes,
            side: sender(&piece.line[..piece.start]),
            shape: Some(shape),
            worth: Worth::LikeFrames,
            lacks_checksum: false,
            earlier: if piece.number == number { Vec::new() } else { vec![(piece.number, piece.line)] },
        };
        pieces.into_iter().map(found).collect()
    }
}

/// Whether numbers have one in front that counts them, so that they are bytes: `Buffer(3) [1, 131, 2]`.
fn is_counted(run: &Run) -> bool {
    run.is_counted
}

/// A frame that was listed in these fields, the last of which is in line `number`.
fn listed(fields: Vec<Piece>, side: Option<Side>, number: u64) -> Found {
    Found {
        front: 0..fields.first().map_or(0, |field| field.start),
        bytes: fields.iter().flat_map(|field| field.bytes.iter().copied()).collect(),
        side,
        shape: None,
        worth: Worth::Frame,
        lacks_checksum: false,
        earlier: fields.into_iter().filter(|field| field.number != number).map(|field| (field.number, field.line)).collect(),
    }
}

/// Finds the frames that are in a line from `start` on.
pub(super) fn read_frames(line: &[u8], start: usize) -> Vec<Found> {
    let end = part_end(line, start);
    with_fronts(line, start, &proved_runs(&line[..end], start))
}

/// Whether nothing that continues a word or a number follows the run.
fn ends_clearly(line: &[u8], run: &Run) -> bool {
    let behind = &line[run.text.end..];
    let text = behind.trim_ascii_start();
    run.bytes.len() >= MIN_NEIGHBOUR_BYTES || text.first().is_none_or(|b| !b.is_ascii_alphanumeric() && !matches!(b, b'.' | b'%'))
}
