//! Runs of hex in a line that no checksum proves: what other lines of the log may prove, and what is counted as left.

use std::ops::Range;

use crate::text::proved::found::{found, with_fronts, Found, Worth, MIN_LISTED_BYTES};
use crate::text::proved::kinds::Mention;
use crate::text::proved::line_runs::{escaped_runs, hex_bytes, is_other_text, part_end, proved_runs, shifted, style_of_frames};
use crate::text::proved::runs::{hex_runs, number_runs, Run, Style};
use crate::text::proved::sender::sender;
use crate::text::proved::shapes::{any_shape, label};

/// The hex in a line from `start` on of which nothing is known.
pub(in crate::text) fn other_hex(line: &[u8], start: usize) -> Vec<Found> {
    let end = part_end(line, start);
    let runs = shifted(hex_runs(&line[start..end]), start);
    let runs = runs.into_iter().filter(|run| hex_bytes(&line[run.text.clone()]) > 0 && !is_other_text(line, &run.text));
    runs.map(|run| found(line, start..run.text.start, run.bytes, None, Worth::Beside)).collect()
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
    fronts.filter(|(_, run)| !is_other_text(line, &run.text))
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
