//! Reads the frames in lines that no dialect knows: any run of bytes that a checksum or an MBAP header proves, whatever words,
//! quotes, arrows, brackets or counters stand around it.
//!
//! `runs` finds bytes in all notations, `frames` says which of them are frames, `sender` takes the direction from the words in
//! front of them. A line whose text in front of the bytes (`shapes`) was seen in front of frames is read even if its bytes
//! prove nothing, because damaged frames are what people look for. `pieces` joins frames that are printed over several lines,
//! `listing` those that are printed a field a line.

mod frames;
mod listing;
mod pieces;
mod runs;
mod sender;
mod shapes;

use std::ops::Range;

use crate::chunk::Side;
use crate::text::notation::{Notation, NotationFlags};
use listing::Listing;
use modlens_protocol::checksum::lrc;
use modlens_protocol::hex::decode_pairs;
use pieces::{Piece, Pieces};
use runs::{hex_runs, number_runs, Run, Style};
use shapes::{shape, Shape, Shapes};

pub(super) use sender::sender;

/// Longer lines are read in parts of this length.
const MAX_PART_CHARS: usize = 1 << 15;

/// A run of so many bytes beside a frame is listed, although nothing proves it.
const MIN_LISTED_BYTES: usize = 3;

/// So many bytes in front of a frame or behind it, which nothing but the notation ties to it, were on the line, too.
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
    /// The lines on which they stand before the current one: numbers and texts.
    pub earlier: Vec<(u64, Vec<u8>)>,
    /// Where the text in front of them begins and ends: from the bytes before to these.
    pub front: Range<usize>,
    pub bytes: Vec<u8>,
    pub side: Option<Side>,
    pub shape: Option<Shape>,
    pub worth: Worth,
}

/// What the lines so far have shown.
#[derive(Clone, Debug, Default)]
pub(super) struct ProvedHex {
    shapes: Shapes,
    pieces: Pieces,
    listing: Listing,
}

impl ProvedHex {
    /// Takes over the shapes that another reader of the same text has learned.
    pub fn learn_from(&mut self, other: &Self) {
        self.shapes = other.shapes.clone();
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
            let found = with_fronts(line, start, &proved);
            for one in found.iter().filter(|one| one.worth == Worth::Frame) {
                self.shapes.add(one.shape);
            }
            return found;
        }
        let hex = shifted(hex_runs(&line[start..]), start);
        let known = self.runs_like_frames(line, start, &hex);
        if known.is_empty() {
            return self.complete_pieces(line, start, &hex, number);
        }
        known
    }

    /// The runs that stand where other lines have frames.
    fn runs_like_frames(&self, line: &[u8], start: usize, hex: &[Run]) -> Vec<Found> {
        let numbers = [Style::Loose, Style::Decimal].map(|style| shifted(number_runs(&line[start..], style), start));
        for runs in [hex, &numbers[0], &numbers[1]] {
            let mut found = Vec::new();
            let mut from = start;
            for run in runs {
                let shape = shape(&line[from..run.text.start], run.style);
                if self.shapes.contains(shape) && ends_clearly(line, run) {
                    found.push(self::found(line, from..run.text.start, run.bytes.clone(), shape, Worth::LikeFrames));
                }
                if !found.is_empty() || run.bytes.len() >= MIN_LISTED_BYTES {
                    from = run.text.end;
                }
            }
            if !found.is_empty() {
                return found;
            }
        }
        Vec::new()
    }

    /// Adds the longest run of the line to those of the lines before it. Returns the pieces of a frame that it completes.
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
            earlier: if piece.number == number { Vec::new() } else { vec![(piece.number, piece.line)] },
        };
        pieces.into_iter().map(found).collect()
    }
}

/// A frame that was listed in these fields, the last of which stands in line `number`.
fn listed(fields: Vec<Piece>, side: Option<Side>, number: u64) -> Found {
    Found {
        front: 0..fields.first().map_or(0, |field| field.start),
        bytes: fields.iter().flat_map(|field| field.bytes.iter().copied()).collect(),
        side,
        shape: None,
        worth: Worth::Frame,
        earlier: fields.into_iter().filter(|field| field.number != number).map(|field| (field.number, field.line)).collect(),
    }
}

/// Finds the frames that stand in a line from `start` on.
pub(super) fn read_frames(line: &[u8], start: usize) -> Vec<Found> {
    let end = part_end(line, start);
    with_fronts(line, start, &proved_runs(&line[..end], start))
}

/// How many bytes of hex a line holds, but for short runs and for dates and times of day.
pub(super) fn hex_bytes(line: &[u8]) -> usize {
    let part = &line[..part_end(line, 0)];
    let is_time = |text: &[u8]| {
        let has_colons = memchr::memchr_iter(b':', text).nth(1).is_some();
        has_colons && text.iter().all(|b| !b.is_ascii_alphabetic()) && text.len() < 30
    };
    hex_runs(part).iter().filter(|run| run.bytes.len() >= 4 && !is_time(&part[run.text.clone()])).map(|run| run.bytes.len()).sum()
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
fn shifted(mut runs: Vec<Run>, start: usize) -> Vec<Run> {
    for run in &mut runs {
        run.text = run.text.start + start..run.text.end + start;
    }
    runs
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
            runs.push(Run { style: Style::Ascii, text: colon..end, edges: Vec::new(), bytes });
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
        // Behind the last quote of a line there may be further text, which is no byte.
        let edges = vec![0, bytes.len()];
        runs.push(Run { style: Style::Escaped, text: start..start + length, bytes, edges });
        from = (start + length).max(escape + 1);
    }
    runs
}

/// Whether nothing that continues a word or a number stands behind the run.
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
    parts.push((gap.clone(), gap_worth(&run.bytes[gap.clone()], is_glued(gap.start), false)));
    // What has decimal digits only may be a date.
    let is_listed = |bytes: &[u8]| bytes.len() >= MIN_LISTED_BYTES && bytes.iter().any(|b| b >> 4 > 9 || b & 15 > 9);
    parts.retain(|(range, worth)| !range.is_empty() && (*worth != Worth::Beside || is_listed(&run.bytes[range.clone()])));
    parts
}

/// What bytes beside a frame are worth. They were on the line if the separators are the same, unless they are so few that they
/// may be a number of other meaning. Zeros and FF are what a line driver leaves behind.
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
    Found { earlier: Vec::new(), side: sender(&line[front.clone()]), front, bytes, shape, worth }
}
