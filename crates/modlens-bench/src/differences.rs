//! Lists where an algorithm and the truth differ: the bytes around every missed, false or mislabelled frame, and every wrong
//! pair.

use std::collections::HashSet;
use std::fmt::Write as _;

use crate::model::{Direction, Label};
use crate::reported::ReportedFrame;
use crate::score::labels::{overlap_of, retry_of};
use crate::score::matching::Matching;
use crate::score::pairs;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// How many bytes are shown before a difference; three times as many are shown from there on.
const CONTEXT_BYTES: u64 = 12;

/// How many reported frames are shown before and after a difference.
const CONTEXT_FRAMES: usize = 3;

/// A list of all differences in the order of the stream, each with the bytes and the reported frames around it.
pub fn differences(case: &Case, reported: &[ReportedFrame]) -> String {
    let matching = Matching::new(case, reported);
    let mut rows: Vec<(u64, String)> = Vec::new();
    let mut found = vec![None; case.truth.len()];
    for (at, frame) in reported.iter().enumerate() {
        match matching.truth_of[at] {
            Some(truth) => {
                found[truth] = Some(at);
                let truth = &case.truth[truth];
                if !truth.echo && frame.direction != truth.direction {
                    rows.push((frame.start, format!("direction {:?}, is {}", frame.direction, describe(truth))));
                }
            }
            None if frame.is_whole && !matching.is_unscored(frame) => rows.push((frame.start, String::from("false frame"))),
            None => {}
        }
        let label = wrong_labels(case, frame, matching.truth_of[at]);
        rows.extend(label.into_iter().map(|what| (frame.start, what)));
    }
    rows.extend(pair_errors(case, reported, &matching));
    let in_group = groups_with_label(case, reported, &found);
    for (truth, found) in case.truth.iter().zip(&found) {
        if truth.valid && found.is_none() {
            rows.push((truth.start, format!("missed: {}", describe(truth))));
        }
        let said = found.map(|at: usize| reported[at].labels).unwrap_or_default();
        for label in truth.labels.iter().filter(|&label| truth.valid && !said.contains(label)) {
            if group(truth, label).is_some_and(|group| in_group.contains(&(label, group))) {
                continue;
            }
            rows.push((truth.start, format!("{} not said: {}", label.text(), describe(truth))));
        }
    }
    rows.sort();
    let mut text = String::new();
    for (start, what) in rows {
        writeln!(text, "{start:>8}  {what}").expect("text can grow");
        for line in &case.lines {
            writeln!(text, "          {}", context(case, reported, line.id, start)).expect("text can grow");
        }
        writeln!(text, "          told: {}", reported_around(reported, start)).expect("text can grow");
    }
    text
}

/// Responses that were assigned to a wrong request, and responses that should have been assigned to one and were not.
fn pair_errors(case: &Case, reported: &[ReportedFrame], matching: &Matching) -> Vec<(u64, String)> {
    let truth = |at: usize| matching.truth_of[at].map(|truth| &case.truth[truth]);
    let claims: Vec<pairs::Claim> = pairs::claims(case, reported, matching).collect();
    let paired: HashSet<(u8, u64)> =
        claims.iter().filter_map(|claim| truth(claim.response)).map(|truth| (truth.line, truth.start)).collect();
    let wrong = claims.iter().filter(|claim| !claim.right).map(|claim| {
        let text = truth(claim.response).map_or(String::from("nothing there"), describe);
        (reported[claim.response].start, format!("wrong pair: {text}"))
    });
    let missed = pairs::wanted(case).filter(|truth| !paired.contains(&(truth.line, truth.start)));
    wrong.chain(missed.map(|truth| (truth.start, format!("no pair: {}", describe(truth))))).collect()
}

/// The group of frames to which a label belongs; `None` for labels that belong to a single frame.
fn group(truth: &TruthFrame, label: Label) -> Option<u32> {
    match label {
        Label::TwoMasters => overlap_of(truth),
        Label::Late => retry_of(truth),
        _ => None,
    }
}

