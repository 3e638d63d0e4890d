//! Where in a line the bytes of a dialect may begin: one pass over it for all rules, up to the first that fits.

use memchr::{memchr, memchr2, memchr3};

use crate::text::dialect::Role;
use crate::text::template::Template;

/// Rules that have a bit of their own; the last bit is that of all others.
const BITS: usize = 64;

/// The rules of a dialect that hold bytes, by the character that they begin with.
#[derive(Clone, Debug)]
pub(super) struct Starts {
    /// The first rule that holds bytes; those before it are looked for one by one.
    pub first: usize,
    /// Rules that begin at the start of what is left of a line.
    pub tied: Vec<usize>,
    /// A character, and the rules that may begin with it.
    masks: Box<[u64; 256]>,
    /// The same for the character behind it.
    second: Box<[u64; 256]>,
    /// The characters, where they are few.
    few: Vec<u8>,
}

impl Starts {
    /// Sorts the rules; those without bytes stand first.
    pub fn of(rules: &[(Role, Template)]) -> Self {
        let first = rules.iter().position(|(role, _)| role.holds_bytes()).unwrap_or(rules.len());
        let none = Box::new([0; 256]);
        let mut starts = Self { first, tied: Vec::new(), masks: none.clone(), second: none, few: Vec::new() };
        for (i, (_, template)) in rules.iter().enumerate().skip(first) {
            let bit = 1 << (i - first).min(BITS - 1);
            match *template.anchor_text() {
                [] => starts.tied.push(i),
                [one] => {
                    starts.masks[one as usize] |= bit;
                    starts.second.iter_mut().for_each(|mask| *mask |= bit);
                }
                [one, two, ..] => {
                    starts.masks[one as usize] |= bit;
                    starts.second[two as usize] |= bit;
                }
            }
        }
        starts.few = (0..=u8::MAX).filter(|&b| starts.masks[b as usize] != 0).collect();
        starts
    }

    /// The next place from `at` on where a rule may begin.
    pub fn next(&self, line: &[u8], at: usize) -> Option<usize> {
        let rest = line.get(at..)?;
        let hit = match self.few[..] {
            [] => None,
            [one] => memchr(one, rest),
            [one, two] => memchr2(one, two, rest),
            [one, two, three] => memchr3(one, two, three, rest),
            _ => (0..rest.len()).find(|&at| self.mask(rest, at) != 0),
        };
        hit.map(|hit| at + hit)
    }

    /// The rules that may begin here, in their order; `count` is that of all rules.
    pub fn rules(&self, line: &[u8], at: usize, count: usize) -> impl Iterator<Item = usize> {
        let (mut mask, first) = (self.mask(line, at), self.first);
        let others = if mask >> (BITS - 1) == 1 { first + BITS - 1..count } else { 0..0 };
        mask &= !(1 << (BITS - 1));
        std::iter::from_fn(move || {
            let bit = mask.trailing_zeros() as usize;
            mask &= mask.wrapping_sub(1);
            (bit < BITS).then_some(first + bit)
        })
        .chain(others)
    }

    fn mask(&self, line: &[u8], at: usize) -> u64 {
        let second = line.get(at + 1).map_or(u64::MAX, |&b| self.second[b as usize]);
        self.masks[line[at] as usize] & second
    }
}
