//! Compares the odds that transactions state with the errors that are counted.

use std::collections::{BTreeMap, HashSet};

use crate::model::{Direction, Label};
use crate::reported::{ReportedFrame, TransactionClaim};
use crate::score::matching::Matching;
use crate::score::pairs;
use crate::sim::case::Case;

/// Transactions, and the wrong ones among them, by what they claim and by their confidence in bits.
pub type Odds = BTreeMap<(TransactionClaim, u8), (u64, u64)>;

/// Adds the transactions of a run over a case.
///
/// An answered one is wrong if request and response do not belong together; one without response if there was one; a response
/// that nobody asked for if its request was received. Frames that may be called silent or not are not counted; but those that no
/// listener can decide are: what a row states of them has to be as often right.
pub fn count(case: &Case, reported: &[ReportedFrame], odds: &mut Odds) {
    let matching = Matching::new(case, reported);
    let mut add = |frame: &ReportedFrame, wanted: TransactionClaim, is_right: bool| {
        if let Some((claim, confidence)) = frame.transaction.filter(|(claim, _)| *claim == wanted) {
            let (all, wrong) = odds.entry((claim, confidence)).or_default();
            (*all, *wrong) = (*all + 1, *wrong + u64::from(!is_right));
        }
    };
    for claim in pairs::claims(case, reported, &matching) {
        add(&reported[claim.response], TransactionClaim::Answered, claim.right);
        add(&reported[claim.response], TransactionClaim::Late, claim.right);
    }
    let wanted: HashSet<(u8, u64)> = pairs::wanted(case).map(|frame| (frame.line, frame.start)).collect();
    let responses = case.truth.iter().filter(|frame| frame.valid && frame.direction == Direction::Response);
    let answered: HashSet<u32> = responses.map(|frame| frame.txn).collect();
    for (frame, truth) in reported.iter().zip(&matching.truth_of) {
        let truth = truth.map(|at| &case.truth[at]);
        let is_open = truth.is_some_and(|truth| !truth.is_undecided && truth.allowed_labels.contains(Label::NoResponse));
        if !is_open && frame.is_whole && !matching.is_unscored(frame) {
            let is_silent = truth.is_some_and(|truth| {
                let is_without_response = truth.direction == Direction::Request && !answered.contains(&truth.txn);
                truth.labels.contains(Label::NoResponse) || (truth.is_undecided && is_without_response)
            });
            add(frame, TransactionClaim::Silent, is_silent);
            add(frame, TransactionClaim::Unasked, truth.is_some() && !wanted.contains(&(frame.line, frame.start)));
        }
    }
}

/// The table: for each claim and confidence how many there were, how many were wrong, and the odds that they had.
pub fn table(odds: &Odds) -> String {
    let row = |(&(claim, confidence), &(all, wrong)): (&(TransactionClaim, u8), &(u64, u64))| {
        let counted = ((all - wrong) as f64 / (wrong as f64).max(0.5)).log2();
        let bound = if wrong == 0 { "at least " } else { "" };
        format!("{:<18}{confidence:>11}{all:>9}{wrong:>9}  {bound}{counted:.1}\n", claim.text())
    };
    let rows: String = odds.iter().map(row).collect();
    format!("transactions      stated bits    count    wrong  counted bits\n{rows}")
}
