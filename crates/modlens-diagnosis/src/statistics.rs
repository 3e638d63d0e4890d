//! Tests for small counts: how likely is this contrast, if nothing were the cause?

use std::f64::consts::PI;
use std::iter::Sum;
use std::sync::LazyLock;

/// The natural logarithms of the first factorials, 0! to 31!.
static FIRST_FACTORIALS: LazyLock<[f64; 32]> =
    LazyLock::new(|| std::array::from_fn(|n| (2..=n).map(|factor| (factor as f64).ln()).sum()));

/// The natural logarithm of n!: exact sums below 32, Stirling's series above (its error there is below 1e-12).
fn ln_factorial(n: u64) -> f64 {
    if let Some(known) = FIRST_FACTORIALS.get(n as usize) {
        return *known;
    }
    let n = n as f64;
    n * n.ln() - n + 0.5 * (2.0 * PI * n).ln() + 1.0 / (12.0 * n) - 1.0 / (360.0 * n * n * n)
}

fn ln_choose(n: u64, k: u64) -> f64 {
    ln_factorial(n) - ln_factorial(k) - ln_factorial(n - k)
}

/// Failed ones among all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    /// How many failed.
    pub failed: u64,
    /// How many there were.
    pub total: u64,
}

impl Share {
    /// The share that failed; 0 of none.
    pub fn rate(self) -> f64 {
        if self.total == 0 {
            0.0
        } else {
            self.failed as f64 / self.total as f64
        }
    }

    /// What is in the one and not in the other, which is a part of it.
    #[must_use]
    pub fn without(self, part: Self) -> Self {
        Self { failed: self.failed - part.failed, total: self.total - part.total }
    }

    /// Both together.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self { failed: self.failed + other.failed, total: self.total + other.total }
    }

    /// Counts one more.
    #[inline]
    pub fn count(&mut self, failed: bool) {
        self.total += 1;
        self.failed += u64::from(failed);
    }
}

impl Sum for Share {
    fn sum<I: Iterator<Item = Self>>(shares: I) -> Self {
        shares.fold(Self::default(), Self::with)
    }
}

/// The chance that so many of the failures or more fall into `inside`, were they spread over `inside` and `outside` by
/// accident (Fisher's exact test, one-sided).
///
/// ```
/// use modlens_diagnosis::statistics::{fisher, Share};
/// // Fisher's tea: 4 of 4 cups right by chance has 1 chance in 70.
/// let chance = fisher(Share { failed: 4, total: 4 }, Share { failed: 0, total: 4 });
/// assert!((chance - 1.0 / 70.0).abs() < 1e-12);
/// ```
pub fn fisher(inside: Share, outside: Share) -> f64 {
    let (failed, total) = (inside.failed + outside.failed, inside.total + outside.total);
    let all = ln_choose(total, failed);
    let most = failed.min(inside.total);
    let least = failed.saturating_sub(outside.total);
    let term = |k: u64| ln_choose(inside.total, k) + ln_choose(outside.total, failed - k) - all;
    if u128::from(inside.failed) * u128::from(total) < u128::from(failed) * u128::from(inside.total) {
        // Below what is likeliest, all others are fewer terms that count.
        return 1.0 - sum_of_tail((least..inside.failed).rev().map(term));
    }
    sum_of_tail((inside.failed..=most).map(term))
}

/// The chance of `failed` or more failures among `total`, each of which fails with this probability.
///
/// ```
/// use modlens_diagnosis::statistics::{at_least, Share};
/// // Three heads of three: 1 in 8.
/// assert!((at_least(Share { failed: 3, total: 3 }, 0.5) - 0.125).abs() < 1e-12);
/// ```
pub fn at_least(share: Share, probability: f64) -> f64 {
    let (p, n) = (probability.clamp(1e-12, 1.0 - 1e-12), share.total);
    if share.failed == 0 {
        return 1.0;
    }
    let (failing, good) = (p.ln(), (1.0 - p).ln());
    let term = |k: u64| ln_choose(n, k) + k as f64 * failing + (n - k) as f64 * good;
    if (share.failed as f64) < n as f64 * p {
        // Below what is likeliest, all others are fewer terms that count.
        return 1.0 - sum_of_tail((0..share.failed).rev().map(term));
    }
    sum_of_tail((share.failed..=n).map(term))
}