fn groups_with_label(case: &Case, reported: &[ReportedFrame], found: &[Option<usize>]) -> HashSet<(Label, u32)> {
    let frames = case.truth.iter().zip(found);
    let said = frames.filter_map(|(truth, found)| found.map(|at| (truth, reported[at].labels)));
    said.flat_map(|(truth, labels)| labels.iter().filter_map(|label| group(truth, label).map(|group| (label, group)))).collect()
}

fn wrong_labels(case: &Case, frame: &ReportedFrame, truth: Option<usize>) -> Vec<String> {
    let truth = truth.map(|at| &case.truth[at]);
    let truth = truth.or_else(|| case.truth.iter().find(|t| !t.valid && t.line == frame.line && t.start == frame.start));
    // Lost bytes are judged by place: the table counts them.
    let judged = frame.labels.iter().filter(|&label| label != Label::LostBytes);
    let fits = |truth: &TruthFrame, label| {
        truth.labels.contains(label) || truth.allowed_labels.contains(label) || group(truth, label).is_some()
    };
    let wrong = judged.filter(|&label| !truth.is_some_and(|truth| fits(truth, label)));
    wrong.map(|label| format!("{} said: {}", label.text(), truth.map_or(String::from("nothing there"), describe))).collect()
}

/// A list of all damaged frames of the truth that were not located, and of all reported damaged frames that do not exist.
pub fn damaged_differences(case: &Case, reported: &[ReportedFrame]) -> String {
    let claims: HashSet<(u8, u64)> =
        reported.iter().filter(|frame| !frame.is_whole).map(|frame| (frame.line, frame.start)).collect();
    let wanted: HashSet<(u8, u64)> = case.truth.iter().filter(|t| !t.valid).map(|truth| (truth.line, truth.start)).collect();
    let missed = case.truth.iter().filter(|truth| !truth.valid && !claims.contains(&(truth.line, truth.start)));
    let mut rows: Vec<(u8, u64, String)> = missed.map(|truth| (truth.line, truth.start, not_located(truth, reported))).collect();
    rows.extend(loss_errors(case, reported));
    let mut wrong: Vec<&(u8, u64)> = claims.difference(&wanted).collect();
    wrong.sort();
    rows.extend(wrong.into_iter().map(|&(line, start)| (line, start, String::from("no damaged frame"))));
    rows.sort();
    let mut text = String::new();
    for (line, start, what) in rows {
        writeln!(text, "{start:>8}  {what}\n          {}", context(case, reported, line, start)).expect("text can grow");
    }
    text
}

/// What is reported of a damaged frame instead of its start: nothing, so noise; a frame that ends in it or after it; a frame that
/// begins after its first byte; or a whole frame.
fn not_located(truth: &TruthFrame, reported: &[ReportedFrame]) -> String {
    let is_here = |frame: &&ReportedFrame| frame.line == truth.line && frame.start < truth.end && frame.end > truth.start;
    let told = match reported.iter().find(is_here) {
        None => String::from("noise"),
        Some(frame) => {
            let condition = if frame.is_whole { "whole" } else { "damaged" };
            format!("{condition} {}..{}", frame.start, frame.end)
        }
    };
    format!("not located, told {told}: {}", describe(truth))
}

