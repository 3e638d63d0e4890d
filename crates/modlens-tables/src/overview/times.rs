//! The response times of one bucket, for percentiles over time.
//!
//! The logarithmic buckets are those of the statistics (`modlens_engine::durations`), and percentiles are within 2 % as theirs
//! are of many. `Durations` itself is too large here: there are thousands of series with a bucket for each short time, most of
//! them empty or with a few times that are about as long. So only those logarithmic buckets are kept that hold a time, and no
//! sum, no extremes, and no durations as they are. Percentiles of few are not exact.

use modlens_engine::durations::{bucket, middle};
use modlens_protocol::Ns;

/// How many times lie in each logarithmic bucket, sorted by its number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TimeCounts(Vec<(u16, u32)>);

impl TimeCounts {
    /// Counts one time.
    #[inline]
    pub fn add(&mut self, ns: Ns) {
        self.count(bucket(ns) as u16, 1);
    }

    fn count(&mut self, bucket: u16, count: u32) {
        match self.0.binary_search_by_key(&bucket, |one| one.0) {
            Ok(at) => self.0[at].1 = self.0[at].1.saturating_add(count),
            Err(at) => self.0.insert(at, (bucket, count)),
        }
    }

    /// Adds those of another series or part.
    pub fn merge(&mut self, other: &Self) {
        other.0.iter().for_each(|(bucket, count)| self.count(*bucket, *count));
    }

    /// The time that this share (0 to 1) does not exceed, within 2 %; `None` without any.
    pub fn percentile(&self, share: f64) -> Option<Ns> {
        let total: u64 = self.0.iter().map(|one| u64::from(one.1)).sum();
        let rank = (total as f64 * share).ceil() as u64;
        let mut below = 0;
        self.0.iter().find_map(|(bucket, count)| {
            below += u64::from(*count);
            (below >= rank).then(|| middle(usize::from(*bucket)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(times: impl IntoIterator<Item = Ns>) -> TimeCounts {
        let mut found = TimeCounts::default();
        times.into_iter().for_each(|ns| found.add(ns));
        found
    }

    #[test]
    fn percentiles_are_within_two_percent() {
        let found = counted((1..=1000).rev().map(|us| us * 1000));
        for (share, exact) in [(0.5, 500_000.0), (0.95, 950_000.0), (1.0, 1_000_000.0)] {
            let told = found.percentile(share).unwrap() as f64;
            assert!((told / exact - 1.0).abs() < 0.02, "{share}: {told}");
        }
        assert_eq!(TimeCounts::default().percentile(0.95), None);
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let times: Vec<Ns> = (0..500).map(|n| n * n * 977 % 50_000_000).collect();
        let mut merged = counted(times[..123].iter().copied());
        merged.merge(&counted(times[123..].iter().copied()));
        assert_eq!(merged, counted(times));
    }
}
