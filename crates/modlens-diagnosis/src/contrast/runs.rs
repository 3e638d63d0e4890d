//! Runs of failures: how long they are, and how many failures are in long ones.

/// How long runs of failures are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Runs {
    /// Runs of three failures or more that have ended, by success before and after.
    pub long: u64,
    /// Failures in them.
    pub failures_in_long: u64,
    /// The longest run.
    pub longest: u64,
    first: u64,
    open: u64,
    total: u64,
    failed: u64,
}

/// A run of so many failures is a long one.
const LONG_RUN: u64 = 3;

impl Runs {
    /// Counts some successes, one at least.
    pub(super) fn count_good(&mut self, good: u64) {
        self.count(false);
        self.total += good - 1;
    }

    pub(super) fn count(&mut self, failed: bool) {
        self.total += 1;
        if failed {
            self.failed += 1;
            self.open += 1;
            self.longest = self.longest.max(self.open);
        } else {
            self.close();
        }
        if self.open == self.total {
            self.first = self.total;
        }
    }

    /// Ends the open run; one that has begun before the first success is not counted yet, since a part before may end in one.
    fn close(&mut self) {
        if self.open >= LONG_RUN && self.open != self.total - 1 {
            self.long += 1;
            self.failures_in_long += self.open;
        }
        self.open = 0;
    }

    pub(super) fn merge(&mut self, later: &Self) {
        if later.first == later.total {
            // The later part is one run.
            if self.first == self.total {
                self.first += later.total;
            }
            self.open += later.total;
        } else {
            let joined = self.open + later.first;
            self.longest = self.longest.max(joined);
            if self.first == self.total {
                self.first = joined;
            } else if joined >= LONG_RUN {
                self.long += 1;
                self.failures_in_long += joined;
            }
            self.open = later.open;
        }
        self.long += later.long;
        self.failures_in_long += later.failures_in_long;
        self.failed += later.failed;
        self.total += later.total;
        self.longest = self.longest.max(later.longest).max(self.open);
    }

    /// How many were counted.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Whether the first one failed.
    pub fn begins_failed(&self) -> bool {
        self.first > 0
    }

    /// All failures.
    pub fn failures(&self) -> u64 {
        self.failed
    }

    /// Failures in runs of three or more, whether these have ended or not.
    pub fn in_long(&self) -> u64 {
        let ends = if self.first == self.total { [self.first, 0] } else { [self.first, self.open] };
        self.failures_in_long + ends.into_iter().filter(|run| *run >= LONG_RUN).sum::<u64>()
    }

    /// Number of runs of three or more failures.
    pub fn count_of_long(&self) -> u64 {
        let ends = if self.first == self.total { [self.first, 0] } else { [self.first, self.open] };
        self.long + ends.into_iter().filter(|run| *run >= LONG_RUN).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs(failures: &str) -> Runs {
        let mut all = Runs::default();
        failures.chars().for_each(|c| all.count(c == 'x'));
        all
    }

    #[test]
    fn runs_merge_to_the_whole() {
        for text in ["xxx.xx.xxxx..xxxxx.x", "xxxxxxxx", "....", ".xxx", "xxx.", "x.xxx.x"] {
            for cut in 0..=text.len() {
                let mut merged = runs(&text[..cut]);
                merged.merge(&runs(&text[cut..]));
                assert_eq!(merged, runs(text), "{text} cut at {cut}");
            }
        }
        let all = runs("xxx.xx.xxxx..xxxxx.x");
        assert_eq!((all.in_long(), all.count_of_long(), all.longest), (12, 3, 5));
    }
}
