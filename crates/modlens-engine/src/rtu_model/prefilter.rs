//! A bit-parallel prefilter: which of 64 polled requests may be found in some bytes with enough evidence.
//!
//! Whatever happened to a frame, only bytes that agree with it count as evidence, or bytes that a collision has taken one
//! bits from. So the information content of all bytes that may agree is an upper bound of the score that `align` can find.
//! It is summed for 64 requests at a time: bit `n` of all 64 sums is in one machine word.

use std::ops::Range;

use crate::rtu_model::prefix_index::{FrameSet, MAX_LOST_BYTES};
use crate::weights::{LONG_REQUEST_PREFIX_BITS, MAX_HEADER_FLIPS, OTHER_BYTE_BITS, ROUNDING_BITS};

/// The length of nearly all requests that are polled. Longer ones are judged by this many of their bytes.
const JUDGED_BYTES: usize = 8;

/// Shorter requests always pass: one byte is enough to find what is left of them.
const MIN_JUDGED_BYTES: usize = 5;

/// Sums count fractions of a bit: this many make a bit. It decides how sharp the filter is, never what `align` finds.
const STEPS_PER_BIT: f32 = 1.5;

/// Binary digits of the steps of one byte, of which there are at most fourteen.
const STEP_PLANES: usize = 4;

/// Binary digits of a sum of nine bytes.
const SUM_PLANES: usize = 7;

/// Bytes with less information content are common, and agree with many requests: they are counted last.
const COMMON_BYTE_BITS: f32 = 5.0;

/// The places of the tables: the last ones, from `JUDGED_BYTES` on, are empty, so that nobody has to ask whether a place is there.
const PLACES: usize = JUDGED_BYTES + 1 + MAX_LOST_BYTES;

/// By place and byte value, requests.
type Table = Box<[[FrameSet; 256]; PLACES]>;

/// Requests are kept by their lengths, which are less than this.
pub const MAX_LENGTHS: usize = 24;

/// What it costs, in bits, to say what happened to a frame.
pub struct DamageCosts {
    /// Bytes are missing in front.
    pub lost_head: f32,
    /// Bytes are missing inside, or one is there twice.
    pub inside: f32,
    /// Another sender talked into it.
    pub collision: f32,
}

/// For each place of 64 requests and every byte value, the requests that have it there.
pub struct RequestPrefilter {
    equal: Table,
    /// The requests that have it one to `MAX_LOST_BYTES` places after this one: so many bytes in front may be missing.
    behind: Table,
    /// The requests that have it there, one place before (a byte may be there twice), or one to `MAX_LOST_BYTES` places after
    /// (bytes inside may be missing).
    around: Table,
    /// The requests whose byte there has all one bits of this value, and perhaps more: another sender may have pulled the others to
    /// 0.
    covering: Table,
    /// The requests whose unit is this value but for `MAX_HEADER_FLIPS` bits at most.
    near_unit: Box<[FrameSet; 256]>,
    /// Requests of fewer than `MIN_JUDGED_BYTES`.
    short: FrameSet,
    /// Requests of more than `JUDGED_BYTES`.
    long: FrameSet,
    /// Requests by their number of bytes.
    with_length: [FrameSet; MAX_LENGTHS],
}

/// What the bytes at a place have to be worth, in bits, to be a damaged request.
#[derive(Clone, Copy)]
pub struct Need {
    /// For these requests.
    pub less: f32,
    /// The requests that need no more than that.
    pub of_these: FrameSet,
    /// For all others.
    pub more: f32,
}

impl Default for RequestPrefilter {
    fn default() -> Self {
        let sets = || vec![[0; 256]; PLACES].into_boxed_slice().try_into().expect("as many places as were made");
        let (short, long) = (0, 0);
        let near_unit = Box::new([0; 256]);
        let with_length = [0; MAX_LENGTHS];
        Self { equal: sets(), behind: sets(), around: sets(), covering: sets(), near_unit, short, long, with_length }
    }
}

