//! Tests of the scorer with reports made by hand.

use super::*;
use crate::model::Direction;
use crate::model::Labels;
use crate::sim::case::Traffic;
use crate::sim::scenario::Scenario;
use crate::sim::tap::TapMode;

fn case(scenario: &str, frames: usize) -> Case {
    Traffic::new(Scenario::named(scenario).unwrap(), 5, frames).tap(TapMode::Exact)
}

/// The reports of an algorithm that makes no mistake.
fn perfect(case: &Case) -> Vec<ReportedFrame> {
    let frames = case.truth.iter().map(|truth| {
        let mut frame = ReportedFrame::new(truth.line, truth.start, truth.end, truth.valid);
        frame.direction = truth.direction;
        let old = truth.alternative_txn.filter(|&old| asked(case, old));
        frame.txn = Some(u64::from(old.unwrap_or(truth.txn)));
        frame.labels = truth.labels;
        frame
    });
    frames.collect()
}

/// Whether the request of this transaction was recorded whole.
fn asked(case: &Case, txn: u32) -> bool {
    case.truth.iter().any(|frame| frame.valid && frame.txn == txn && frame.direction == Direction::Request)
}

#[test]
fn the_truth_itself_has_a_perfect_score() {
    for scenario in Scenario::all() {
        let case = case(scenario.name, 400);
        let score = score(&case, &perfect(&case));
        let name = scenario.name;
        for tally in [score.frames_with_direction(), score.frames(), score.pairs, score.damaged] {
            assert!((tally.recall() - 1.0).abs() < 1e-9 && (tally.precision() - 1.0).abs() < 1e-9, "{name} {tally:?}");
        }
        for (label, said) in Label::ALL.iter().zip(&score.labels) {
            assert!((said.0.recall() - 1.0).abs() < 1e-9, "{name} {label:?} {said:?}");
            assert!((said.0.precision() - 1.0).abs() < 1e-9, "{name} {label:?} {said:?}");
        }
    }
}

#[test]
fn no_reports_have_no_score() {
    let score = score(&case("field", 200), &[]);
    assert_eq!((score.frames_with_direction().found, score.claimed, score.pairs.claimed), (0, 0, 0));
    assert!(score.frames_with_direction().f1() < 1e-9 && score.valid > 100);
}

#[test]
fn wrong_directions_count_for_frames_only() {
    let case = case("clean", 300);
    let mut frames = perfect(&case);
    for frame in &mut frames {
        frame.direction = Direction::Unknown;
    }
    let score = score(&case, &frames);
    assert_eq!((score.matched, score.matched_with_direction), (score.valid, 0));
    assert_eq!(score.pairs.claimed, 0);
}

#[test]
fn a_frame_is_found_once_and_shifted_ones_are_false() {
    let case = case("clean", 100);
    let mut frames = perfect(&case);
    frames.push(frames[0]);
    frames.push(ReportedFrame { start: frames[1].start + 1, ..frames[1] });
    let score = score(&case, &frames);
    assert_eq!((score.matched, score.claimed), (score.valid, score.valid + 2));
}

#[test]
fn false_and_missed_labels_are_counted() {
    let case = case("timeouts", 400);
    let mut frames = perfect(&case);
    let silent = frames.iter().position(|frame| frame.labels.contains(Label::NoResponse)).unwrap();
    let answered = case.truth.iter().position(|truth| truth.valid && truth.direction == Direction::Response).unwrap();
    frames[silent].labels = Labels::default();
    frames[answered].labels.insert(Label::TwoMasters);
    let score = score(&case, &frames);
    let said = score.label(Label::NoResponse).0;
    assert_eq!((said.found + 1, said.right, said.claimed), (said.wanted, said.found, said.found));
    assert_eq!(score.label(Label::TwoMasters).0, Tally { claimed: 1, ..Tally::default() });
}

#[test]
fn latency_counts_from_the_read() {
    let case = case("clean", 50);
    let mut frames = perfect(&case);
    let mut reads = case.read_times(0);
    for frame in &mut frames {
        frame.emitted_ns = reads.at(frame.end - 1).map(|time| time + 2_000_000);
    }
    let latency = score(&case, &frames).latency;
    assert!(latency.percentiles().iter().all(|ms| (ms - 2.0).abs() < 1e-9));
}

#[test]
fn unconfirmed_frames_in_noise_are_counted_apart() {
    let mut frames =
        vec![ReportedFrame::new(0, 0, 8, true), ReportedFrame::new(0, 100, 108, true), ReportedFrame::new(0, 200, 208, true)];
    frames[1].unconfirmed = true;
    assert_eq!(false_frames(&frames, 50), (1, 1));
}
