//! Bytes found in a line: the frames of its runs, and what is beside them.

use std::ops::Range;

use crate::chunk::Side;
use crate::text::proved::line_runs::hex_bytes;
use crate::text::proved::runs::Run;
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
    let is_listed = |bytes: &[u8]| bytes.len() >= MIN_LISTED_BYTES && !may_be_date(bytes);
    parts.retain(|(range, worth)| !range.is_empty() && (*worth != Worth::Beside || is_listed(&run.bytes[range.clone()])));
    parts
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
