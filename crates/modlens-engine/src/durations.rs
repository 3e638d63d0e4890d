//! Durations counted in bounded memory. Few are kept as they are; more are counted in buckets whose width grows with the
//! duration, so that a percentile is right within 2 %.

use modlens_protocol::Ns;

/// Buckets for each factor of two: 2^`BUCKET_BITS`.
const BUCKETS_PER_OCTAVE: usize = 1 << BUCKET_BITS;
const BUCKET_BITS: u32 = 5;

/// Buckets up to 2^40 ns, which are 18 minutes. The last one counts everything longer.
const BUCKETS: usize = 40 * BUCKETS_PER_OCTAVE + 1;

/// So many durations are kept as they are.
const KEPT: usize = 64;

/// Buckets of an octave that are one for what needs the shape of a distribution: an eighth of an octave.
const JOINED: usize = BUCKETS_PER_OCTAVE / 8;

/// The share by which a percentile of more durations may be wrong: half the width of a bucket, and what rounding adds.
const ERROR: f64 = 0.02;

/// Durations in ns. Those of a recording are the same whether they were counted as a whole or in parts that were merged.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Durations {
    /// How many.
    pub count: u64,
    sum: Ns,
    least: Ns,
    /// The longest; 0 of none.
    pub most: Ns,
    /// The durations, as long as they are few; empty once they are in buckets.
    kept: Vec<Ns>,
    /// The number of the first bucket in `buckets`, which reach as far as there are durations: most requests take about as long.
    first: usize,
    buckets: Vec<u64>,
}

impl Durations {
    /// Counts one.
    #[inline]
    pub fn add(&mut self, ns: Ns) {
        self.least = if self.count == 0 { ns } else { self.least.min(ns) };
        self.most = self.most.max(ns);
        self.count += 1;
        self.sum = self.sum.saturating_add(ns);
        if self.buckets.is_empty() {
            self.keep(ns);
        } else {
            self.add_to_bucket(bucket(ns), 1);
        }
    }

    /// Counts those of another part as well.
    pub fn merge(&mut self, other: &Self) {
        other.kept.iter().for_each(|&ns| self.add(ns));
        if other.buckets.is_empty() {
            return;
        }
        self.least = if self.count == 0 { other.least } else { self.least.min(other.least) };
        self.most = self.most.max(other.most);
        self.count += other.count;
        self.sum = self.sum.saturating_add(other.sum);
        self.put_into_buckets();
        for (at, count) in other.buckets.iter().enumerate() {
            self.add_to_bucket(other.first + at, *count);
        }
    }

    /// Keeps one of the first durations; with the first that is too many, all go into buckets.
    fn keep(&mut self, ns: Ns) {
        self.kept.push(ns);
        if self.kept.len() > KEPT {
            self.put_into_buckets();
        }
    }

    fn put_into_buckets(&mut self) {
        for ns in std::mem::take(&mut self.kept) {
            self.add_to_bucket(bucket(ns), 1);
        }
    }

    #[inline]
    fn add_to_bucket(&mut self, bucket: usize, times: u64) {
        match self.buckets.get_mut(bucket.wrapping_sub(self.first)) {
            Some(count) => *count += times,
            None => self.reach(bucket, times),
        }
    }

    /// Counts in a bucket that is not there yet.
    #[cold]
    fn reach(&mut self, bucket: usize, times: u64) {
        if self.buckets.is_empty() {
            self.first = bucket;
        }
        let before = self.first.saturating_sub(bucket);
        self.buckets.splice(0..0, std::iter::repeat_n(0, before));
        self.first -= before;
        let at = bucket - self.first;
        self.buckets.resize(self.buckets.len().max(at + 1), 0);
        self.buckets[at] += times;
    }

    /// The least and the greatest; `None` of none.
    pub fn range(&self) -> Option<(Ns, Ns)> {
        (self.count > 0).then_some((self.least, self.most))
    }

