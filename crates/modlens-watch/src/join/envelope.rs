//! The trend of differences of which most are disturbed by delays that only add to them.
//!
//! Of every [`BLOCK`] values one is kept: the least, or one of the lowest. Through these goes the line of Theil and Sen, the
//! median of the slopes of all pairs, with the interval that Kendall's rank test leaves. It needs no model of the delays, and
//! up to a quarter of the values may be anything.

/// Values of which one is kept.
const BLOCK: usize = 16;

/// Kept values; with more, every second one is dropped, and from then on every second one is kept.
const MAX_KEPT: usize = 512;

/// Standard deviations of Kendall's statistic: one interval in a thousand misses.
const DEVIATIONS: f64 = 3.29;

/// A series of differences over time, both in seconds.
#[derive(Debug)]
pub(super) struct Envelope {
    /// Which of the sorted values of a block is kept.
    rank: usize,
    block: Vec<(f64, f64)>,
    kept: Vec<(f64, f64)>,
    blocks: usize,
    stride: usize,
}

impl Envelope {
    /// Keeps the value of this rank of each block, 0 being the least.
    pub fn new(rank: usize) -> Self {
        Self { rank, block: Vec::with_capacity(BLOCK), kept: Vec::new(), blocks: 0, stride: 1 }
    }

    /// Adds a value.
    pub fn add(&mut self, at: f64, value: f64) {
        self.block.push((at, value));
        if self.block.len() < BLOCK {
            return;
        }
        if self.blocks.is_multiple_of(self.stride) {
            self.kept.extend(ranked(&self.block, self.rank));
        }
        self.blocks += 1;
        self.block.clear();
        if self.kept.len() == MAX_KEPT {
            let mut number = 0;
            self.kept.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.stride *= 2;
        }
    }

    /// The least and the greatest slope that the values leave, and the middle one; `None` where they are too few.
    pub fn slope(&self) -> Option<(f64, f64, f64)> {
        let kept = self.values();
        let mut slopes = Vec::with_capacity(kept.len() * kept.len() / 2);
        for (number, (at, value)) in kept.iter().enumerate() {
            let rest = kept[number + 1..].iter().filter(|(later, _)| later > at);
            slopes.extend(rest.map(|(later, other)| (other - value) / (later - at)));
        }
        slopes.sort_unstable_by(f64::total_cmp);
        let (count, pairs) = (kept.len() as f64, slopes.len() as f64);
        let spread = DEVIATIONS * (count * (count - 1.0) * (2.0 * count + 5.0) / 18.0).sqrt();
        if slopes.is_empty() || spread >= pairs {
            return None;
        }
        let rank = |place: f64| slopes[(place.max(0.0) as usize).min(slopes.len() - 1)];
        Some((rank(pairs.midpoint(-spread)), rank(pairs / 2.0), rank(pairs.midpoint(spread))))
    }

    /// The value in the middle of all, moved along a slope to a time.
    pub fn value_at(&self, at: f64, slope: f64) -> Option<f64> {
        let mut moved: Vec<f64> = self.values().iter().map(|(time, value)| value + slope * (at - time)).collect();
        moved.sort_unstable_by(f64::total_cmp);
        moved.get(moved.len() / 2).copied()
    }

    /// The kept values; of the block that is not full, where it is the only one or half full.
    fn values(&self) -> Vec<(f64, f64)> {
        let is_enough = self.kept.is_empty() || 2 * self.block.len() >= BLOCK;
        let rank = self.rank * self.block.len() / BLOCK;
        let last = if is_enough { ranked(&self.block, rank) } else { None };
        self.kept.iter().copied().chain(last).collect()
    }
}

/// The value of this rank.
fn ranked(block: &[(f64, f64)], rank: usize) -> Option<(f64, f64)> {
    let mut sorted = block.to_vec();
    sorted.sort_unstable_by(|one, other| one.1.total_cmp(&other.1));
    sorted.get(rank).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_theil_and_sen_passes_over_outliers() {
        let mut values = Envelope::new(0);
        for number in 0..1600 {
            let at = f64::from(number);
            // Every fifth block is late by half a second.
            let late = if number / 16 % 5 == 4 { 0.5 } else { 0.0 };
            values.add(at, 2e-6 * at + late + f64::from(number * 7919 % 16) / 1e3);
        }
        let (least, middle, most) = values.slope().unwrap();
        assert!(least <= 2e-6 && 2e-6 <= most, "{least} {most}");
        assert!((middle - 2e-6).abs() < 1e-6, "{middle}");
        assert!((values.value_at(800.0, 2e-6).unwrap() - 1.6e-3).abs() < 1e-3);
    }

    #[test]
    fn few_values_have_no_slope() {
        let mut values = Envelope::new(0);
        (0..96).for_each(|number| values.add(f64::from(number), 0.0));
        assert_eq!(values.slope(), None);
        assert_eq!(values.value_at(50.0, 0.0), Some(0.0));
    }

    #[test]
    fn the_memory_is_bounded() {
        let mut values = Envelope::new(4);
        (0..1_000_000).for_each(|number| values.add(f64::from(number), f64::from(number) * 5e-5));
        assert!(values.kept.len() < MAX_KEPT);
        let (least, _, most) = values.slope().unwrap();
        assert!((least - 5e-5).abs() < 1e-9 && (most - 5e-5).abs() < 1e-9);
    }
}
