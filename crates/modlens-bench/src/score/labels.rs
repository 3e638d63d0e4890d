//! Scores labels: whether they are given to the frames to which they apply, and only to those.

use std::collections::HashSet;

use crate::model::Label;
use crate::reported::ReportedFrame;
use crate::score::matching::Matching;
use crate::score::tally::Tally;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Precision and recall of one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LabelScore(pub Tally);

/// Scores all labels. Most belong to one whole frame. `TwoMasters` may be given to any frame of an overlap, `Late` to either
/// of the two responses after a retry, and `LostBytes` is scored by the place where bytes are missing.
pub(crate) fn score(case: &Case, reported: &[ReportedFrame], matching: &Matching) -> [LabelScore; 8] {
    Label::ALL.map(|label| {
        LabelScore(match label {
            Label::LostBytes => score_lost_bytes(case, reported),
            Label::TwoMasters => score_by_group(case, reported, matching, label, overlap_of),
            Label::Late => score_by_group(case, reported, matching, label, retry_of),
            _ => score_by_frame(case, reported, matching, label),
        })
    })
}

/// Scores a label that belongs to one frame; labels that the truth allows but does not require are not counted.
fn score_by_frame(case: &Case, reported: &[ReportedFrame], matching: &Matching, label: Label) -> Tally {
    let wanted = case.truth.iter().filter(|frame| frame.valid && frame.labels.contains(label));
    let mut tally = Tally { wanted: wanted.count() as u64, ..Tally::default() };
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        if !frame.labels.contains(label) {
            continue;
        }
        let truth = truth.map(|at| &case.truth[at]).or_else(|| damaged_at(case, frame));
        if truth.is_some_and(|truth| truth.valid && truth.labels.contains(label)) {
            tally.found += 1;
            tally.right += 1;
            tally.claimed += 1;
        } else if !truth.is_some_and(|truth| truth.allowed_labels.contains(label)) {
            tally.claimed += 1;
        }
    }
    tally
}

/// The damaged frame of the truth that begins where a reported frame begins.
fn damaged_at<'a>(case: &'a Case, frame: &ReportedFrame) -> Option<&'a TruthFrame> {
    case.truth.iter().find(|truth| !truth.valid && truth.line == frame.line && truth.start == frame.start)
}

/// Scores a label that belongs to a group of frames (an overlap of two masters, or the two responses after a retry). One
/// label per group is enough, each label within a group is right, and a label outside all groups is wrong.
fn score_by_group(case: &Case, reported: &[ReportedFrame], matching: &Matching, label: Label, group: Group) -> Tally {
    let clear = case.truth.iter().filter(|frame| frame.valid && frame.labels.contains(label));
    let wanted: HashSet<u32> = clear.filter_map(group).collect();
    let mut tally = Tally { wanted: wanted.len() as u64, ..Tally::default() };
    let mut found = HashSet::new();
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        if !frame.labels.contains(label) {
            continue;
        }
        let truth = truth.map(|at| &case.truth[at]).or_else(|| damaged_at(case, frame));
        match truth.and_then(group) {
            Some(group) if wanted.contains(&group) => {
                found.insert(group);
                tally.claimed += 1;
                tally.right += 1;
            }
            _ if truth.is_some_and(|truth| truth.allowed_labels.contains(label)) => {}
            _ => tally.claimed += 1,
        }
    }
    tally.found = found.len() as u64;
    tally
}

/// A function that returns the number of the group to which a frame belongs.
type Group = fn(&TruthFrame) -> Option<u32>;

/// The number of the overlap of two masters that a frame is part of.
pub(crate) fn overlap_of(frame: &TruthFrame) -> Option<u32> {
    (frame.overlap_id > 0).then_some(frame.overlap_id)
}

/// The transaction of the retry to which this response or the other one belongs.
pub(crate) fn retry_of(frame: &TruthFrame) -> Option<u32> {
    frame.alternative_txn.map(|_| frame.txn)
}

/// Scores `LostBytes`. A labelled report is right if bytes are missing inside it or at one of its ends. A frame that lost
/// bytes is found if a labelled report overlaps it, because the beginning of one frame joined to the end of another looks
/// like one frame.
fn score_lost_bytes(case: &Case, reported: &[ReportedFrame]) -> Tally {
    let label = Label::LostBytes;
    let claims: Vec<&ReportedFrame> = reported.iter().filter(|frame| frame.labels.contains(label)).collect();
    let mut tally = Tally::default();
    for frame in &claims {
        let inside = |&(line, place): &(u8, u64)| line == frame.line && (frame.start..=frame.end).contains(&place);
        let right = case.losses.iter().any(inside);
        let maybe = damaged_at(case, frame).is_some_and(|truth| truth.allowed_labels.contains(label));
        tally.right += u64::from(right);
        tally.claimed += u64::from(right || !maybe);
    }
    for truth in case.truth.iter().filter(|frame| frame.labels.contains(label)) {
        let reaches = |claim: &&ReportedFrame| claim.line == truth.line && claim.start < truth.end && claim.end > truth.start;
        tally.wanted += 1;
        tally.found += u64::from(claims.iter().any(reaches));
    }
    tally
}