    /// The mean in ns; `None` of none.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum as f64 / self.count as f64)
    }

    /// The duration that this share (0 to 1) of all does not exceed: exact of few, and of the least and the greatest; otherwise
    /// three digits of the middle of its bucket. `None` of none.
    pub fn percentile(&self, share: f64) -> Option<Ns> {
        let (least, most) = self.range()?;
        let rank = ((self.count as f64 * share).ceil() as u64).max(1);
        if !self.kept.is_empty() {
            let mut kept = self.kept.clone();
            return Some(*kept.select_nth_unstable((rank as usize - 1).min(self.kept.len() - 1)).1);
        }
        if rank >= self.count {
            return Some(most);
        }
        let mut below = 0;
        let at = self.buckets.iter().position(|count| {
            below += count;
            below >= rank
        })?;
        Some(three_digits(middle(self.first + at)).clamp(least, most))
    }

    /// The share by which a percentile may be wrong.
    pub fn error(&self) -> f64 {
        if self.buckets.is_empty() {
            0.0
        } else {
            ERROR
        }
    }

    /// How many are shorter than this duration: exact of few, otherwise without those in its own bucket.
    pub fn below(&self, ns: Ns) -> u64 {
        let kept = self.kept.iter().filter(|&&one| one < ns).count() as u64;
        kept + self.buckets.iter().take(bucket(ns).saturating_sub(self.first)).sum::<u64>()
    }

    /// Durations with how often each occurred, those in buckets by the middle of the bucket.
    pub fn each(&self) -> impl Iterator<Item = (Ns, u64)> + '_ {
        let buckets = self.buckets.iter().enumerate().map(|(at, count)| (middle(self.first + at), *count));
        self.kept.iter().map(|&ns| (ns, 1)).chain(buckets.filter(|(_, count)| *count > 0))
    }

    /// The shape of the distribution: the number of the first eighth of an octave that has any, and the counts of this one and
    /// of those after it. Eighth `n` reaches from `eighth_edge(n)` to `eighth_edge(n + 1)`.
    pub fn by_eighths(&self) -> (usize, Vec<u64>) {
        let Some((least, most)) = self.range() else { return (0, Vec::new()) };
        let first = bucket(least) / JOINED;
        let mut counts = vec![0; bucket(most) / JOINED - first + 1];
        self.kept.iter().for_each(|&ns| counts[bucket(ns) / JOINED - first] += 1);
        self.buckets.iter().enumerate().for_each(|(at, count)| counts[(self.first + at) / JOINED - first] += count);
        (first, counts)
    }
}

/// The eighth of an octave that a duration is in.
#[inline]
pub fn eighth(ns: Ns) -> usize {
    bucket(ns) / JOINED
}

/// The least duration of an eighth of an octave, in ns.
pub fn eighth_edge(eighth: usize) -> f64 {
    lower(eighth * JOINED, 0.0)
}

/// The bucket of a duration: its octave is the number of its highest bit, the bucket within it the next five bits, so that no
/// logarithm is needed.
#[inline]
pub fn bucket(ns: Ns) -> usize {
    let ns = ns.max(1) as u64;
    let octave = ns.ilog2();
    let step = ((ns << (63 - octave)) >> (63 - BUCKET_BITS)) as usize & (BUCKETS_PER_OCTAVE - 1);
    (octave as usize * BUCKETS_PER_OCTAVE + step).min(BUCKETS - 1)
}

/// The duration in ns at this share (0 to 1) of the width of a bucket.
fn lower(bucket: usize, share: f64) -> f64 {
    let (octave, step) = (bucket / BUCKETS_PER_OCTAVE, bucket % BUCKETS_PER_OCTAVE);
    (1u64 << octave) as f64 * (1.0 + (step as f64 + share) / BUCKETS_PER_OCTAVE as f64)
}

/// The duration in the middle of a bucket, in ns.
pub fn middle(bucket: usize) -> Ns {
    lower(bucket, 0.5) as Ns
}

