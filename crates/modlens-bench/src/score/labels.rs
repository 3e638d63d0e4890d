//! What people act on: is it said where it is true, and only there.

use std::collections::HashSet;

use crate::model::Label;
use crate::reported::Reported;
use crate::score::matching::Matching;
use crate::score::Tally;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Precision and recall of one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LabelScore(pub Tally);

/// Scores all labels. Most stand at whole frames; two masters at any frame of their meeting; lost bytes at a place.
pub(crate) fn score(case: &Case, reported: &[Reported], matching: &Matching) -> [LabelScore; 8] {
    Label::ALL.map(|label| {
        LabelScore(match label {
            Label::LostBytes => lost_bytes(case, reported),
            Label::TwoMasters => two_masters(case, reported, matching),
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

/// One alarm a meeting is enough; an alarm at a frame of no meeting is false.
fn two_masters(case: &Case, reported: &[Reported], matching: &Matching) -> Tally {
    let label = Label::TwoMasters;
    let clear = case.truth.iter().filter(|frame| frame.valid && frame.labels.contains(label));
    let wanted: HashSet<u32> = clear.map(|frame| frame.episode).collect();
    let mut tally = Tally { wanted: wanted.len() as u64, ..Tally::default() };
    let mut found = HashSet::new();
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        if !frame.labels.contains(label) {
            continue;
        }
        let truth = truth.map(|at| &case.truth[at]).or_else(|| damaged_at(case, frame));
        match truth.map_or(0, |truth| truth.episode) {
            episode if wanted.contains(&episode) => {
                found.insert(episode);
                tally.claimed += 1;
                tally.right += 1;
            }
            0 => tally.claimed += 1,
            _ => {}
        }
    }
    tally.found = found.len() as u64;
    tally
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
