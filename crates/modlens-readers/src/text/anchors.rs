//! An index of the rules of a dialect by the first characters of their templates. With it one pass over a line finds the
//! places where any of the rules may match, instead of one pass per rule.

use memchr::{memchr, memchr2, memchr3};

use crate::text::role::LineRole;
use crate::text::template::Template;

/// The number of bits in a mask of rules. Rules beyond this number share the last bit.
const BITS: usize = 64;

/// The rules of a dialect that yield bytes, by the two characters that their matches begin with.
#[derive(Clone, Debug)]
pub(super) struct AnchorIndex {
    /// Index of the first rule that yields bytes; the rules before it are not indexed.
    pub first_rule_with_bytes: usize,
    /// Rules without fixed text at their beginning: they can match only at the start of the text that is left.
    pub unanchored: Vec<usize>,
    /// For each character, the mask of the rules that may begin with it.
    first_char_masks: Box<[u64; 256]>,
    /// For each character, the mask of the rules that may have it as their second character.
    second_char_masks: Box<[u64; 256]>,
    /// All characters that any rule begins with; up to three of them can be searched for at the speed of `memchr`.
    first_chars: Vec<u8>,
}

impl AnchorIndex {
    /// Builds the index; rules without bytes must stand before all others.
    pub fn of(rules: &[(LineRole, Template)]) -> Self {
        let first = rules.iter().position(|(role, _)| role.holds_bytes()).unwrap_or(rules.len());
        let none = Box::new([0; 256]);
        let mut index = Self {
            first_rule_with_bytes: first,
            unanchored: Vec::new(),
            first_char_masks: none.clone(),
            second_char_masks: none,
            first_chars: Vec::new(),
        };
        for (i, (_, template)) in rules.iter().enumerate().skip(first) {
            let bit = 1 << (i - first).min(BITS - 1);
            match *template.anchor_text() {
                [] => index.unanchored.push(i),
                [one] => {
                    index.first_char_masks[one as usize] |= bit;
                    index.second_char_masks.iter_mut().for_each(|mask| *mask |= bit);
                }
                [one, two, ..] => {
                    index.first_char_masks[one as usize] |= bit;
                    index.second_char_masks[two as usize] |= bit;
                }
            }
        }
        index.first_chars = (0..=u8::MAX).filter(|&b| index.first_char_masks[b as usize] != 0).collect();
        index
    }

    /// The next position from `at` on where a match of any indexed rule may begin.
    pub fn next(&self, line: &[u8], at: usize) -> Option<usize> {
        let rest = line.get(at..)?;
        let hit = match self.first_chars[..] {
            [] => None,
            [one] => memchr(one, rest),
            [one, two] => memchr2(one, two, rest),
            [one, two, three] => memchr3(one, two, three, rest),
            _ => (0..rest.len()).find(|&at| self.mask(rest, at) != 0),
        };
        hit.map(|hit| at + hit)
    }

    /// The rules that may match at this position, in the order of the dialect; `count` is the number of all its rules.
    pub fn rules(&self, line: &[u8], at: usize, count: usize) -> impl Iterator<Item = usize> {
        let (mut mask, first) = (self.mask(line, at), self.first_rule_with_bytes);
        let others = if mask >> (BITS - 1) == 1 { first + BITS - 1..count } else { 0..0 };
        mask &= !(1 << (BITS - 1));
        std::iter::from_fn(move || {
            let bit = mask.trailing_zeros() as usize;
            mask &= mask.wrapping_sub(1);
            (bit < BITS).then_some(first + bit)
        })
        .chain(others)
    }

    /// The mask of the rules whose first two characters stand at this position.
    fn mask(&self, line: &[u8], at: usize) -> u64 {
        let second = line.get(at + 1).map_or(u64::MAX, |&b| self.second_char_masks[b as usize]);
        self.first_char_masks[line[at] as usize] & second
    }
}