/// Frames that lost bytes and did not get the label, and frames that got the label although no bytes are missing.
fn loss_errors(case: &Case, reported: &[ReportedFrame]) -> Vec<(u8, u64, String)> {
    let said: Vec<&ReportedFrame> = reported.iter().filter(|frame| frame.labels.contains(Label::LostBytes)).collect();
    let reached = |truth: &TruthFrame| {
        said.iter().any(|frame| frame.line == truth.line && frame.start < truth.end && frame.end > truth.start)
    };
    let missed = case.truth.iter().filter(|truth| truth.labels.contains(Label::LostBytes) && !reached(truth));
    let missed = missed.map(|truth| (truth.line, truth.start, format!("lost bytes not said: {}", describe(truth))));
    let right = |frame: &ReportedFrame| {
        case.losses.iter().any(|&(line, place)| line == frame.line && (frame.start..=frame.end).contains(&place))
    };
    let maybe = |frame: &ReportedFrame| {
        let here = case.truth.iter().find(|t| !t.valid && t.line == frame.line && t.start == frame.start);
        here.is_some_and(|truth| truth.allowed_labels.contains(Label::LostBytes))
    };
    let wrong = said.iter().filter(|frame| !right(frame) && !maybe(frame));
    let wrong = wrong.map(|frame| (frame.line, frame.start, String::from("lost bytes said, none are missing here")));
    missed.chain(wrong).collect()
}

fn describe(truth: &TruthFrame) -> String {
    let direction = if truth.direction == Direction::Request { "request" } else { "response" };
    let labels: Vec<&str> = truth.labels.iter().map(Label::text).collect();
    let valid = if truth.valid { String::new() } else { format!(", damaged:{}", truth.damage.text()) };
    format!(
        "{direction} {}..{} unit {} function {} txn {}{valid} {}",
        truth.start,
        truth.end,
        truth.unit,
        truth.function,
        truth.txn,
        labels.join(" ")
    )
}

/// The frames reported around a place, in the order of the reports: line, offset, direction, transaction, labels.
fn reported_around(reported: &[ReportedFrame], place: u64) -> String {
    let at = reported.iter().position(|frame| frame.start >= place).unwrap_or(reported.len());
    let near = reported.iter().take(at + 1 + CONTEXT_FRAMES).skip(at.saturating_sub(CONTEXT_FRAMES));
    near.map(|frame| {
        let direction = match frame.direction {
            Direction::Request => '>',
            Direction::Response => '<',
            Direction::Unknown => '?',
        };
        let labels = frame.labels.iter().fold(String::new(), |labels, label| labels + " " + label.text());
        let txn = frame.txn.map_or(String::from("-"), |txn| txn.to_string());
        let bad = if frame.is_whole { "" } else { "!" };
        format!("{}:{}{direction}{bad} {txn}{labels}", frame.line, frame.start)
    })
    .collect::<Vec<_>>()
    .join(", ")
}

/// The bytes around a place. `[` and `]` enclose frames of the truth, `(` and `)` frames reported as whole, `{` and `}` frames
/// reported as damaged, and `|2.5|` is a new read after so many ms.
fn context(case: &Case, reported: &[ReportedFrame], line: u8, place: u64) -> String {
    let bytes = case.bytes(line);
    let end = (place + 3 * CONTEXT_BYTES).min(bytes.len() as u64);
    let from = place.saturating_sub(CONTEXT_BYTES).min(end);
    let mut text = String::new();
    let truths = || case.truth.iter().filter(|frame| frame.line == line);
    let claims = || reported.iter().filter(|frame| frame.line == line);
    let mut reads = case.read_times(line);
    let mut before = reads.at(from);
    let pause = 1.5 * case.settings.char_ns();
    for at in from..end {
        text.extend(claims().filter(|frame| frame.end == at).map(|frame| if frame.is_whole { ')' } else { '}' }));
        text.extend(truths().filter(|frame| frame.end == at).map(|_| ']'));
        let now = reads.at(at);
        if let (Some(now), Some(earlier)) = (now, before) {
            if (now - earlier) as f64 > pause {
                write!(text, " |{:.1}|", (now - earlier) as f64 / 1e6).expect("text can grow");
            }
        }
        before = now;
        text.push(' ');
        text.extend(truths().filter(|frame| frame.start == at).map(|_| '['));
        text.extend(claims().filter(|frame| frame.start == at).map(|frame| if frame.is_whole { '(' } else { '{' }));
        write!(text, "{:02x}", bytes[at as usize]).expect("text can grow");
    }
    text
}
