//! A histogram of times with logarithmic buckets: percentiles in bounded memory. Those of few times are exact.

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

/// Histogram buckets for each factor of two. With 32, percentiles are right within 2 %.
const BUCKETS_PER_OCTAVE: usize = 1 << BUCKET_BITS;
const BUCKET_BITS: u32 = 5;

/// So many times are kept as they are.
const KEPT: usize = 64;

/// The share by which a percentile of more times may be wrong: half the width of a bucket, and what rounding adds.
const ERROR: f64 = 0.02;

/// A histogram of times with logarithmic buckets.
#[derive(Clone, Debug, Default)]
pub(super) struct TimeHistogram {
    pub(super) count: u64,
    sum: Ns,
    least: Ns,
    most: Ns,
    /// The number of the first bucket in `buckets`, which reach as far as there are times: most requests take about as long.
    first: usize,
    buckets: Vec<u64>,
    /// The times, as long as they are few; empty once there are more.
    kept: Vec<Ns>,
}

/// Buckets up to 2^40 ns, which are 18 minutes. The last one counts everything longer.
const BUCKETS: usize = 40 * BUCKETS_PER_OCTAVE + 1;

impl TimeHistogram {
    /// Counts one time.
    #[inline]
    pub(super) fn add(&mut self, ns: Ns) {
        self.least = if self.count == 0 { ns } else { self.least.min(ns) };
        self.most = self.most.max(ns);
        self.count += 1;
        self.sum += ns;
        if self.count <= KEPT as u64 + 1 {
            self.keep(ns);
        }
        let at = bucket(ns).wrapping_sub(self.first);
        match self.buckets.get_mut(at) {
            Some(count) => *count += 1,
            None => self.add_bucket(bucket(ns)),
        }
    }

    /// Keeps one of the first times, or gives them up with the first that is too many.
    #[cold]
    fn keep(&mut self, ns: Ns) {
        if self.kept.len() < KEPT {
            self.kept.push(ns);
        } else {
            self.kept = Vec::new();
        }
    }

    /// Counts one time in a bucket that is not there yet.
    #[cold]
    fn add_bucket(&mut self, bucket: usize) {
        if self.buckets.is_empty() {
            self.first = bucket;
        }
        let before = self.first.saturating_sub(bucket);
        self.buckets.splice(0..0, std::iter::repeat_n(0, before));
        self.first -= before;
        let at = bucket - self.first;
        self.buckets.resize(self.buckets.len().max(at + 1), 0);
        self.buckets[at] += 1;
    }

    /// The time in ns that this share (0 to 1) of the observations does not exceed: exact of few times, otherwise three digits
    /// of the middle of its bucket, but within the least and the greatest time counted. 0 without any.
    pub(super) fn percentile(&self, share: f64) -> Ns {
        let rank = (self.count as f64 * share).ceil() as u64;
        if !self.kept.is_empty() {
            let mut times = self.kept.clone();
            times.sort_unstable();
            return times[(rank.max(1) as usize - 1).min(times.len() - 1)];
        }
        let mut below = 0;
        for (bucket, count) in self.buckets.iter().enumerate() {
            below += count;
            if below >= rank {
                return three_digits(middle(self.first + bucket)).clamp(self.least, self.most);
            }
        }
        self.most
    }

    /// The share by which a percentile may be wrong.
    fn error(&self) -> f64 {
        if self.kept.is_empty() {
            ERROR
        } else {
            0.0
        }
    }

    /// As `json`, with the 99th percentile and the counts of its buckets, joined to eight for each factor of two: their edges
    /// in microseconds, one more than there are counts.
    pub(super) fn json_with_buckets(&self) -> Json {
        let mut found = self.json();
        if self.count == 0 {
            return found;
        }
        let first = self.first / JOINED;
        let mut counts = vec![0u64; (self.first + self.buckets.len()).div_ceil(JOINED) - first];
        for (at, count) in self.buckets.iter().enumerate() {
            counts[(self.first + at) / JOINED - first] += count;
        }
        let lower: Vec<f64> = (first..=first + counts.len()).map(|joined| lower(joined * JOINED) / 1000.0).collect();
        found["p99_us"] = (self.percentile(0.99) as f64 / 1000.0).into();
        found["histogram"] = json!({"edges_us": lower, "counts": counts});
        found
    }

    /// Count, extremes, mean and percentiles in microseconds, and how exact these are; null without any time.
    pub(super) fn json(&self) -> Json {
        if self.count == 0 {
            return Json::Null;
        }
        let us = |ns: Ns| ns as f64 / 1000.0;
        json!({
            "count": self.count, "min_us": us(self.least), "mean_us": us(self.sum) / self.count as f64,
            "p50_us": us(self.percentile(0.5)), "p95_us": us(self.percentile(0.95)), "max_us": us(self.most),
            "percentile_error": self.error(),
        })
    }
}

