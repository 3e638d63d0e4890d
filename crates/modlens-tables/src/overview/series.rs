//! A series over time with a bounded number of buckets.
//!
//! A bucket is a power of two wide and begins at a multiple of its width, so that two neighbours make one bucket of the next
//! width. When a series outgrows its bound, its buckets are joined in pairs. So a series depends neither on the order in which
//! it came nor on the parts that it was counted in, and nothing but resolution is ever lost.

/// The content of a bucket.
pub(super) trait Bucket: Clone + Default {
    /// Adds a bucket that is later.
    fn merge(&mut self, later: &Self);
}

/// Buckets from the first position to the last.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Series<B> {
    /// Buckets are this power of two wide.
    shift: u32,
    /// The number of the first bucket: its position by its width.
    first: i64,
    buckets: Vec<B>,
}

impl<B: Bucket> Series<B> {
    /// A series without buckets, which will be two to the power of `shift` wide or wider.
    pub fn new(shift: u32) -> Self {
        Self { shift, first: 0, buckets: Vec::new() }
    }

    /// The bucket at a position. There are `most` at most, for which buckets are joined if need be.
    #[inline]
    pub fn at(&mut self, position: i64, most: usize) -> &mut B {
        let mut index = self.index_of(position);
        if index >= self.buckets.len() || self.buckets.len() > most {
            self.make_room(position, most);
            index = self.index_of(position);
        }
        &mut self.buckets[index]
    }

    /// The index of the bucket at a position; of one that is before the first, beyond all that there may be.
    #[inline]
    fn index_of(&self, position: i64) -> usize {
        (position >> self.shift).wrapping_sub(self.first) as usize
    }

    /// The width of the buckets.
    pub fn width(&self) -> i64 {
        1 << self.shift
    }

    /// The first position after the bucket of this one.
    pub fn bucket_end(&self, position: i64) -> i64 {
        ((position >> self.shift) + 1) << self.shift
    }

    /// First and last number of its buckets, and their power of two; `None` without any.
    pub fn range(&self) -> Option<Range> {
        let count = self.buckets.len() as i64;
        (count > 0).then_some(Range { shift: self.shift, first: self.first, last: self.first + count - 1 })
    }

    /// Adds the series of a later part of the recording.
    pub fn merge(&mut self, later: &Self, most: usize) {
        let Some(range) = later.range() else { return };
        self.reshape(self.range().map_or(range, |own| own.with(range)).within(most));
        for (at, bucket) in later.buckets.iter().enumerate() {
            let number = (later.first + at as i64) >> (self.shift - later.shift);
            self.buckets[(number - self.first) as usize].merge(bucket);
        }
    }

    /// Its buckets in a range that covers it, those before and after it empty.
    pub fn cut_to(&self, range: Range) -> Vec<B> {
        let mut found = vec![B::default(); (range.last - range.first + 1) as usize];
        for (at, bucket) in self.buckets.iter().enumerate() {
            let number = (self.first + at as i64) >> (range.shift - self.shift);
            found[(number - range.first) as usize].merge(bucket);
        }
        found
    }

    #[cold]
    fn make_room(&mut self, position: i64, most: usize) {
        let number = position >> self.shift;
        let after = number - self.first;
        if !self.buckets.is_empty() && (self.buckets.len() as i64..most as i64).contains(&after) {
            // It grows at its end, as it does nearly always.
            self.buckets.resize_with(after as usize + 1, B::default);
            return;
        }
        let alone = Range { shift: self.shift, first: number, last: number };
        self.reshape(self.range().map_or(alone, |own| own.with(alone)).within(most));
    }