/// By the way in which a damaged frame is looked for, the requests that `damage::alignment` (`align`) does not give up at once
/// by the first two bytes.
struct Ways {
    /// The unit agrees. Only such a request is damaged inside, or by another sender.
    begins: FrameSet,
    /// Some bits are flipped: the unit or the function agrees, and the other nearly.
    headed: FrameSet,
    /// Bytes are missing in front.
    headless: FrameSet,
}

/// The bytes with `MAX_HEADER_FLIPS` one bits at most.
const FEW_FLIPS: [u8; 93] = {
    let mut few = [0; 93];
    let (mut flips, mut found) = (0, 0);
    while flips < 256 {
        if (flips as u32).count_ones() <= MAX_HEADER_FLIPS {
            few[found] = flips as u8;
            found += 1;
        }
        flips += 1;
    }
    assert!(found == few.len());
    few
};

/// All values whose one bits are among those of the byte, from the byte itself down to 0.
fn values_covered_by(byte: u8) -> impl Iterator<Item = u8> {
    std::iter::successors(Some(byte), move |&value| (value > 0).then(|| (value - 1) & byte))
}

impl RequestPrefilter {
    /// Adds a request under a number that is free.
    pub fn add(&mut self, number: usize, frame: &[u8]) {
        self.update(number, frame, |set, one| set | one);
    }

    /// Removes the request of this number.
    pub fn remove(&mut self, number: usize, frame: &[u8]) {
        self.update(number, frame, |set, one| set & !one);
    }

    /// Sets or clears (`change`) the bit of request `number` in the sets that its bytes belong to. A request of fewer than
    /// `MIN_JUDGED_BYTES` is in `short` only; of a longer one the first `JUDGED_BYTES` count.
    fn update(&mut self, number: usize, frame: &[u8], change: impl Fn(FrameSet, FrameSet) -> FrameSet) {
        let one = 1 << number;
        if let Some(same) = self.with_length.get_mut(frame.len()) {
            *same = change(*same, one);
        }
        if frame.len() < MIN_JUDGED_BYTES {
            self.short = change(self.short, one);
            return;
        }
        if frame.len() > JUDGED_BYTES {
            self.long = change(self.long, one);
        }
        let put = |sets: &mut [FrameSet; 256], value: u8| {
            let set = &mut sets[usize::from(value)];
            *set = change(*set, one);
        };
        for flips in FEW_FLIPS {
            put(&mut self.near_unit, frame[0] ^ flips);
        }
        for (place, &byte) in frame.iter().enumerate().take(JUDGED_BYTES) {
            put(&mut self.equal[place], byte);
            (place.saturating_sub(MAX_LOST_BYTES)..place).for_each(|before| put(&mut self.behind[before], byte));
            (place.saturating_sub(MAX_LOST_BYTES)..=place + 1).for_each(|around| put(&mut self.around[around], byte));
            values_covered_by(byte).for_each(|value| put(&mut self.covering[place], value));
        }
    }

    /// The requests that have one of these numbers of bytes.
    pub fn with_length_in(&self, lengths: Range<usize>) -> FrameSet {
        let end = lengths.end.min(MAX_LENGTHS);
        self.with_length[lengths.start.min(end)..end].iter().fold(0, |all, set| all | set)
    }

    /// Those of `among` that may be found at the beginning of these bytes with as many bits as they need; `bits` is the
    /// information content of a byte.
    pub fn likely(&self, among: FrameSet, bytes: &[u8], bits: impl Fn(u8) -> f32, need: Need, costs: &DamageCosts) -> FrameSet {
        let (short, ways) = (among & self.short, self.ways(bytes));
        let among = among & !short & (ways.headed | ways.headless);
        if among == 0 {
            return short;
        }
        let observed = ObservedBytes::of(bytes, bits);
        let classes = [
            (among & need.of_these & !self.long, need.less),
            (among & !need.of_these & !self.long, need.more),
            (among & self.long, need.less.min(LONG_REQUEST_PREFIX_BITS)),
        ];
        short | self.filter(&classes, &ways, &observed, costs)
    }

