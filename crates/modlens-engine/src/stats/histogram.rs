//! A histogram of times with logarithmic buckets: percentiles in bounded memory.

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

/// Histogram buckets for each factor of two. With 32, percentiles are right within 2 %.
const BUCKETS_PER_OCTAVE: usize = 1 << BUCKET_BITS;
const BUCKET_BITS: u32 = 5;

/// A histogram of times with logarithmic buckets.
#[derive(Clone, Debug, Default)]
pub(super) struct TimeHistogram {
    pub(super) count: u64,
    sum: Ns,
    least: Ns,
    most: Ns,
    buckets: Vec<u64>,
}

/// Buckets up to 2^40 ns, which are 18 minutes. The last one counts everything longer.
const BUCKETS: usize = 40 * BUCKETS_PER_OCTAVE + 1;

impl TimeHistogram {
    /// Counts one time.
    pub(super) fn add(&mut self, ns: Ns) {
        self.least = if self.count == 0 { ns } else { self.least.min(ns) };
        self.most = self.most.max(ns);
        self.count += 1;
        self.sum += ns;
        if self.buckets.is_empty() {
            self.buckets.resize(BUCKETS, 0);
        }
        self.buckets[bucket(ns)] += 1;
    }

    /// The time in ns that this share (0 to 1) of the observations does not exceed: the middle of its bucket, but within the
    /// least and the greatest time counted. 0 without any.
    pub(super) fn percentile(&self, share: f64) -> Ns {
        let rank = (self.count as f64 * share).ceil() as u64;
        let mut below = 0;
        for (bucket, count) in self.buckets.iter().enumerate() {
            below += count;
            if below >= rank {
                return middle(bucket).clamp(self.least, self.most);
            }
        }
        self.most
    }

    /// Count, extremes, mean and percentiles in microseconds; null without any time.
    pub(super) fn json(&self) -> Json {
        if self.count == 0 {
            return Json::Null;
        }
        let us = |ns: Ns| ns as f64 / 1000.0;
        json!({
            "count": self.count, "min_us": us(self.least), "mean_us": us(self.sum) / self.count as f64,
            "p50_us": us(self.percentile(0.5)), "p95_us": us(self.percentile(0.95)), "max_us": us(self.most),
        })
    }
}

/// The bucket of a time: its octave is the number of its highest bit, the bucket within it the next five bits, so that no
/// logarithm is needed.
fn bucket(ns: Ns) -> usize {
    let ns = ns.max(1) as u64;
    let octave = ns.ilog2();
    let step = ((ns << (63 - octave)) >> (63 - BUCKET_BITS)) as usize & (BUCKETS_PER_OCTAVE - 1);
    (octave as usize * BUCKETS_PER_OCTAVE + step).min(BUCKETS - 1)
}

/// The time in the middle of a bucket.
fn middle(bucket: usize) -> Ns {
    let (octave, step) = (bucket / BUCKETS_PER_OCTAVE, bucket % BUCKETS_PER_OCTAVE);
    ((1u64 << octave) as f64 * (1.0 + (step as f64 + 0.5) / BUCKETS_PER_OCTAVE as f64)) as Ns
}

#[cfg(test)]
mod tests {
    use super::*;

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