    /// Joins its buckets, and adds empty ones before and after, until they are those of a range that covers it. A bucket is
    /// moved and not copied, because a series grows by one bucket most of the time.
    fn reshape(&mut self, range: Range) {
        let by = range.shift - self.shift;
        if by > 0 {
            let mut newest = None;
            let mut joined: Vec<B> = Vec::with_capacity((range.last - range.first + 1) as usize);
            for (at, bucket) in std::mem::take(&mut self.buckets).into_iter().enumerate() {
                let number = (self.first + at as i64) >> by;
                match joined.last_mut() {
                    Some(last) if newest == Some(number) => last.merge(&bucket),
                    _ => joined.push(bucket),
                }
                newest = Some(number);
            }
            (self.buckets, self.first, self.shift) = (joined, self.first >> by, range.shift);
        }
        if self.buckets.is_empty() {
            self.first = range.first;
        }
        let before = (self.first - range.first) as usize;
        self.buckets.splice(0..0, std::iter::repeat_n(B::default(), before));
        self.first = range.first;
        self.buckets.resize((range.last - range.first + 1) as usize, B::default());
    }
}

/// Consecutive buckets of one width.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Range {
    /// The power of two of their width.
    pub shift: u32,
    /// The number of the first.
    pub first: i64,
    /// The number of the last.
    pub last: i64,
}

impl Range {
    /// The range in buckets of the greater width that covers both.
    pub fn with(self, other: Self) -> Self {
        let shift = self.shift.max(other.shift);
        let (own, other) = (self.widened(shift), other.widened(shift));
        Self { shift, first: own.first.min(other.first), last: own.last.max(other.last) }
    }

    /// The same in buckets that are wide enough for there to be `most` at most.
    pub fn within(self, most: usize) -> Self {
        let mut range = self;
        while range.last - range.first >= most as i64 {
            range = range.widened(range.shift + 1);
        }
        range
    }

    fn widened(self, shift: u32) -> Self {
        let by = shift - self.shift;
        Self { shift, first: self.first >> by, last: self.last >> by }
    }
}

/// How many buckets a series has when there are so many of them: a power of two from `least` to `most`, such that all together
/// have no more than `budget` unless each has its least.
pub(super) fn resolution(budget: usize, series: usize, least: usize, most: usize) -> usize {
    let share = (budget / series.max(1)).max(1);
    (1 << share.ilog2()).clamp(least, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Bucket for u64 {
        fn merge(&mut self, later: &Self) {
            *self += later;
        }
    }

    fn counted(positions: &[i64], most: usize) -> Series<u64> {
        let mut series = Series::new(0);
        for at in positions {
            *series.at(*at, most) += 1;
        }
        series
    }

    #[test]
    fn buckets_are_joined_in_pairs_when_there_are_too_many() {
        let series = counted(&[0, 1, 2, 3, 4, 5, 6, 7, 8], 4);
        // 0 to 3, 4 to 7, 8 to 11.
        assert_eq!(series.range(), Some(Range { shift: 2, first: 0, last: 2 }));
        assert_eq!(series.buckets, [4, 4, 1]);
    }

    #[test]
    fn neither_order_nor_parts_make_a_difference() {
        let positions: Vec<i64> = (0..500).map(|n| (n * 7919) % 1231 - 600).collect();
        let whole = counted(&positions, 16);
        let mut backwards = positions.clone();
        backwards.reverse();
        assert_eq!(counted(&backwards, 16), whole);
        let mut merged = counted(&positions[..123], 16);
        merged.merge(&counted(&positions[123..], 16), 16);
        assert_eq!(merged, whole);
    }

    #[test]
    fn positions_between_are_empty() {
        let series = counted(&[3, 4, 6, 6], 8);
        assert_eq!((series.first, series.buckets), (3, vec![1, 1, 0, 2]));
    }

    #[test]
    fn a_lower_bound_later_is_kept() {
        let mut series = counted(&[0, 1, 2, 3, 4, 5, 6, 7], 8);
        *series.at(7, 2) += 1;
        assert_eq!((series.width(), series.buckets), (4, vec![4, 5]));
    }

    #[test]
    fn resolution_falls_with_the_number_of_series() {
        assert_eq!(resolution(8192, 1, 16, 256), 256);
        assert_eq!(resolution(8192, 100, 16, 256), 64);
        assert_eq!(resolution(8192, 100_000, 16, 256), 16);
    }
}