    /// The requests of five bytes and more by how they may stand, damaged, at the first of these bytes. `align` accepts damage
    /// inside a frame only if its first byte agrees, flipped bits only if one of the first two does and few bits of the other
    /// are flipped, and missing leading bytes only if the two bytes after them agree.
    fn ways(&self, bytes: &[u8]) -> Ways {
        let begins = bytes.first().map_or(0, |&first| self.equal_at(0, first));
        let &[first, second, ..] = bytes else { return Ways { begins, headed: begins, headless: 0 } };
        let headed = begins | (self.equal_at(1, second) & self.near_unit[usize::from(first)]);
        Ways { begins, headed, headless: self.with_pair_inside(first, second) }
    }

    /// Those of the requests that may reach the bits that their class needs in one of the ways in which `damage::alignment`
    /// (`align`) looks for a damaged frame at the first of these bytes: flipped bits only, bytes missing in front, damage inside,
    /// or a collision. None is left out wrongly: the sums are upper bounds.
    ///
    /// For each way there are the requests that may be damaged so, and those that may agree with a byte at a place. What passes
    /// in one way need not be tried in the next.
    fn filter(&self, classes: &Classes, ways: &Ways, observed: &ObservedBytes<'_>, costs: &DamageCosts) -> FrameSet {
        let among = classes.iter().fold(0, |all, (set, _)| all | set);
        let mut passed = observed.may_reach(among & ways.headed, classes, 0.0, &self.equal);
        passed |= observed.may_reach(among & ways.headless & !passed, classes, costs.lost_head, &self.behind);
        passed |= observed.may_reach(among & ways.begins & !passed, classes, costs.inside, &self.around);
        passed | observed.may_reach(among & ways.begins & !passed, classes, costs.collision, &self.covering)
    }

    /// The requests that have this byte at this place, the first one being 0; none from place `JUDGED_BYTES` on.
    #[inline]
    fn equal_at(&self, place: usize, byte: u8) -> FrameSet {
        self.equal[place][usize::from(byte)]
    }

    /// The requests that have these two bytes side by side, the first of them one to `MAX_LOST_BYTES` places after the
    /// beginning.
    fn with_pair_inside(&self, first: u8, second: u8) -> FrameSet {
        (1..=MAX_LOST_BYTES).fold(0, |set, lost| set | self.equal_at(lost, first) & self.equal_at(lost + 1, second))
    }
}

/// Requests by what they need, in bits.
type Classes = [(FrameSet, f32); 3];

/// The bytes in which requests are looked for, with their information content: at most one more than is judged, since a byte may
/// be there twice.
struct ObservedBytes<'a> {
    bytes: &'a [u8],
    bits: [f32; JUDGED_BYTES + 1],
    /// The places of bytes that are not common, one bit each.
    rare: u32,
    /// Information content of all common bytes together.
    common_bits: f32,
}

/// No byte has more bits than this.
const MAX_BYTE_BITS: f32 = OTHER_BYTE_BITS + ROUNDING_BITS;

impl<'a> ObservedBytes<'a> {
    /// The first of these bytes.
    #[inline]
    fn of(bytes: &'a [u8], bits: impl Fn(u8) -> f32) -> Self {
        let bytes = &bytes[..bytes.len().min(JUDGED_BYTES + 1)];
        let mut this = Self { bytes, bits: [0.0; JUDGED_BYTES + 1], rare: 0, common_bits: 0.0 };
        for (at, (&byte, known)) in bytes.iter().zip(&mut this.bits).enumerate() {
            let content = bits(byte);
            *known = content;
            // Without branches: the processor could not predict which bytes are common.
            this.rare |= u32::from(content >= COMMON_BYTE_BITS) << at;
            this.common_bits += if content >= COMMON_BYTE_BITS { 0.0 } else { content };
        }
        this
    }

