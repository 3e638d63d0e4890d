//! Reads the frames in lines that no dialect knows: any run of bytes that a checksum or an MBAP header proves, whatever words,
//! quotes, arrows, brackets or counters are around it.
//!
//! `runs` finds bytes in all notations, `frames` says which of them are frames, `sender` takes the direction from the words in
//! front of them. A line whose text in front of the bytes (`shapes`) was seen in front of frames is read even if its bytes
//! prove nothing, because damaged frames are what people look for. `pieces` joins frames that are printed over several lines,
//! `listing` those that are printed a field a line.

mod candidates;
mod frames;
mod listing;
mod pieces;
mod runs;
mod sender;
mod shapes;
mod statements;

use std::ops::Range;

use crate::chunk::Side;
use crate::text::frame_evidence::has_frame_layout;
use crate::text::notation::{Notation, NotationFlags};
use candidates::{candidates, fronts, mentions};
use listing::Listing;
use modlens_protocol::checksum::{crc_valid, lrc};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::hex::decode_pairs;
use pieces::{Piece, Pieces};
use runs::{hex_runs, number_runs, Run, Style};
use shapes::{any_shape, shape, Shape, Shapes};
use statements::Statements;

pub(super) use candidates::{hex_bytes, other_hex};
pub(super) use sender::sender;

/// Longer lines are read in parts of this length.
const MAX_PART_CHARS: usize = 1 << 15;

/// A run of so many bytes beside a frame is listed, although nothing proves it.
const MIN_LISTED_BYTES: usize = 3;

/// So many bytes in front of a frame or after it, which nothing but the notation ties to it, were on the line as well.
const MIN_NEIGHBOUR_BYTES: usize = 4;

/// The most escaped strings that are read in one line.
const MAX_STRINGS: usize = 16;

/// What the bytes found in a line are worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Worth {
    /// A frame that a checksum or a length proves.
    Frame,
    /// Bytes where other lines of the log have frames.
    LikeFrames,
    /// Bytes beside a frame, which are not delivered.
    Beside,
}

/// Bytes found in a line.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// The lines on which they are before the current one: numbers and texts.
    pub earlier: Vec<(u64, Vec<u8>)>,
    /// Where the text in front of them begins and ends: from the bytes before to these.
    pub front: Range<usize>,
    pub bytes: Vec<u8>,
    pub side: Option<Side>,
    pub shape: Option<Shape>,
    pub worth: Worth,
    /// They are a frame that was printed without its checksum.
    pub lacks_checksum: bool,
}

/// What the lines so far have shown.
#[derive(Clone, Debug, Default)]
pub(super) struct ProvedHex {
    shapes: Shapes,
    statements: Statements,
    pieces: Pieces,
    listing: Listing,
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

    /// Whether this text in front of bytes has a name, so that it may say who sent them.
    pub fn is_label(front: &[u8]) -> bool {
        shape(front, Style::Pairs).is_some()
    }

