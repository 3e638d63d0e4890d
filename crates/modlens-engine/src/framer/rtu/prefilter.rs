//! Which of many requests may be found in bytes with enough evidence: all of them looked at at once.
//!
//! Whatever happened to a frame, only bytes that agree with it speak for it, or those that a collision has taken bits
//! from. So the bits of all bytes that may agree bound what `align` can find. They are counted for 64 requests at a time:
//! bit number n of every sum stands in one word.

use crate::framer::rtu::index::{Set, MOST_LOST};

/// The length of nearly all requests that are polled. Longer ones are judged by so many of their bytes.
const LENGTH: usize = 8;

/// Shorter ones are not sifted: one byte is enough to find what is left of them.
const SHORTEST: usize = 5;

/// A long request is followed on if its first bytes are worth so many bits.
const BEGUN: f32 = 11.0;

/// Parts of a bit that are counted.
const PARTS: f32 = 1.5;

/// Bits of a sum: nine bytes of fourteen parts each.
const PLANES: usize = 7;

/// Sums of the same numbers in another order differ by less.
const ROUNDING: f32 = 0.01;

/// Bytes that are worth less agree with much.
const CHEAP: f32 = 5.0;

/// What happened to a frame, and the bits that saying so takes.
pub struct Costs {
    /// Bytes missing in front.
    pub head: f32,
    /// Bytes missing or doubled inside.
    pub inside: f32,
    /// Another sender's bits.
    pub collided: f32,
}

/// For the bytes of many requests and every value: those that have it there.
pub struct Sift {
    equal: Box<[[Set; 256]; LENGTH]>,
    /// Those that have its bits there, and perhaps more.
    cover: Box<[[Set; 256]; LENGTH]>,
    /// Those that are too short.
    short: Set,
    /// Those that have more bytes.
    long: Set,
}

impl Default for Sift {
    fn default() -> Self {
        Self { equal: Box::new([[0; 256]; LENGTH]), cover: Box::new([[0; 256]; LENGTH]), short: 0, long: 0 }
    }
}

impl Sift {
    /// Adds a request under a number that is free.
    pub fn add(&mut self, at: usize, frame: &[u8]) {
        self.change(at, frame, |set, one| set | one);
    }

    /// Takes the request of this number away.
    pub fn remove(&mut self, at: usize, frame: &[u8]) {
        self.change(at, frame, |set, one| set & !one);
    }

    fn change(&mut self, at: usize, frame: &[u8], change: impl Fn(Set, Set) -> Set) {
        let one = 1 << at;
        if frame.len() < SHORTEST {
            self.short = change(self.short, one);
            return;
        }
        if frame.len() > LENGTH {
            self.long = change(self.long, one);
        }
        for (place, &byte) in frame.iter().enumerate().take(LENGTH) {
            let put = |sets: &mut [Set; 256], value: u8| {
                let set = &mut sets[usize::from(value)];
                *set = change(*set, one);
            };
            put(&mut self.equal[place], byte);
            let mut part = byte;
            loop {
                put(&mut self.cover[place], part);
                if part == 0 {
                    break;
                }
                part = (part - 1) & byte;
            }
        }
    }

    /// Forgets the first request: each of the others takes the number before its own.
    pub fn shift(&mut self) {
        self.equal.iter_mut().chain(self.cover.iter_mut()).flatten().for_each(|set| *set >>= 1);
        self.short >>= 1;
        self.long >>= 1;
    }

    /// Those of `among` that may be found where these bytes begin with at least `need` bits.
    pub fn likely(&self, among: Set, bytes: &[u8], bits: impl Fn(u8) -> f32, need: f32, costs: &Costs) -> Set {
        let (short, long) = (among & self.short, among & self.long);
        let whole = among & !short & !long;
        let bytes = &bytes[..bytes.len().min(LENGTH + 1)];
        short | self.sifted(whole, bytes, &bits, need, costs) | self.sifted(long, bytes, &bits, need.min(BEGUN), costs)
    }

    fn sifted(&self, rest: Set, bytes: &[u8], bits: impl Fn(u8) -> f32, need: f32, costs: &Costs) -> Set {
        let Some(&first) = bytes.first().filter(|_| rest != 0) else { return 0 };
        let seen = Seen::of(bytes, bits);
        if seen.all() < need {
            return 0;
        }
        let equal = |place: usize, byte: u8| self.equal.get(place).map_or(0, |sets| sets[usize::from(byte)]);
        let later = |at: usize, byte: u8| (at + 1..=at + MOST_LOST).fold(0, |set, place| set | equal(place, byte));
        let around = |at: usize, byte: u8| later(at, byte) | equal(at, byte) | at.checked_sub(1).map_or(0, |at| equal(at, byte));
        let cover = |at: usize, byte: u8| self.cover.get(at).map_or(0, |sets| sets[usize::from(byte)]);
        // Nothing that happens inside is recognised without the first byte, and no lost beginning without two behind it.
        let begins = rest & equal(0, first);
        let headed = begins | bytes.get(1).map_or(0, |&second| rest & equal(1, second));
        let pair = |second: u8| (1..=MOST_LOST).fold(0, |set, head| set | equal(head, first) & equal(head + 1, second));
        let headless = bytes.get(1).map_or(0, |&second| rest & pair(second));
        let straight = seen.worth(headed, need, equal);
        let headless = seen.worth(headless, need + costs.head, later);
        let inside = seen.worth(begins, need + costs.inside, around);
        let collided = seen.worth(begins, need + costs.collided, cover);
        straight | headless | inside | collided
    }
}

