//! Runs of hex in a line that no checksum proves: what other lines of the log may prove, and what is counted as left.

use std::ops::Range;

use crate::text::proved::runs::{hex_runs, number_runs, Run, Style};
use crate::text::proved::sender::sender;
use crate::text::proved::shapes::{any_shape, label};
use crate::text::proved::statements::Mention;
use crate::text::proved::{
    escaped_runs, found, part_end, proved_runs, shifted, style_of_frames, with_fronts, Found, Worth, MIN_LISTED_BYTES,
};

/// So many words of two hex digits in a line are bytes, whatever stands between them.
const MIN_SCATTERED_BYTES: usize = 8;

/// The hex in a line from `start` on of which nothing is known.
pub(in crate::text) fn other_hex(line: &[u8], start: usize) -> Vec<Found> {
    let end = part_end(line, start);
    let runs = shifted(hex_runs(&line[start..end]), start);
    let runs = runs.into_iter().filter(|run| hex_bytes(&line[run.text.clone()]) > 0);
    runs.map(|run| found(line, start..run.text.start, run.bytes, None, Worth::Beside)).collect()
}

/// How many bytes of hex a line holds, but for short runs, for dates and times of day, and for UUIDs.
pub(in crate::text) fn hex_bytes(line: &[u8]) -> usize {
    let part = &line[..part_end(line, 0)];
    let counts = |run: &Run| run.bytes.len() >= 4 && !is_other_text(&part[run.text.clone()]);
    let count = hex_runs(part).iter().filter(|run| counts(run)).map(|run| run.bytes.len()).sum();
    if count > 0 {
        return count;
    }
    // Bytes with other text between them, such as `00: 02, 01: 02`.
    let words = part.split(u8::is_ascii_whitespace).map(without_marks);
    let words = words.filter(|word| word.len() == 2 && word.iter().all(u8::is_ascii_hexdigit));
    let numbers = number_runs(part, Style::Decimal).into_iter().map(|run| run.bytes.len()).max();
    Some(words.count().max(numbers.unwrap_or(0))).filter(|bytes| *bytes >= MIN_SCATTERED_BYTES).unwrap_or(0)
}

/// A word without the punctuation around it.
fn without_marks(word: &[u8]) -> &[u8] {
    let Some(start) = word.iter().position(u8::is_ascii_alphanumeric) else { return &[] };
    let end = word.iter().rposition(u8::is_ascii_alphanumeric).map_or(start, |last| last + 1);
    &word[start..end]
}

/// Whether a run of digits is a date, a time of day or a UUID.
fn is_other_text(text: &[u8]) -> bool {
    let has_letters = text.iter().any(u8::is_ascii_alphabetic);
    let has_time = memchr::memchr_iter(b':', text).count() == 2;
    let has_year = matches!(text, [b'1' | b'2', b'9' | b'0', _, _, b'-' | b'/' | b'.', ..]);
    let is_uuid = text.len() == 36 && [8, 13, 18, 23].iter().all(|&at| text[at] == b'-');
    is_uuid || (!has_letters && text.len() < 30 && (has_time || has_year))
}

/// The runs of a line with the text in front of each, which begins at the run before unless that is a short one.
pub(super) fn fronts(line: &[u8], start: usize, runs: Vec<Run>) -> impl Iterator<Item = (Range<usize>, Run)> + '_ {
    let mut from = start;
    let fronts = runs.into_iter().map(Run::without_number).map(move |run| {
        let front = from..run.text.start;
        if run.bytes.len() >= MIN_LISTED_BYTES {
            from = run.text.end;
        }
        (front, run)
    });
    fronts.filter(|(_, run)| !is_other_text(&line[run.text.clone()]))
}

/// The runs in a line from `start` on whose bytes other lines may prove, by notation.
pub(super) fn candidates(line: &[u8], start: usize) -> [Vec<Run>; 4] {
    let part = &line[start..];
    let all = [hex_runs(part), escaped_runs(part), number_runs(part, Style::Loose), number_runs(part, Style::Decimal)];
    all.map(|runs| shifted(runs, start))
}

/// All runs in a line that are frames, or may be frames that nothing proves.
pub(super) fn mentions(line: &[u8]) -> Vec<Mention> {
    let part = &line[..part_end(line, 0)];
    let mention = |front: Range<usize>, end: usize, style: Style, bytes: Vec<u8>, is_frame: bool| {
        let ends_line = !part[end..].iter().any(u8::is_ascii_alphanumeric);
        let front = &part[front];
        Mention { shape: any_shape(front, style), side: sender(front), label: label(front), style, bytes, is_frame, ends_line }
    };
    let proved = proved_runs(part, 0);
    if !proved.is_empty() {
        let style = style_of_frames(&proved);
        let end = proved.iter().rfind(|(_, frames)| !frames.is_empty()).map_or(0, |(run, _)| run.text.end);
        let found = with_fronts(part, 0, &proved).into_iter().filter(|one| one.worth == Worth::Frame);
        return found.map(|one| mention(one.front, end, style, one.bytes, true)).collect();
    }
    let all = candidates(part, 0).into_iter().flat_map(|runs| fronts(part, 0, runs));
    all.filter(|(_, run)| run.bytes.len() >= MIN_LISTED_BYTES)
        .map(|(front, run)| mention(front, run.text.end, run.style, run.bytes, false))
        .collect()
}
