//! What a baseline keeps of durations: their deciles, and the ranges that hold nearly all of them.

use modlens_engine::durations::{eighth_edge, Durations};
use serde_json::{json, Value as Json};

/// The duration that this share of all durations does not exceed, in seconds; `None` without any.
pub fn quantile(durations: &Durations, share: f64) -> Option<f64> {
    durations.percentile(share).map(|ns| ns as f64 / 1e9)
}

/// The number of durations and the nine deciles in seconds.
pub fn deciles(durations: &Durations) -> Json {
    let tenths = (1..10).map(|tenth| f64::from(tenth) / 10.0);
    let deciles: Vec<f64> = tenths.filter_map(|share| quantile(durations, share)).map(rounded).collect();
    json!({"count": durations.count, "deciles_s": deciles})
}

/// The ranges in seconds that hold nearly all durations: the phases of a period. Each is a run of eighths of an octave, between
/// which at most one is without.
///
/// Eighths of less than `MIN_SHARE` of all durations are left out.
pub fn phases(durations: &Durations) -> Vec<[f64; 2]> {
    const MIN_SHARE: f64 = 0.03;
    let threshold = (durations.count as f64 * MIN_SHARE).max(2.0);
    let (first, counts) = durations.by_eighths();
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for (eighth, _) in (first..).zip(&counts).filter(|(_, count)| **count as f64 >= threshold) {
        match runs.last_mut() {
            Some(run) if eighth <= run[1] + 2 => run[1] = eighth,
            _ => runs.push([eighth, eighth]),
        }
    }
    runs.into_iter().map(|[first, last]| [first, last + 1].map(|edge| rounded(eighth_edge(edge) / 1e9))).collect()
}

/// The share of durations that exceed one drawn from nine deciles in seconds: 0.5 where both are alike.
pub fn above(durations: &Durations, deciles: &[f64]) -> f64 {
    if durations.count == 0 || deciles.is_empty() {
        return 0.5;
    }
    let above = |seconds: f64| {
        let lower = deciles.iter().filter(|decile| **decile < seconds).count() as f64;
        let equal = deciles.iter().filter(|decile| (**decile - seconds).abs() <= 1e-3 * seconds).count() as f64;
        // Between two deciles lies a tenth of all, of which half are below.
        ((lower + equal / 2.0 + 0.5) / (deciles.len() as f64 + 1.0)).clamp(0.0, 1.0)
    };
    durations.each().map(|(ns, count)| above(ns as f64 / 1e9) * count as f64).sum::<f64>() / durations.count as f64
}

/// Three significant digits.
pub fn rounded(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let scale = 10f64.powi(2 - value.log10().floor() as i32);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(all: impl IntoIterator<Item = i64>) -> Durations {
        let mut found = Durations::default();
        all.into_iter().for_each(|ns| found.add(ns));
        found
    }

    #[test]
    fn two_periods_are_two_phases() {
        let second = (0..100).map(|i| 1_000_000_000 + i * 100_000);
        let minute = (0..100).map(|i| 60_000_000_000 + i * 1_000_000);
        let phases = phases(&counted(second.chain(minute)));
        assert_eq!(phases.len(), 2);
        assert!(phases[0][0] <= 1.0 && phases[0][1] >= 1.01 && phases[1][0] <= 60.0 && phases[1][1] >= 60.1, "{phases:?}");
    }

    #[test]
    fn equal_distributions_exceed_each_other_half_of_the_time() {
        let one = counted((1..=1000).map(|ms| ms * 1_000_000));
        let slower = counted((1..=1000).map(|ms| ms * 5_000_000));
        let deciles: Vec<f64> = (1..10).map(|tenth| f64::from(tenth) / 10.0).collect();
        assert!((above(&one, &deciles) - 0.5).abs() < 0.02);
        assert!(above(&slower, &deciles) > 0.85);
    }
}
