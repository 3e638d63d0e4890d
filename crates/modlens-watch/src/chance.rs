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
