//! Scores pairs: a reported request and a reported response that share a transaction.

use std::collections::{HashMap, HashSet};

use crate::model::Direction;
use crate::reported::ReportedFrame;
use crate::score::matching::Matching;
use crate::score::tally::Tally;
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// Scores the pairs of an algorithm. Wanted is every valid response whose request is valid. Responses from a wrong unit and
/// repeated responses count neither as right nor as wrong.
pub(crate) fn score(case: &Case, reported: &[ReportedFrame], matching: &Matching) -> Tally {
    let decided = || claims(case, reported, matching).filter(|claim| !claim.is_undecided);
    let (right, claimed) = (decided().filter(|claim| claim.right).count() as u64, decided().count() as u64);
    Tally { found: right, wanted: wanted(case).count() as u64, right, claimed }
}

/// A reported response that is assigned to a reported request.
pub(crate) struct Claim {
    /// Index of the response among the reported frames.
    pub(crate) response: usize,
    /// Whether the assignment is right.
    pub(crate) right: bool,
    /// No listener can tell.
    pub(crate) is_undecided: bool,
}

/// The pairs that an algorithm reports.
pub(crate) fn claims<'a>(
    case: &'a Case,
    reported: &'a [ReportedFrame],
    matching: &'a Matching,
) -> impl Iterator<Item = Claim> + 'a {
    let mut requests: HashMap<u64, usize> = HashMap::new();
    for (at, frame) in reported.iter().enumerate() {
        if let (Some(txn), true) = (frame.txn, frame.is_whole && is_request(frame)) {
            requests.entry(txn).or_insert(at);
        }
    }
    let responses = reported.iter().enumerate().filter(|(_, frame)| frame.is_whole && frame.direction == Direction::Response);
    responses.filter_map(move |(at, frame)| {
        let &request = requests.get(&frame.txn?)?;
        if matching.is_unscored(frame) || matching.is_unscored(&reported[request]) {
            return None;
        }
        let truth = |at: usize| matching.truth_of[at].map(|truth| &case.truth[truth]);
        let (request, response) = (truth(request), truth(at));
        let right = matches!((request, response), (Some(request), Some(response)) if is_pair(request, response));
        let is_undecided = response.is_some_and(|response| response.is_undecided);
        response.is_none_or(|response| !response.needs_no_pair).then_some(Claim { response: at, right, is_undecided })
    })
}

fn is_pair(request: &TruthFrame, response: &TruthFrame) -> bool {
    request.direction == Direction::Request
        && response.direction == Direction::Response
        && (request.txn == response.txn || response.alternative_txn == Some(request.txn))
}

/// The frames of the truth that should be reported as the response to a request.
pub(crate) fn wanted(case: &Case) -> impl Iterator<Item = &TruthFrame> {
    let requests = case.truth.iter().filter(|frame| frame.valid && frame.direction == Direction::Request);
    let asked: HashSet<u32> = requests.map(|frame| frame.txn).collect();
    let responses =
        case.truth.iter().filter(|frame| frame.valid && !needs_no_pair(frame) && frame.direction == Direction::Response);
    responses.filter(move |frame| asked.contains(&frame.txn) || frame.alternative_txn.is_some_and(|txn| asked.contains(&txn)))
}

/// Whether it is neither right nor wrong to assign this response to a request.
fn needs_no_pair(response: &TruthFrame) -> bool {
    response.needs_no_pair || response.is_undecided
}

fn is_request(frame: &ReportedFrame) -> bool {
    frame.direction == Direction::Request
}
