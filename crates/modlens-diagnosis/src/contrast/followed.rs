//! What followed the answers to a request, for a few of them: a master that takes an answer goes on by the answer, and one that does
//! not hear it by its own timeout.

use modlens_protocol::Ns;

use super::sample::Sample;
use super::tally::mix;

/// Answers that are kept whatever they are, and the slowest ones.
const KEPT: usize = 32;
const SLOWEST: usize = 16;

/// A good answer, and how long after it the next request of its line or connection came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Followed {
    /// From the end of the request to the start of the answer.
    pub response: Ns,
    /// From the start of the answer to its end.
    pub length: Ns,
    /// From there to the start of the next request.
    pub pause: Ns,
    /// The next request is the same one.
    pub is_repeated: bool,
}

impl Followed {
    /// From the start of the answer to that of the next request.
    pub fn after(&self) -> Ns {
        self.length + self.pause
    }

    /// From the end of the request to the start of the next one.
    pub fn next(&self) -> Ns {
        self.response + self.after()
    }
}

/// Some of the answers to one request.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FollowedAnswers {
    any: Sample<u64, Followed, KEPT>,
    slowest: Sample<u64, Followed, SLOWEST>,
}

impl FollowedAnswers {
    /// Counts the answer in the transaction with this number.
    #[inline]
    pub(super) fn count(&mut self, number: u64, seen: Followed) {
        if let Some(kept) = self.any.entry(mix(number), number) {
            *kept = seen;
        }
        if let Some(kept) = self.slowest.entry(u64::MAX - seen.response as u64, number) {
            *kept = seen;
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.any.merge(later.any.clone(), |own, more| *own = *more);
        self.slowest.merge(later.slowest.clone(), |own, more| *own = *more);
    }

    /// Whether there are none, as of a recording without times.
    pub fn is_empty(&self) -> bool {
        self.any.is_empty()
    }

    /// The answers that are kept, each once, with the numbers of their transactions, in the order of their response times.
    pub fn by_response(&self) -> Vec<(u64, Followed)> {
        let both = self.any.sorted().into_iter().chain(self.slowest.sorted());
        let mut all: Vec<(u64, Followed)> = both.map(|(number, seen)| (*number, *seen)).collect();
        all.sort_by_key(|(number, seen)| (seen.response, *number));
        all.dedup();
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slowest_answers_are_kept_beside_others() {
        let mut all = FollowedAnswers::default();
        for number in 1..=1000 {
            let response = if number % 100 == 0 { 1000 + number as Ns } else { 10 };
            all.count(number, Followed { response, ..Followed::default() });
        }
        let kept = all.by_response();
        assert!(kept.len() <= KEPT + SLOWEST && kept.windows(2).all(|pair| pair[0].0 != pair[1].0));
        assert_eq!(kept.iter().filter(|(_, seen)| seen.response > 1000).count(), 10);
    }
}