/// The chance of `failed` or fewer failures among `total`, each of which fails with this probability.
///
/// ```
/// use modlens_diagnosis::statistics::{at_most, Share};
/// // No head in three throws: 1 in 8.
/// assert!((at_most(Share { failed: 0, total: 3 }, 0.5) - 0.125).abs() < 1e-12);
/// ```
pub fn at_most(share: Share, probability: f64) -> f64 {
    at_least(Share { failed: share.total - share.failed, total: share.total }, 1.0 - probability)
}

/// The chance of two independent observations, by Fisher's method for two.
///
/// ```
/// // Two that come about once in ten times each: by chance once in eighteen.
/// assert!((modlens_diagnosis::statistics::both(0.1, 0.1) - 0.0561).abs() < 1e-4);
/// ```
pub fn both(one: f64, other: f64) -> f64 {
    let product = (one * other).max(f64::MIN_POSITIVE);
    (product * (1.0 - product.ln())).min(1.0)
}

/// The chance that failures spread by chance are in no more runs than these (Wald and Wolfowitz).
///
/// ```
/// use modlens_diagnosis::statistics::{in_runs_at_most, Share};
/// // Two failures of four: side by side in 3 of 6 ways.
/// assert!((in_runs_at_most(Share { failed: 2, total: 4 }, 1) - 0.5).abs() < 1e-12);
/// ```
pub fn in_runs_at_most(share: Share, runs: u64) -> f64 {
    let (failed, good) = (share.failed, share.total - share.failed);
    if failed == 0 {
        return 1.0;
    }
    let all = ln_choose(share.total, failed);
    let most = runs.min(failed).min(good + 1);
    // From the likeliest, the greatest number of runs, downwards.
    sum_of_tail((1..=most).rev().map(|runs| ln_choose(failed - 1, runs - 1) + ln_choose(good + 1, runs) - all))
}

/// The sum of probabilities given by their logarithms. Beyond their greatest, terms fall; the sum ends where they no longer
/// count.
fn sum_of_tail(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut last) = (0.0, f64::NEG_INFINITY);
    for term in terms {
        let probability = term.exp();
        sum += probability;
        if term < last && probability <= sum * 1e-12 {
            break;
        }
        last = term;
    }
    sum.min(1.0)
}

/// The least share that still explains these counts with 99 % confidence (Wilson's interval).
pub fn least_rate(share: Share) -> f64 {
    wilson(share, -1.0).max(0.0)
}

/// The greatest share that still explains these counts with 99 % confidence (Wilson's interval).
pub fn greatest_rate(share: Share) -> f64 {
    wilson(share, 1.0).min(1.0)
}

fn wilson(share: Share, side: f64) -> f64 {
    const Z: f64 = 2.326;
    if share.total == 0 {
        return if side > 0.0 { 1.0 } else { 0.0 };
    }
    let (n, p) = (share.total as f64, share.rate());
    let middle = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    (middle + side * half) / (1.0 + Z * Z / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(failed: u64, total: u64) -> Share {
        Share { failed, total }
    }

    #[test]
    fn fisher_agrees_with_published_tables() {
        // Agresti, Categorical Data Analysis, table 3.8: 3 of 4 against 1 of 4 has P = 17/70.
        assert!((fisher(share(3, 4), share(1, 4)) - 17.0 / 70.0).abs() < 1e-12);
        assert!((fisher(share(0, 9), share(3, 9)) - 1.0).abs() < 1e-9);
        assert!(fisher(share(500, 1000), share(0, 100_000)) < 1e-300);
    }

    #[test]
    fn binomial_tail_agrees_with_a_calculation_by_hand() {
        // P(X >= 2), n = 10, p = 0.1: 1 - 0.9^10 - 10 * 0.1 * 0.9^9 = 0.263901...
        assert!((at_least(share(2, 10), 0.1) - 0.263_901_070_9).abs() < 1e-9);
        assert!((at_least(share(0, 10), 0.1) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn large_counts_do_not_overflow() {
        assert!(at_least(share(600_000, 1_000_000), 0.5) < 1e-300);
        assert!((at_least(share(500_000, 1_000_000), 0.5) - 0.5).abs() < 1e-2);
    }

    #[test]
    fn wilson_bounds_enclose_the_share() {
        assert!(least_rate(share(1, 1000)) < 0.001 && greatest_rate(share(1, 1000)) > 0.001);
        assert!(greatest_rate(share(0, 1000)) < 0.006);
        assert!(least_rate(share(10, 10)) > 0.6);
    }
}
