//! Whether a difference is more than chance.

/// The probability of at least `hits` of `trials`, each with this share.
///
/// ```
/// use modlens_watch::chance::at_least;
/// assert!((at_least(2, 3, 0.5) - 0.5).abs() < 1e-12); // 3 of 8, and 1 of 8
/// assert_eq!(at_least(0, 10, 0.1), 1.0);
/// ```
pub fn at_least(hits: u64, trials: u64, share: f64) -> f64 {
    if hits == 0 || share >= 1.0 {
        return 1.0;
    }
    if hits > trials || share <= 0.0 {
        return 0.0;
    }
    // Each term from the one before; the first by its logarithm, because it can be below the smallest float.
    let log = |from: u64, to: u64| (from..=to).map(|number| (number as f64).ln()).sum::<f64>();
    let (few, rest) = (hits.min(trials - hits), hits.max(trials - hits));
    let first = log(rest + 1, trials) - log(1, few) + hits as f64 * share.ln() + (trials - hits) as f64 * (-share).ln_1p();
    let mut term = first.exp();
    let mut sum = term;
    for number in hits..trials {
        term *= (trials - number) as f64 / (number + 1) as f64 * share / (1.0 - share);
        sum += term;
        // Past the peak, what follows is less than this term each time.
        if term < sum * 1e-12 && number as f64 > trials as f64 * share {
            break;
        }
    }
    sum.min(1.0)
}

/// By how many standard deviations the mean rank of one sample exceeds that of another, if `above` is the share of pairs in
/// which it is the greater one (Mann and Whitney; 0 for shares of one half).
pub fn rank_deviation(above: f64, count: u64, other: u64) -> f64 {
    let [n, m] = [count, other].map(|number| number.max(1) as f64);
    (above - 0.5) / ((n + m + 1.0) / (12.0 * n * m)).sqrt()
}

/// The chance that something seen so many times among all trials was not among the earlier ones, if each trial could have it:
/// at most one in `1 + earlier / now` for each time it was seen.
///
/// ```
/// use modlens_watch::chance::chance_of_none;
/// // One of two equal halves has a single sighting: even odds. Twelve sightings in one of them: one in 4096.
/// assert_eq!(chance_of_none(1, 50, 50), 0.5);
/// assert_eq!(chance_of_none(12, 1000, 1000), 1.0 / 4096.0);
/// ```
pub fn chance_of_none(hits: u64, now: u64, earlier: u64) -> f64 {
    let share = now as f64 / (now + earlier).max(1) as f64;
    share.powi(i32::try_from(hits).unwrap_or(i32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_of_the_binomial_is_that_of_tables() {
        // 1 - F(4; 10, 0.2) = 0.0328, 1 - F(29; 100, 0.2) = 0.0112 (tables of the binomial distribution).
        assert!((at_least(5, 10, 0.2) - 0.0328).abs() < 1e-4);
        assert!((at_least(30, 100, 0.2) - 0.0112).abs() < 1e-4);
        assert!(at_least(900, 100_000, 0.01) > 0.99);
    }
}
