//! Pairs: reported frames that share a transaction, one request and one response.

use std::collections::{HashMap, HashSet};

use crate::model::Direction;
use crate::reported::Reported;
use crate::score::matching::Matching;
use crate::score::{is_request, Tally};
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Scores the pairs. Wanted: every valid response whose request is valid; answers from a wrong unit and repeated
/// answers are not asked for and not held against anybody.
pub(crate) fn score(case: &Case, reported: &[Reported], matching: &Matching) -> Tally {
    let mut requests: HashMap<u64, usize> = HashMap::new();
    for (at, frame) in reported.iter().enumerate() {
        if let (Some(txn), true) = (frame.txn, frame.crc_ok && is_request(frame)) {
            requests.entry(txn).or_insert(at);
        }
    }
    let mut tally = Tally { wanted: wanted(case), ..Tally::default() };
    for (at, frame) in reported.iter().enumerate() {
        if !frame.crc_ok || frame.direction != Direction::Response {
            continue;
        }
        let Some(&request) = frame.txn.and_then(|txn| requests.get(&txn)) else { continue };
        if matching.lenient(frame) || matching.lenient(&reported[request]) {
            continue;
        }
        let request = matching.truth_of[request].map(|truth| &case.truth[truth]);
        let response = matching.truth_of[at].map(|truth| &case.truth[truth]);
        if response.is_some_and(|response| response.unpaired) {
            continue;
        }
        tally.claimed += 1;
        let correct = matches!((request, response), (Some(request), Some(response)) if belong(request, response));
        tally.right += u64::from(correct);
        tally.found += u64::from(correct);
    }
    tally
}

fn belong(request: &TruthFrame, response: &TruthFrame) -> bool {
    request.direction == Direction::Request
        && response.direction == Direction::Response
        && (request.txn == response.txn || response.alt_txn == Some(request.txn))
}

fn wanted(case: &Case) -> u64 {
    let requests = case.truth.iter().filter(|frame| frame.valid && frame.direction == Direction::Request);
    let asked: HashSet<u32> = requests.map(|frame| frame.txn).collect();
    let responses = case.truth.iter().filter(|frame| frame.valid && !frame.unpaired && frame.direction == Direction::Response);
    let answered = responses.filter(|frame| asked.contains(&frame.txn) || frame.alt_txn.is_some_and(|txn| asked.contains(&txn)));
    answered.count() as u64
}
