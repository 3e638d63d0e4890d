//! Which of many requests may be found in bytes with enough evidence: all of them looked at at once.
//!
//! Whatever happened to a frame, only bytes that agree with it speak for it, or those that a collision has taken bits
//! from. So the bits of all bytes that may agree bound what `align` can find. They are counted for 64 requests at a time:
//! bit number n of every sum stands in one word.

use crate::framer::rtu::index::{Set, MOST_LOST};

/// The length of nearly all requests that are polled; others are not sifted.
const LENGTH: usize = 8;

/// Parts of a bit that are counted.
const PARTS: f32 = 1.5;

/// Bits of a sum: nine bytes of fourteen parts each.
const PLANES: usize = 7;

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
    /// Those of another length.
    others: Set,
}

impl Default for Sift {
    fn default() -> Self {
        Self { equal: Box::new([[0; 256]; LENGTH]), cover: Box::new([[0; 256]; LENGTH]), others: 0 }
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
        if frame.len() != LENGTH {
            self.others = change(self.others, one);
            return;
        }
        for (place, &byte) in frame.iter().enumerate() {
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
        self.others >>= 1;
    }

    /// Those that have this byte here, further on, before, or with more bits.
    fn near(&self, at: usize, byte: u8) -> [Set; 4] {
        let byte = usize::from(byte);
        let equal = |place: usize| self.equal.get(place).map_or(0, |sets| sets[byte]);
        let later = (at + 1..=at + MOST_LOST).fold(0, |set, place| set | equal(place));
        let before = at.checked_sub(1).map_or(0, equal);
        [equal(at), later, before, self.cover.get(at).map_or(0, |sets| sets[byte])]
    }

    /// Those with which so many of the dear bytes agree somehow as `need` bits take, whatever the cheap ones do.
    fn hopeful(&self, among: Set, bytes: &[u8], bits: impl Fn(u8) -> f32, need: f32) -> Set {
        let (mut left, mut dear) = (need, 0.0f32);
        let (mut one, mut two, mut three) = (0, 0, 0);
        for (at, &byte) in bytes.iter().enumerate() {
            let worth = bits(byte);
            if worth < CHEAP {
                left -= worth;
                continue;
            }
            dear = dear.max(worth);
            let agree = self.near(at, byte).iter().fold(0, |sets, set| sets | set);
            three |= two & agree;
            two |= one & agree;
            one |= agree;
        }
        let enough = if left <= 0.0 {
            Set::MAX
        } else if left <= dear {
            one
        } else if left <= 2.0 * dear {
            two
        } else {
            three
        };
        among & enough
    }

    /// Those of `among` that may be found where these bytes begin with at least `need` bits.
    pub fn likely(&self, among: Set, bytes: &[u8], bits: impl Fn(u8) -> f32, need: f32, costs: &Costs) -> Set {
        let bytes = &bytes[..bytes.len().min(LENGTH + 1)];
        let rest = self.hopeful(among & !self.others, bytes, &bits, need);
        if rest == 0 {
            return among & self.others;
        }
        let (mut straight, mut head, mut inside, mut collided) = (Sum::default(), Sum::default(), Sum::default(), Sum::default());
        for (at, &byte) in bytes.iter().enumerate() {
            let worth = parts(bits(byte));
            let [here, later, before, cover] = self.near(at, byte);
            straight.add(here, worth);
            head.add(later, worth);
            inside.add(here | later | before, worth);
            collided.add(here, worth);
            // Of a byte that lost bits, one at least is gone; a zero may have been any.
            collided.add(cover & !here, parts(bits(byte) - 0.5 - byte.count_ones().max(1) as f32));
        }
        let begins = bytes.first().map_or(0, |&byte| self.equal[0][usize::from(byte)]);
        let inside = inside.at_least(need + costs.inside) | collided.at_least(need + costs.collided);
        let found = straight.at_least(need) | head.at_least(need + costs.head) | begins & inside;
        among & self.others | rest & found
    }
}

/// Parts of so many bits, rounded up.
fn parts(bits: f32) -> u32 {
    if bits > 0.0 {
        (PARTS * bits) as u32 + 1
    } else {
        0
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
