//! Durations in buckets whose width grows with the duration.

use std::collections::BTreeMap;

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

/// Each bucket is wider than the one before by this factor: quantiles are off by 4 % at most.
const GROWTH: f64 = 1.08;

/// Counts of durations; the sum of two is that of both recordings.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Histogram {
    buckets: BTreeMap<i32, u64>,
    total: u64,
}

impl Histogram {
    /// Counts a duration; zero and less count as one nanosecond.
    pub fn add(&mut self, duration: Ns) {
        *self.buckets.entry(bucket(duration.max(1) as f64)).or_default() += 1;
        self.total += 1;
    }

    /// The number of durations.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The duration that this share of all durations does not exceed, in seconds; `None` without any.
    pub fn quantile(&self, share: f64) -> Option<f64> {
        let wanted = (share * self.total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        self.buckets.iter().find_map(|(bucket, count)| {
            seen += count;
            (seen >= wanted).then(|| middle(*bucket))
        })
    }

    /// The number of durations and the nine deciles in seconds, which is what a baseline keeps.
    pub fn deciles(&self) -> Json {
        let deciles: Vec<f64> = (1..10).filter_map(|tenth| self.quantile(f64::from(tenth) / 10.0)).map(rounded).collect();
        json!({"count": self.total, "deciles_s": deciles})
    }

    /// The ranges in seconds that hold nearly all durations, each a run of adjacent buckets: the phases of a period.
    ///
    /// Buckets of less than `MIN_SHARE` of all durations are left out.
    pub fn phases(&self) -> Vec<[f64; 2]> {
        const MIN_SHARE: f64 = 0.03;
        let mut phases: Vec<[i32; 2]> = Vec::new();
        let threshold = (self.total as f64 * MIN_SHARE).max(2.0);
        for (bucket, _) in self.buckets.iter().filter(|(_, count)| **count as f64 >= threshold) {
            match phases.last_mut() {
                Some(last) if *bucket <= last[1] + 2 => last[1] = *bucket,
                _ => phases.push([*bucket, *bucket]),
            }
        }
        phases.into_iter().map(|[first, last]| [rounded(edge(first)), rounded(edge(last + 1))]).collect()
    }

    /// The share of durations of `self` that exceed a duration drawn from nine deciles in seconds: 0.5 where both are alike.
    pub fn above(&self, deciles: &[f64]) -> f64 {
        if self.total == 0 || deciles.is_empty() {
            return 0.5;
        }
        let above = |seconds: f64| {
            let lower = deciles.iter().filter(|decile| **decile < seconds).count() as f64;
            let equal = deciles.iter().filter(|decile| (**decile - seconds).abs() <= 1e-3 * seconds).count() as f64;
            // Between two deciles lies a tenth of all, of which half are below.
            ((lower + equal / 2.0 + 0.5) / (deciles.len() as f64 + 1.0)).clamp(0.0, 1.0)
        };
        self.buckets.iter().map(|(bucket, count)| above(middle(*bucket)) * *count as f64).sum::<f64>() / self.total as f64
    }
}

fn bucket(ns: f64) -> i32 {
    (ns.ln() / GROWTH.ln()).floor() as i32
}

/// The lower end of a bucket in seconds.
fn edge(bucket: i32) -> f64 {
    GROWTH.powi(bucket) / 1e9
}

fn middle(bucket: i32) -> f64 {
    edge(bucket) * GROWTH.sqrt()
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

    #[test]
    fn quantiles_are_off_by_half_a_bucket_at_most() {
        let mut all = Histogram::default();
        (1..=1000).for_each(|ms| all.add(ms * 1_000_000));
        for (share, seconds) in [(0.1, 0.1), (0.5, 0.5), (0.9, 0.9)] {
            let found = all.quantile(share).unwrap();
            assert!((found / seconds - 1.0).abs() < 0.05, "{share}: {found}");
        }
        assert_eq!(Histogram::default().quantile(0.5), None);
    }

    #[test]
    fn two_periods_are_two_phases() {
        let mut all = Histogram::default();
        (0..100).for_each(|i| all.add(1_000_000_000 + i * 100_000));
        (0..100).for_each(|i| all.add(60_000_000_000 + i * 1_000_000));
        let phases = all.phases();
        assert_eq!(phases.len(), 2);
        assert!(phases[0][0] <= 1.0 && phases[0][1] >= 1.01 && phases[1][0] <= 60.0 && phases[1][1] >= 60.1, "{phases:?}");
    }

    #[test]
    fn equal_distributions_exceed_each_other_half_of_the_time() {
        let (mut one, mut slower) = (Histogram::default(), Histogram::default());
        (1..=1000).for_each(|ms| one.add(ms * 1_000_000));
        (1..=1000).for_each(|ms| slower.add(ms * 5_000_000));
        let deciles: Vec<f64> = (1..10).map(|tenth| f64::from(tenth) / 10.0).collect();
        assert!((one.above(&deciles) - 0.5).abs() < 0.02);
        assert!(slower.above(&deciles) > 0.85);
    }
}