/// Bytes in which requests are looked for, and what they are worth.
struct Seen<'a> {
    bytes: &'a [u8],
    bits: [f32; LENGTH + 1],
    /// Where those stand that are worth much, and how many these are.
    dear: [u8; LENGTH + 1],
    count: usize,
    /// What the others are worth in all, and the dearest byte.
    cheap: f32,
    dearest: f32,
}

impl<'a> Seen<'a> {
    /// At most one byte more than is judged.
    fn of(bytes: &'a [u8], bits: impl Fn(u8) -> f32) -> Self {
        let mut this = Self { bytes, bits: [0.0; LENGTH + 1], dear: [0; LENGTH + 1], count: 0, cheap: 0.0, dearest: 0.0 };
        for (at, &byte) in bytes.iter().enumerate() {
            let worth = bits(byte);
            let dear = worth >= CHEAP;
            // Without branches: which bytes are cheap, nobody can foresee.
            (this.bits[at], this.dear[this.count]) = (worth, at as u8);
            this.count += usize::from(dear);
            this.cheap += if dear { 0.0 } else { worth };
            this.dearest = this.dearest.max(if dear { worth } else { 0.0 });
        }
        this
    }

    /// All of them are worth no more.
    fn all(&self) -> f32 {
        self.cheap + self.count as f32 * self.dearest + ROUNDING
    }

    /// Those of `among` with which bytes agree that may be worth so many bits.
    fn worth(&self, among: Set, need: f32, agree: impl Fn(usize, u8) -> Set) -> Set {
        if among == 0 || self.all() < need {
            return 0;
        }
        // Nearly everywhere too few bytes agree, whatever the cheap ones do.
        let left = need - self.cheap;
        let (mut one, mut two, mut three) = (0, 0, 0);
        for &at in &self.dear[..self.count] {
            let agree = agree(usize::from(at), self.bytes[usize::from(at)]);
            three |= two & agree;
            two |= one & agree;
            one |= agree;
        }
        let enough = match left {
            _ if left <= ROUNDING => Set::MAX,
            _ if left <= self.dearest + ROUNDING => one,
            _ if left <= 2.0 * self.dearest + ROUNDING => two,
            _ => three,
        };
        if among & enough == 0 {
            return 0;
        }
        let mut sum = Sum::default();
        for (at, &byte) in self.bytes.iter().enumerate() {
            sum.add(agree(at, byte), (PARTS * self.bits[at]) as u32 + 1);
        }
        among & enough & sum.at_least(need)
    }
}

/// A sum for each of 64 requests.
#[derive(Default)]
struct Sum([Set; PLANES]);

impl Sum {
    /// Adds parts for these.
    fn add(&mut self, to: Set, parts: u32) {
        let mut carry = 0;
        for (bit, plane) in self.0.iter_mut().enumerate() {
            let one = if parts >> bit & 1 == 1 { to } else { 0 };
            let sum = *plane ^ one ^ carry;
            carry = *plane & one | carry & (*plane | one);
            *plane = sum;
        }
    }

    /// Those whose sum may be so many bits.
    fn at_least(&self, bits: f32) -> Set {
        let parts = (PARTS * bits).max(0.0) as u32;
        if parts >> PLANES != 0 {
            return 0;
        }
        let (mut more, mut same) = (0, Set::MAX);
        for (bit, &plane) in self.0.iter().enumerate().rev() {
            if parts >> bit & 1 == 1 {
                same &= plane;
            } else {
                more |= same & plane;
            }
        }
        more | same
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_those_of_numbers(adds in proptest::collection::vec((any::<u64>(), 0u32..15), 0..9), least in 0u32..130) {
            let mut sum = Sum::default();
            for &(to, parts) in &adds {
                sum.add(to, parts);
            }
            let set = sum.at_least(least as f32 / PARTS + 0.01);
            for at in 0..64 {
                let whole: u32 = adds.iter().filter(|(to, _)| to >> at & 1 == 1).map(|(_, parts)| parts).sum();
                prop_assert_eq!(set >> at & 1 == 1, whole >= least);
            }
        }
    }
}