/// The bucket of a time: its octave is the number of its highest bit, the bucket within it the next five bits, so that no
/// logarithm is needed.
///
/// ```
/// use modlens_engine::stats::histogram::{bucket, middle};
/// assert!((middle(bucket(20_000_000)) - 20_000_000).abs() < 400_000);
/// ```
#[inline]
pub fn bucket(ns: Ns) -> usize {
    let ns = ns.max(1) as u64;
    let octave = ns.ilog2();
    let step = ((ns << (63 - octave)) >> (63 - BUCKET_BITS)) as usize & (BUCKETS_PER_OCTAVE - 1);
    (octave as usize * BUCKETS_PER_OCTAVE + step).min(BUCKETS - 1)
}

/// Buckets that are one in what is written.
const JOINED: usize = BUCKETS_PER_OCTAVE / 8;

/// The least time in a bucket, in ns.
fn lower(bucket: usize) -> f64 {
    let (octave, step) = (bucket / BUCKETS_PER_OCTAVE, bucket % BUCKETS_PER_OCTAVE);
    (1u64 << octave) as f64 * (1.0 + step as f64 / BUCKETS_PER_OCTAVE as f64)
}

/// The time in the middle of a bucket, in ns.
pub fn middle(bucket: usize) -> Ns {
    let (octave, step) = (bucket / BUCKETS_PER_OCTAVE, bucket % BUCKETS_PER_OCTAVE);
    ((1u64 << octave) as f64 * (1.0 + (step as f64 + 0.5) / BUCKETS_PER_OCTAVE as f64)) as Ns
}

/// A time with three significant digits.
fn three_digits(ns: Ns) -> Ns {
    let unit = 10i64.pow(ns.max(1).ilog10().saturating_sub(2));
    (ns + unit / 2) / unit * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_any_order_are_counted_in_as_many_buckets_as_they_span() {
        let mut times = TimeHistogram::default();
        for ns in [4_000_000, 1_000_000, 2_000_000, 1_000_000, 16_000_000] {
            times.add(ns);
        }
        // Four octaves of 32 buckets, and both ends.
        assert_eq!(times.buckets.len(), bucket(16_000_000) - bucket(1_000_000) + 1);
        assert_eq!((times.percentile(0.4), times.percentile(0.41), times.percentile(1.0)), (1_000_000, 2_000_000, 16_000_000));
        assert_eq!((times.count, times.buckets.iter().sum::<u64>()), (5, 5));
    }

    #[test]
    fn percentiles_of_few_times_are_exact_and_of_more_have_three_digits() {
        let mut times = TimeHistogram::default();
        (1..=64).rev().for_each(|ms| times.add(ms * 1_000_003));
        assert_eq!((times.percentile(0.5), times.percentile(0.95)), (32 * 1_000_003, 61 * 1_000_003));
        assert_eq!(times.json()["percentile_error"], 0.0);
        times.add(65 * 1_000_003);
        // 33,000,099 ns is in the bucket from 32.505856 to 33.030144 ms, the middle of which is 32.768 ms.
        assert_eq!(times.percentile(0.5), 32_800_000);
        assert_eq!(times.json()["percentile_error"], 0.02);
        assert_eq!([0, 7, 1_234, 99_960].map(three_digits), [0, 7, 1_230, 100_000]);
    }

    #[test]
    fn joined_buckets_hold_all_times_between_their_edges() {
        let mut times = TimeHistogram::default();
        // An octave from 2^20 ns has joined buckets of 2^17 ns = 131.072 us.
        for ns in [1 << 20, (1 << 20) + (1 << 17) - 1, (1 << 20) + (1 << 17)] {
            times.add(ns);
        }
        let found = times.json_with_buckets();
        assert_eq!(found["histogram"]["counts"], json!([2, 1]));
        assert_eq!(found["histogram"]["edges_us"], json!([1048.576, 1179.648, 1310.72]));
        assert_eq!(found["p99_us"], found["max_us"]);
        assert_eq!(TimeHistogram::default().json_with_buckets(), Json::Null);
    }

    #[test]
    fn an_octave_has_thirty_two_buckets() {
        // From 2^19 = 524,288 ns on in steps of 16,384: bucket 29 begins at 999,424 and holds a millisecond.
        assert_eq!(bucket(1_000_000), 19 * 32 + 29);
        assert_eq!(middle(19 * 32 + 29), 999_424 + 8_192);
        assert_eq!((bucket(-5), bucket(0), bucket(1)), (0, 0, 0));
        assert_eq!(bucket(Ns::MAX), BUCKETS - 1);
        let mut last = 0;
        for ns in (0..39 * 8).map(|eighth| (f64::from(eighth) / 8.0).exp2() as Ns).filter(|&ns| ns > 32) {
            assert!(bucket(ns) >= last, "{ns}");
            assert!((middle(bucket(ns)) - ns).abs() * 64 <= ns + 64, "{ns}");
            last = bucket(ns);
        }
    }
}