    /// Those of `among` with which bytes of so many bits together may agree as their class needs and the damage costs, an upper
    /// bound; `agreeing` has by place and byte value the requests that agree with a byte. Sums are made only for requests with
    /// which enough of the rare bytes agree.
    #[inline]
    fn may_reach(&self, among: FrameSet, classes: &Classes, cost: f32, agreeing: &[[FrameSet; 256]; PLACES]) -> FrameSet {
        if among == 0 {
            return 0;
        }
        let enough = self.with_enough_rare_bytes(classes, cost, agreeing);
        let among = among & enough;
        if among == 0 {
            return 0;
        }
        let mut sums = ParallelSums::default();
        for ((&byte, bits), agreeing) in self.bytes.iter().zip(self.bits).zip(agreeing) {
            let agree = among & agreeing[usize::from(byte)];
            if agree != 0 {
                // Rounded up, so that the sum stays an upper bound.
                sums.add(agree, (STEPS_PER_BIT * bits) as u32 + 1);
            }
        }
        let reaching = |&(set, need): &(FrameSet, f32)| if among & set == 0 { 0 } else { set & sums.at_least(need + cost) };
        among & classes.iter().map(reaching).fold(0, |all, set| all | set)
    }

    /// The requests with which so many rare bytes agree that these, with all of the common ones, may be worth what their class
    /// needs: none, one, two, or at least three. Nearly everywhere too few do.
    #[inline]
    fn with_enough_rare_bytes(&self, classes: &Classes, cost: f32, agreeing: &[[FrameSet; 256]; PLACES]) -> FrameSet {
        let (mut one, mut two, mut three) = (0, 0, 0);
        let mut rare = self.rare;
        while rare != 0 {
            let at = rare.trailing_zeros() as usize;
            rare &= rare - 1;
            let agree = agreeing[at][usize::from(self.bytes[at])];
            three |= two & agree;
            two |= one & agree;
            one |= agree;
        }
        let mut enough = 0;
        for &(set, need) in classes {
            let need = need + cost - self.common_bits;
            enough |= set
                & match need {
                    _ if need <= ROUNDING_BITS => FrameSet::MAX,
                    _ if need <= MAX_BYTE_BITS + ROUNDING_BITS => one,
                    _ if need <= 2.0 * MAX_BYTE_BITS + ROUNDING_BITS => two,
                    _ => three,
                };
        }
        enough
    }
}

/// A sum for each of 64 requests, bit-sliced: plane `n` holds binary digit `n` of all sums.
#[derive(Default)]
struct ParallelSums([FrameSet; SUM_PLANES]);

impl ParallelSums {
    /// Adds the same number of steps, fewer than `1 << STEP_PLANES`, to the sums of these requests: a ripple-carry adder on
    /// whole words.
    #[inline]
    fn add(&mut self, to: FrameSet, steps: u32) {
        let (low, high) = self.0.split_at_mut(STEP_PLANES);
        let mut carry = 0;
        for (digit, plane) in low.iter_mut().enumerate() {
            let one = to & 0u64.wrapping_sub(u64::from(steps >> digit & 1));
            let sum = *plane ^ one ^ carry;
            carry = *plane & one | carry & (*plane | one);
            *plane = sum;
        }
        for plane in high {
            (*plane, carry) = (*plane ^ carry, *plane & carry);
        }
    }

    /// The requests whose sum may be this many bits: a comparison of all sums with one number, highest digit first.
    fn at_least(&self, bits: f32) -> FrameSet {
        let steps = (STEPS_PER_BIT * bits).max(0.0) as u32;
        if steps >> SUM_PLANES != 0 {
            return 0;
        }
        let (mut greater, mut equal) = (0, FrameSet::MAX);
        for (digit, &plane) in self.0.iter().enumerate().rev() {
            if steps >> digit & 1 == 1 {
                equal &= plane;
            } else {
                greater |= equal & plane;
            }
        }
        greater | equal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn parallel_sums_equal_sums_of_single_numbers(adds in proptest::collection::vec((any::<u64>(), 0u32..15), 0..9), least in 0u32..130) {
            let mut sums = ParallelSums::default();
            for &(to, steps) in &adds {
                sums.add(to, steps);
            }
            let set = sums.at_least(least as f32 / STEPS_PER_BIT + 0.01);
            for at in 0..64 {
                let whole: u32 = adds.iter().filter(|(to, _)| to >> at & 1 == 1).map(|(_, steps)| steps).sum();
                prop_assert_eq!(set >> at & 1 == 1, whole >= least);
            }
        }
    }
}