    /// Learns from the lines at the beginning of a text which statements print frames, and who sent them.
    pub fn learn_statements(&mut self, lines: impl Iterator<Item = Vec<u8>>) {
        let may_hold_bytes = |line: &Vec<u8>| line.iter().filter(|b| b.is_ascii_hexdigit()).count() >= MIN_LISTED_BYTES;
        let mentions = lines.filter(may_hold_bytes).flat_map(|line| mentions(&line));
        self.statements = Statements::learn(&mentions.collect::<Vec<_>>());
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
        let known = self.runs_like_frames(line, start);
        if known.is_empty() {
            return self.complete_pieces(line, start, &shifted(hex_runs(&line[start..]), start), number);
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
        if !is_known || !ends_clearly(line, &run) {
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

/// Where the part of the line that begins at `start` ends: at its end, or at a blank.
fn part_end(line: &[u8], start: usize) -> usize {
    let limit = line.len().min(start + MAX_PART_CHARS);
    if limit == line.len() {
        return limit;
    }
    line[start..limit].iter().rposition(|b| matches!(b, b' ' | b'\t' | b'"' | b'\'')).map_or(limit, |at| start + at + 1)
}

/// The runs with the positions of a line whose text from `start` on was searched.
fn shifted(runs: Vec<Run>, start: usize) -> Vec<Run> {
    runs.into_iter().map(|run| run.shifted(start)).collect()
}

/// The runs of the first notation in which the line holds frames, each with the positions of its frames; runs without a
/// frame stand among them.
fn proved_runs(line: &[u8], start: usize) -> Vec<(Run, Vec<Range<usize>>)> {
    let part = &line[start..];
    let read: [&dyn Fn() -> Vec<Run>; 7] = [
        &|| hex_runs(part),
        &|| ascii_runs(part),
        &|| escaped_runs(part),
        &|| number_runs(part, Style::Decimal).into_iter().filter(|run| is_decimal(part, run)).collect(),
        &|| number_runs(part, Style::Loose),
        &|| number_runs(part, Style::Decimal),
        &|| number_runs(part, Style::Binary),
    ];
    for read in read {
        let proved: Vec<_> = shifted(read(), start)
            .into_iter()
            .map(|run| {
                let frames = if run.style == Style::Ascii { whole(&run) } else { frames::prove(&run.bytes, &run.edges) };
                (run, frames)
            })
            .collect();
        if proved.iter().any(|(_, frames)| !frames.is_empty()) {
            return proved;
        }
    }
    Vec::new()
}

/// The notation of the runs that hold frames.
fn style_of_frames(proved: &[(Run, Vec<Range<usize>>)]) -> Style {
    proved.iter().find(|(_, frames)| !frames.is_empty()).map_or(Style::Pairs, |(run, _)| run.style)
}

/// The position of a frame that is the whole run.
fn whole(run: &Run) -> Vec<Range<usize>> {
    std::iter::once(0..run.bytes.len()).collect()
}

/// Whether the numbers are decimal rather than hex without leading zeros: there are commas, or numbers of three digits.
fn is_decimal(line: &[u8], run: &Run) -> bool {
    let text = &line[run.text.clone()];
    text.contains(&b',')
        || text.chunk_by(|a, b| a.is_ascii_digit() == b.is_ascii_digit()).any(|part| part.len() == 3 && part[0].is_ascii_digit())
}

/// Frames of Modbus ASCII: a colon and pairs of hex digits with a valid LRC and a known layout.
fn ascii_runs(line: &[u8]) -> Vec<Run> {
    let mut runs = Vec::new();
    for colon in memchr::memchr_iter(b':', line) {
        let digits = line[colon + 1..].iter().take_while(|b| b.is_ascii_hexdigit()).count();
        let end = colon + 1 + digits;
        let mut bytes = Vec::new();
        let is_word = !line.get(end).is_some_and(u8::is_ascii_alphanumeric);
        let are_bytes = digits >= 8 && digits.is_multiple_of(2) && decode_pairs(&line[colon + 1..end], &mut bytes);
        if is_word && are_bytes && lrc(&bytes) == 0 && frames::fits_known_function(&bytes[1..bytes.len() - 1]) {
            let bytes = [&line[colon..end], b"\r\n"].concat();
            runs.push(Run::whole(Style::Ascii, colon..end, bytes));
        }
    }
    runs
}

/// Strings with escape sequences, in quotes or up to the end of the line.
fn escaped_runs(line: &[u8]) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut from = 0;
    while let Some(escape) = memchr::memchr(b'\\', &line[from..]).filter(|_| runs.len() < MAX_STRINGS).map(|at| from + at) {
        let quote = line[from..escape].iter().rposition(|b| matches!(b, b'"' | b'\'' | b'`')).map(|at| from + at);
        let start = quote.map_or(escape, |quote| quote + 1);
        let mut bytes = Vec::new();
        let stop = quote.map(|quote| line[quote]);
        let length = Notation::Escaped.read(&line[start..], stop, &mut bytes, &mut NotationFlags::default()).unwrap_or(0);
        // After the last quote of a line there may be further text, which is no byte.
        runs.push(Run::whole(Style::Escaped, start..start + length, bytes));
        from = (start + length).max(escape + 1);
    }
    runs
}

/// Whether nothing that continues a word or a number follows the run.
fn ends_clearly(line: &[u8], run: &Run) -> bool {
    let behind = &line[run.text.end..];
    let text = behind.trim_ascii_start();
    run.bytes.len() >= MIN_NEIGHBOUR_BYTES || text.first().is_none_or(|b| !b.is_ascii_alphanumeric() && !matches!(b, b'.' | b'%'))
}

/// What the runs with their frames give, in the order of the line.
fn with_fronts(line: &[u8], start: usize, runs: &[(Run, Vec<Range<usize>>)]) -> Vec<Found> {
    let mut all: Vec<Found> = Vec::new();
    let mut from = start;
    for (run, frames) in runs {
        let front = from..run.text.start;
        if frames.is_empty() && run.bytes.len() < MIN_LISTED_BYTES {
            continue;
        }
        let shape = shape(&line[front.clone()], run.style);
        if frames.is_empty() {
            if hex_bytes(&line[run.text.clone()]) > 0 {
                all.push(found(line, front, run.bytes.clone(), shape, Worth::Beside));
            }
        } else {
            for (range, worth) in parts(run, frames) {
                all.push(found(line, front.clone(), run.bytes[range].to_vec(), shape, worth));
            }
        }
        from = run.text.end;
    }
    all
}

/// The parts of a run: its frames, and the bytes between them.
fn parts(run: &Run, frames: &[Range<usize>]) -> Vec<(Range<usize>, Worth)> {
    let mut parts = Vec::new();
    let mut at = 0;
    let is_glued = |edge: usize| !run.edges.contains(&edge);
    for (i, frame) in frames.iter().enumerate() {
        let gap = at..frame.start;
        let ties = is_glued(gap.end) && (i == 0 || is_glued(gap.start));
        parts.push((gap.clone(), gap_worth(&run.bytes[gap], ties, i > 0)));
        parts.push((frame.clone(), Worth::Frame));
        at = frame.end;
    }
    let gap = at..run.bytes.len();
    match frames {
        // The header announces fewer bytes than follow: where the frame ends is not for a reader to say.
        [only]
            if *only == (0..at)
                && !gap.is_empty()
                && is_glued(at)
                && run.bytes[0] != b':'
                && !crc_valid(&run.bytes[only.clone()]) =>
        {
            parts = vec![(0..run.bytes.len(), Worth::LikeFrames)];
        }
        _ => parts.push((gap.clone(), gap_worth(&run.bytes[gap.clone()], is_glued(gap.start), false))),
    }
    // What has decimal digits only may be a date.
    let is_listed = |bytes: &[u8]| bytes.len() >= MIN_LISTED_BYTES && bytes.iter().any(|b| b >> 4 > 9 || b & 15 > 9);
    parts.retain(|(range, worth)| !range.is_empty() && (*worth != Worth::Beside || is_listed(&run.bytes[range.clone()])));
    parts
}

/// What bytes beside a frame are worth. They were on the line if the separators are the same, unless they are so few that they
/// may be a number of other meaning. Zeros and FF are what a line driver leaves.
fn gap_worth(bytes: &[u8], same_separators: bool, is_between: bool) -> Worth {
    let is_glitch = bytes.iter().all(|b| matches!(b, 0 | 0xFF));
    let were_on_line = same_separators && (is_between || is_glitch || bytes.len() >= MIN_NEIGHBOUR_BYTES);
    if were_on_line {
        Worth::LikeFrames
    } else {
        Worth::Beside
    }
}

/// Bytes of the current line.
fn found(line: &[u8], front: Range<usize>, bytes: Vec<u8>, shape: Option<Shape>, worth: Worth) -> Found {
    Found { earlier: Vec::new(), side: sender(&line[front.clone()]), front, bytes, shape, worth, lacks_checksum: false }
}