/// A duration with three significant digits.
fn three_digits(ns: Ns) -> Ns {
    let unit = 10i64.pow(ns.max(1).ilog10().saturating_sub(2));
    (ns + unit / 2) / unit * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(all: impl IntoIterator<Item = Ns>) -> Durations {
        let mut found = Durations::default();
        all.into_iter().for_each(|ns| found.add(ns));
        found
    }

    #[test]
    fn many_are_counted_in_as_many_buckets_as_they_span() {
        let mut all = counted([4_000_000, 1_000_000, 2_000_000, 1_000_000, 16_000_000]);
        assert_eq!([0.4, 0.41, 1.0].map(|share| all.percentile(share)), [1_000_000, 2_000_000, 16_000_000].map(Some));
        (0..60).for_each(|_| all.add(2_000_000));
        // Four octaves of 32 buckets, and both ends.
        assert_eq!(all.buckets.len(), bucket(16_000_000) - bucket(1_000_000) + 1);
        assert_eq!((all.count, all.buckets.iter().sum::<u64>(), all.kept.len()), (65, 65, 0));
    }

    #[test]
    fn percentiles_of_few_are_exact_and_of_more_have_three_digits() {
        let mut all = counted((1..=64).rev().map(|ms| ms * 1_000_003));
        assert_eq!((all.percentile(0.5), all.percentile(0.95)), (Some(32 * 1_000_003), Some(61 * 1_000_003)));
        assert!(all.error() < f64::EPSILON);
        all.add(65 * 1_000_003);
        // 33,000,099 ns is in the bucket from 32.505856 to 33.030144 ms, the middle of which is 32.768 ms.
        assert_eq!(all.percentile(0.5), Some(32_800_000));
        assert_eq!(all.percentile(1.0), Some(65 * 1_000_003));
        assert!(all.error() > 0.01);
        assert_eq!([0, 7, 1_234, 99_960].map(three_digits), [0, 7, 1_230, 100_000]);
        assert_eq!(Durations::default().percentile(0.5), None);
    }

    #[test]
    fn percentiles_of_many_are_within_two_percent() {
        let all = counted((1..=1000).rev().map(|us| us * 1000));
        for (share, exact) in [(0.05, 50_000.0), (0.5, 500_000.0), (0.95, 950_000.0)] {
            let found = all.percentile(share).unwrap() as f64;
            assert!((found / exact - 1.0).abs() < 0.02, "{share}: {found}");
        }
        assert_eq!(all.range(), Some((1_000, 1_000_000)));
        assert_eq!(all.mean().map(|ns| ns as Ns), Some(500_500));
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let all: Vec<Ns> = (0..500).map(|n| n * n * 977 % 50_000_000).collect();
        for cut in [0, 1, 60, 123, 440, 500] {
            let mut merged = counted(all[..cut].iter().copied());
            merged.merge(&counted(all[cut..].iter().copied()));
            assert_eq!(merged, counted(all.iter().copied()), "{cut}");
        }
    }

    #[test]
    fn eighths_hold_what_lies_between_their_edges() {
        // An octave from 2^20 ns has eighths of 2^17 ns = 131.072 us.
        let all = counted([1 << 20, (1 << 20) + (1 << 17) - 1, (1 << 20) + (1 << 17)]);
        let (first, counts) = all.by_eighths();
        assert_eq!(counts, [2, 1]);
        assert_eq!([0, 1, 2].map(|n| eighth_edge(first + n) as Ns), [1_048_576, 1_179_648, 1_310_720]);
        assert_eq!(Durations::default().by_eighths(), (0, Vec::new()));
        let many = counted((0..100).map(|n| (1 << 20) + (n % 2) * (1 << 17)));
        assert_eq!(many.by_eighths(), (first, vec![50, 50]));
    }

    #[test]
    fn below_counts_shorter_ones() {
        let few = counted([5, 10, 15].map(|ms| ms * 1_000_000));
        assert_eq!([5, 11, 20].map(|ms| few.below(ms * 1_000_000)), [0, 2, 3]);
        let many = counted((1..=100).map(|ms| ms * 1_000_000));
        assert_eq!((many.below(500_000), many.below(200_000_000)), (0, 100));
        assert!((48..=50).contains(&many.below(50_000_000)));
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
