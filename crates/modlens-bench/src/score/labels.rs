//! What people act on: is it said where it is true, and only there.

use std::collections::HashSet;

use crate::model::Label;
use crate::reported::Reported;
use crate::score::matching::Matching;
use crate::score::tally::Tally;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Precision and recall of one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LabelScore(pub Tally);

/// Scores all labels. Most stand at whole frames; two masters at any frame of their meeting, late answers at either of
/// the two behind a retry; lost bytes at a place.
pub(crate) fn score(case: &Case, reported: &[Reported], matching: &Matching) -> [LabelScore; 8] {
    Label::ALL.map(|label| {
        LabelScore(match label {
            Label::LostBytes => lost_bytes(case, reported),
            Label::TwoMasters => in_groups(case, reported, matching, label, meeting),
            Label::Late => in_groups(case, reported, matching, label, retried),
            _ => at_frames(case, reported, matching, label),
        })
    })
}

fn at_frames(case: &Case, reported: &[Reported], matching: &Matching, label: Label) -> Tally {
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
        } else if !truth.is_some_and(|truth| truth.maybe.contains(label)) {
            tally.claimed += 1;
        }
    }
    tally
}

/// The damaged frame of the truth that a damaged report means.
fn damaged_at<'a>(case: &'a Case, frame: &Reported) -> Option<&'a TruthFrame> {
    case.truth.iter().find(|truth| !truth.valid && truth.line == frame.line && truth.start == frame.start)
}

/// For what stands in a group of frames (a meeting of two masters, the two answers behind a retry): one report a group
/// is enough, any report in it is right, and one outside of all groups is false.
fn in_groups(case: &Case, reported: &[Reported], matching: &Matching, label: Label, group: Group) -> Tally {
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
            _ if truth.is_some_and(|truth| truth.maybe.contains(label)) => {}
            _ => tally.claimed += 1,
        }
    }
    tally.found = found.len() as u64;
    tally
}

/// The group that a frame is in.
type Group = fn(&TruthFrame) -> Option<u32>;

/// The meeting of two masters that a frame is part of.
pub(crate) fn meeting(frame: &TruthFrame) -> Option<u32> {
    (frame.episode > 0).then_some(frame.episode)
}

/// The retry that this frame or another one answers.
pub(crate) fn retried(frame: &TruthFrame) -> Option<u32> {
    frame.alt_txn.map(|_| frame.txn)
}

/// A report is right if bytes are missing inside it or at one of its ends; a frame that lost bytes is found if such a
/// report reaches into it. Where the head of one frame and the tail of another remain, nobody can see the seam.
fn lost_bytes(case: &Case, reported: &[Reported]) -> Tally {
    let label = Label::LostBytes;
    let claims: Vec<&Reported> = reported.iter().filter(|frame| frame.labels.contains(label)).collect();
    let mut tally = Tally::default();
    for frame in &claims {
        let inside = |&(line, place): &(u8, u64)| line == frame.line && (frame.start..=frame.end).contains(&place);
        let right = case.losses.iter().any(inside);
        let maybe = damaged_at(case, frame).is_some_and(|truth| truth.maybe.contains(label));
        tally.right += u64::from(right);
        tally.claimed += u64::from(right || !maybe);
    }
    for truth in case.truth.iter().filter(|frame| frame.labels.contains(label)) {
        let reaches = |claim: &&Reported| claim.line == truth.line && claim.start < truth.end && claim.end > truth.start;
        tally.wanted += 1;
        tally.found += u64::from(claims.iter().any(reaches));
    }
    tally
}
