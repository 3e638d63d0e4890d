//! Bytes found in a line: the frames of its runs, and what is beside them.

use std::ops::Range;

use crate::chunk::Side;
use crate::text::proved::line_runs::hex_bytes;
use crate::text::proved::runs::{Run, Style};
use crate::text::proved::sender::sender;
use crate::text::proved::shapes::{shape, Shape};
use modlens_protocol::checksum::crc_valid;

/// A run of so many bytes beside a frame is listed, although nothing proves it.
pub(super) const MIN_LISTED_BYTES: usize = 3;

/// So many bytes in front of a frame or after it, which nothing but the notation ties to it, were on the line as well.
pub(super) const MIN_NEIGHBOUR_BYTES: usize = 4;

/// A date and a time with a fraction of a second have at most so many pairs of digits.
const MAX_DATE_BYTES: usize = 10;

/// What the bytes found in a line are worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::text) enum Worth {
    /// A frame that a checksum or a length proves.
    Frame,
    /// Bytes where other lines of the log have frames.
    LikeFrames,
    /// Bytes beside a frame, which are not delivered.
    Beside,
}

/// Bytes found in a line.
#[derive(Clone, Debug)]
pub(in crate::text) struct Found {
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

/// What the runs with their frames give, in the order of the line.
pub(super) fn with_fronts(line: &[u8], start: usize, runs: &[(Run, Vec<Range<usize>>)]) -> Vec<Found> {
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
            for (range, worth) in parts(line, run, frames) {
                all.push(found(line, front.clone(), run.bytes[range].to_vec(), shape, worth));
            }
        }
        from = run.text.end;
    }
    all
}

/// The parts of a run in this line: its frames, and the bytes between them.
fn parts(line: &[u8], run: &Run, frames: &[Range<usize>]) -> Vec<(Range<usize>, Worth)> {
    let mut parts = Vec::new();
    let mut at = 0;
    let is_glued = |edge: usize| !run.edges.contains(&edge);
    for (i, frame) in frames.iter().enumerate() {
        let gap = at..frame.start;
        let ties = is_glued(gap.end) && (i == 0 || is_glued(gap.start));
        let is_inside = i > 0 || (!gap.is_empty() && is_no_label(line, run, gap.len()));
        parts.push((gap.clone(), gap_worth(&run.bytes[gap], ties, is_inside)));
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
        _ => {
            let is_inside = !gap.is_empty() && ends_line(line, run, gap.len());
            parts.push((gap.clone(), gap_worth(&run.bytes[gap.clone()], is_glued(gap.start), is_inside)));
        }
    }
    let is_listed = |bytes: &[u8]| bytes.len() >= MIN_LISTED_BYTES && !may_be_date(bytes);
    parts.retain(|(range, worth)| !range.is_empty() && (*worth != Worth::Beside || is_listed(&run.bytes[range.clone()])));
    parts
}

/// Whether a few bytes in front of the first frame of a run cannot be a number of other meaning, such as that of the line or a
/// counter: words and a sign that ends them are in front of them, and they do not count what follows.
fn is_no_label(line: &[u8], run: &Run, count: usize) -> bool {
    let front = line[..run.text.start].trim_ascii_end();
    let is_named = matches!(front, [.., before, b':' | b'=' | b'>'] if before.is_ascii_alphabetic());
    is_hex(run) && is_named && !counts(&run.bytes[..count], run.bytes.len() - count)
}

/// Whether a few bytes after the last frame of a run end the line, and do not count the bytes before them.
fn ends_line(line: &[u8], run: &Run, count: usize) -> bool {
    let (before, last) = run.bytes.split_at(run.bytes.len() - count);
    is_hex(run) && !counts(last, before.len()) && !line[run.text.end..].iter().any(u8::is_ascii_alphanumeric)
}

fn is_hex(run: &Run) -> bool {
    matches!(run.style, Style::Pairs | Style::Prefixed)
}

/// Whether a byte is this number, as hex or as decimal digits, with itself or without.
fn counts(bytes: &[u8], number: usize) -> bool {
    let &[byte] = bytes else { return false };
    let decimal = usize::from(byte >> 4) * 10 + usize::from(byte & 15);
    [usize::from(byte), decimal].iter().any(|count| (number..=number + 1).contains(count))
}

/// Whether so few decimal digits may be a date and a time.
fn may_be_date(bytes: &[u8]) -> bool {
    let is_decimal = bytes.iter().all(|b| b >> 4 < 10 && b & 15 < 10);
    let has_year = |at: usize| bytes.get(at).is_some_and(|century| matches!(century, 0x19 | 0x20));
    is_decimal && (bytes.len() < MIN_NEIGHBOUR_BYTES || (bytes.len() <= MAX_DATE_BYTES && (has_year(0) || has_year(2))))
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
pub(super) fn found(line: &[u8], front: Range<usize>, bytes: Vec<u8>, shape: Option<Shape>, worth: Worth) -> Found {
    Found { earlier: Vec::new(), side: sender(&line[front.clone()]), front, bytes, shape, worth, lacks_checksum: false }
}
