//! Runs of hex in a line that no checksum proves: what other lines of the log may prove, and what is counted as left.

use std::ops::Range;

use crate::text::proved::found::{found, with_fronts, Found, Worth, MIN_LISTED_BYTES};
use crate::text::proved::kinds::Mention;
use crate::text::proved::line_runs::{
    decimal_lists, escaped_runs, escaped_strings, hex_bytes, is_other_text, part_end, proved_runs, shifted, style_of_frames,
};
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

/// Fewer bytes are a number of other meaning.
pub(in crate::text) const MIN_REST_BYTES: usize = 4;

/// The hex in a line that is not among the bytes which are known of it, each of which stands for one place in the line.
pub(in crate::text) fn rest_of(line: &[u8], known: &[Vec<u8>]) -> Vec<(Range<usize>, Vec<u8>)> {
    let mut known: Vec<&[u8]> = known.iter().map(Vec::as_slice).filter(|bytes| !bytes.is_empty()).collect();
    known.sort_by_key(|bytes| std::cmp::Reverse(bytes.len()));
    let part = &line[..part_end(line, 0)];
    let is_hex = |run: &Run| hex_bytes(&line[run.text.clone()]) > 0 && !is_other_text(line, &run.text);
    let hex = hex_runs(part).into_iter().filter(is_hex);
    let runs =
        hex.chain(decimal_lists(part)).chain(escaped_strings(part).filter(|run| has_escaped_byte(&line[run.text.clone()])));
    let binary = number_runs(part, Style::Binary);
    let mut rest = Vec::new();
    for run in runs {
        // Eight binary digits are one byte, and not four.
        let own = binary.iter().find(|own| own.text == run.text).map_or(run.bytes, |own| own.bytes.clone());
        let mut parts = vec![own];
        known.retain(|bytes| !take_out(&mut parts, bytes));
        rest.extend(parts.into_iter().filter(|part| part.len() >= MIN_REST_BYTES).map(|part| (run.text.clone(), part)));
    }
    rest
}

/// Whether a string holds a byte as an escape sequence, such as `\x07`.
fn has_escaped_byte(text: &[u8]) -> bool {
    memchr::memmem::find(text, b"\\x").is_some()
}

/// Takes bytes out of the part that holds them, or that they hold. Returns whether there is one.
fn take_out(parts: &mut Vec<Vec<u8>>, bytes: &[u8]) -> bool {
    let found = parts.iter().enumerate().find_map(|(i, part)| Some((i, memchr::memmem::find(part, bytes)?)));
    if let Some((i, at)) = found {
        let part = parts.swap_remove(i);
        parts.extend([part[..at].to_vec(), part[at + bytes.len()..].to_vec()]);
        return true;
    }
    let before = parts.len();
    parts.retain(|part| part.len() < MIN_REST_BYTES || memchr::memmem::find(bytes, part).is_none());
    parts.len() < before
}

/// Whether this text is that of bytes as characters, as dumps have it beside them.
pub(in crate::text) fn is_column(text: &[u8], bytes: &[u8]) -> bool {
    memchr::memmem::find(bytes, text).is_some()
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
    let hex = hex_runs(part);
    // Numbers that are the beginning or the end of pairs of hex digits are none.
    let is_of_hex = |run: &Run| {
        hex.iter().any(|hex| {
            let is_inside = hex.text.start <= run.text.start && run.text.end <= hex.text.end;
            is_inside && hex.bytes.len() > run.bytes.len()
        })
    };
    let decimal = number_runs(part, Style::Decimal).into_iter().filter(|run| !is_of_hex(run)).collect();
    let all = [hex.clone(), escaped_runs(part), number_runs(part, Style::Loose), decimal];
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
