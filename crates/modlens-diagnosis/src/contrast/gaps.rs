//! The longest stretches without a failure between two failures: what separates one episode of a trouble from the next.

use crate::place::Place;
use crate::MAX_CHANCE;

/// So many are kept: the longest ones, of equal ones those that came first. So parts merge to the whole.
const MOST: usize = 15;

/// A stretch without a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Gap {
    /// How many went well in it.
    good: u64,
    /// Failures before it, and all transactions from the first failure up to it.
    failed: u64,
    total: u64,
    /// The failures on either side.
    from: Place,
    to: Place,
}

/// The gaps of a tally, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gaps(Vec<Gap>);

/// What was counted from the first failure to the last one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub failed: u64,
    pub total: u64,
    pub first: Place,
    pub last: Place,
}

/// A run of failures, with what went well between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Episode {
    /// The first failure.
    pub first: Place,
    /// The last one.
    pub last: Place,
    /// How many failed.
    pub failed: u64,
    /// Of how many.
    pub total: u64,
    /// How many there were between the first failure of all and the first one of this episode.
    pub before: u64,
}

impl Gaps {
    /// Adds a gap after all others; `until` is what was counted before it.
    pub(super) fn add(&mut self, good: u64, until: Span, to: Place) {
        if good > 0 {
            self.0.push(Gap { good, failed: until.failed, total: until.total, from: until.last, to });
            self.trim();
        }
    }

    /// Adds the gaps of a later part, before which so much was counted.
    pub(super) fn append(&mut self, later: &Self, failed: u64, total: u64) {
        self.0.extend(later.0.iter().map(|gap| Gap { failed: gap.failed + failed, total: gap.total + total, ..gap.clone() }));
        self.trim();
    }

    fn trim(&mut self) {
        while self.0.len() > MOST {
            // The last one of the shortest.
            let least = self.0.iter().enumerate().min_by_key(|(at, gap)| (gap.good, std::cmp::Reverse(*at)));
            let (at, _) = least.expect("there are some");
            self.0.remove(at);
        }
    }

    /// The episodes of failures that were counted like this.
    ///
    /// Two runs of failures are one episode where so many good ones between them are no surprise, if failures were as frequent
    /// as in both runs and the gap together. The least surprising pair is joined first. Of many gaps the longest is long by
    /// chance, so that its surprise counts as often as there are failures.
    pub(super) fn episodes(&self, all: Span) -> Vec<Episode> {
        let is_ordered = self.0.windows(2).all(|pair| {
            pair[0].to.number <= pair[1].from.number && pair[0].total < pair[1].total && pair[0].failed < pair[1].failed
        }) && self
            .0
            .iter()
            .all(|gap| gap.from.number <= gap.to.number && gap.failed < all.failed && gap.total + gap.good < all.total);
        if !is_ordered {
            // Tallies of several units were added: they have no common order.
            return Vec::new();
        }
        let mut runs = Vec::with_capacity(self.0.len() + 1);
        let mut run = (all.first, 0, 0);
        for gap in &self.0 {
            runs.push(Episode {
                first: run.0,
                last: gap.from,
                failed: gap.failed - run.1,
                total: gap.total - run.2,
                before: run.2,
            });
            run = (gap.to, gap.failed, gap.total + gap.good);
        }
        runs.push(Episode { first: run.0, last: all.last, failed: all.failed - run.1, total: all.total - run.2, before: run.2 });
        let least_surprise = (MAX_CHANCE / all.failed.max(1) as f64).ln();
        while let Some(at) = likeliest(&runs, least_surprise) {
            let next = runs.remove(at + 1);
            let run = &mut runs[at];
            (run.last, run.failed, run.total) = (next.last, run.failed + next.failed, next.before + next.total - run.before);
        }
        runs
    }
}

/// The run that is joined with the next one: before the least surprising gap, if that is none (the logarithm of its chance is above
/// `least_surprise`).
fn likeliest(runs: &[Episode], least_surprise: f64) -> Option<usize> {
    let surprise = |one: &Episode, next: &Episode| {
        let total = next.before + next.total - one.before;
        let good = next.before - one.before - one.total;
        let rate = (one.failed + next.failed) as f64 / total as f64;
        (1.0 - rate).ln() * good as f64
    };
    let all = runs.windows(2).map(|pair| surprise(&pair[0], &pair[1])).enumerate();
    all.filter(|(_, chance)| *chance > least_surprise).max_by(|one, other| one.1.total_cmp(&other.1)).map(|(at, _)| at)
}

/// Failures up to this number may be by chance beside an episode.
const LONE: u64 = 2;
/// Beside an episode of so many times as many failures.
const MUCH_LONGER: u64 = 4;

/// The episodes without lone failures far from them, which would stretch the trouble.
pub(crate) fn without_lone(mut episodes: Vec<Episode>) -> Vec<Episode> {
    let most = episodes.iter().map(|one| one.failed).max().unwrap_or(0);
    episodes.retain(|one| one.failed > LONE || one.failed * MUCH_LONGER > most);
    episodes
}
