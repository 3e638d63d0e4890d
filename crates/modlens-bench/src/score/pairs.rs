//! Pairs: reported frames that share a transaction, one request and one response.

use std::collections::{HashMap, HashSet};

use crate::model::Direction;
use crate::reported::Reported;
use crate::score::matching::Matching;
use crate::score::tally::Tally;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Scores the pairs. Wanted: every valid response whose request is valid; answers from a wrong unit and repeated
/// answers are not asked for and not held against anybody.
pub(crate) fn score(case: &Case, reported: &[Reported], matching: &Matching) -> Tally {
    let right = claims(case, reported, matching).filter(|claim| claim.right).count() as u64;
    let claimed = claims(case, reported, matching).count() as u64;
    Tally { found: right, wanted: wanted(case).count() as u64, right, claimed }
}

/// A reported response that is said to answer a reported request.
pub(crate) struct Claim {
    /// The response's place among the reported frames.
    pub(crate) response: usize,
    /// Whether it does.
    pub(crate) right: bool,
}

/// The pairs that an algorithm tells of.
pub(crate) fn claims<'a>(case: &'a Case, reported: &'a [Reported], matching: &'a Matching) -> impl Iterator<Item = Claim> + 'a {
    let mut requests: HashMap<u64, usize> = HashMap::new();
    for (at, frame) in reported.iter().enumerate() {
        if let (Some(txn), true) = (frame.txn, frame.crc_ok && is_request(frame)) {
            requests.entry(txn).or_insert(at);
        }
    }
    let responses = reported.iter().enumerate().filter(|(_, frame)| frame.crc_ok && frame.direction == Direction::Response);
    responses.filter_map(move |(at, frame)| {
        let &request = requests.get(&frame.txn?)?;
        if matching.lenient(frame) || matching.lenient(&reported[request]) {
            return None;
        }
        let truth = |at: usize| matching.truth_of[at].map(|truth| &case.truth[truth]);
        let (request, response) = (truth(request), truth(at));
        let right = matches!((request, response), (Some(request), Some(response)) if belong(request, response));
        response.is_none_or(|response| !response.unpaired).then_some(Claim { response: at, right })
    })
}

fn belong(request: &TruthFrame, response: &TruthFrame) -> bool {
    request.direction == Direction::Request
        && response.direction == Direction::Response
        && (request.txn == response.txn || response.alt_txn == Some(request.txn))
}

/// The frames of the truth that should be told as the answer to a request.
pub(crate) fn wanted(case: &Case) -> impl Iterator<Item = &TruthFrame> {
    let requests = case.truth.iter().filter(|frame| frame.valid && frame.direction == Direction::Request);
    let asked: HashSet<u32> = requests.map(|frame| frame.txn).collect();
    let responses = case.truth.iter().filter(|frame| frame.valid && !frame.unpaired && frame.direction == Direction::Response);
    responses.filter(move |frame| asked.contains(&frame.txn) || frame.alt_txn.is_some_and(|txn| asked.contains(&txn)))
}

fn is_request(frame: &Reported) -> bool {
    frame.direction == Direction::Request
}
