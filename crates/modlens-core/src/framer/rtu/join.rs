//! Every substring with a right CRC, in constant time a byte.
//!
//! With P the CRC register over all bytes so far (start value 0) and T its step on a zero byte, `[i, j)` is valid if
//! and only if T^-i(FFFF xor P[i]) = T^-j(P[j]). So each position has a key as a start and a key as an end, and starts
//! wait in a table until an end with their key comes. T^-k P[k] grows by T^-k(byte).
//!
//! The step is linear. One bit of it, backwards, on 0001 gives 0002, 0004 and so on; so the effects T^-k of the eight
//! bits of a byte are neighbours in the sequence that these single steps run through, and the sequence comes round
//! after 32,767 of them (the order of x modulo the polynomial). It stands in a table, and a byte takes eight
//! neighbours from it, masks and sums them.

use std::sync::OnceLock;

/// The longest frame that is looked for.
pub const REACH: u64 = 272;

/// Starts with one key that are followed; zeros and crafted bytes make endless chains of equal keys.
const CHAIN: usize = 32;

/// The ring of waiting starts; more than `REACH`, a power of two.
const RING: usize = 512;

/// Lists of waiting starts. Few enough for the nearest cache, many enough to be nearly always empty.
const LISTS: usize = 4096;

/// The order of x modulo the polynomial: after so many single steps everything comes round.
const ORDER: usize = 32_767;

/// Effects of single bits and of the start value FFFF, so many positions on.
struct Powers {
    /// Single steps backwards from 0001 on; the first eight come again at the end.
    bits: Vec<u16>,
    /// T^-k(FFFF).
    ones: Vec<u16>,
    /// For every byte, FFFF where its bits are set, the lowest first.
    masks: Vec<[u16; 8]>,
}

/// One bit of the register's step, backwards.
fn back(state: u16) -> u16 {
    // The polynomial's highest bit is set by a step if and only if a one was shifted out.
    if state & 0x8000 == 0 {
        state << 1
    } else {
        (state ^ 0xA001) << 1 | 1
    }
}

fn powers() -> &'static Powers {
    static POWERS: OnceLock<Powers> = OnceLock::new();
    POWERS.get_or_init(|| {
        let steps = |from: u16| std::iter::successors(Some(from), |&state| Some(back(state)));
        let mask = |byte: usize| std::array::from_fn(|i| 0u16.wrapping_sub((byte >> i & 1) as u16));
        Powers {
            bits: steps(1).take(ORDER + 8).collect(),
            ones: steps(0xFFFF).step_by(8).take(ORDER).collect(),
            masks: (0..256).map(mask).collect(),
        }
    })
}

/// The state of the join over one stretch of bytes.
pub struct Join {
    powers: &'static Powers,
    /// Latest start in each list, as position + 1, with its low 32 bits.
    heads: Box<[u32; LISTS]>,
    /// By position: its key, and the start before in the same list.
    ring: Box<[(u16, u32); RING]>,
    /// The stretch began here.
    floor: u64,
    /// T^-k P[k].
    prefix: u16,
    /// Positions since the beginning, modulo the order.
    turn: usize,
}

impl Default for Join {
    fn default() -> Self {
        Self {
            powers: powers(),
            heads: Box::new([0; LISTS]),
            ring: Box::new([(0, 0); RING]),
            floor: 0,
            prefix: 0,
            turn: 0,
        }
    }
}

impl Join {
    /// Begins anew at this position: no frame reaches across.
    pub fn restart(&mut self, position: u64) {
        self.floor = position;
        self.prefix = 0;
        self.turn = 0;
    }

    /// Takes the byte at `position`; `found` gets the starts of all valid substrings that end behind it, the latest first.
    #[inline]
    pub fn push(&mut self, position: u64, byte: u8, found: &mut Vec<u64>) {
        found.clear();
        let key = self.prefix ^ self.powers.ones[self.turn];
        let head = &mut self.heads[usize::from(key) % LISTS];
        self.ring[position as usize % RING] = (key, *head);
        *head = (position as u32).wrapping_add(1);
        let at = 8 * self.turn % ORDER;
        let effects = &self.powers.bits[at..at + 8];
        let masks = &self.powers.masks[usize::from(byte)];
        self.prefix ^= effects.iter().zip(masks).fold(0, |sum, (effect, mask)| sum ^ (effect & mask));
        self.turn = if self.turn + 1 == ORDER { 0 } else { self.turn + 1 };
        let (first, end) = (self.heads[usize::from(self.prefix) % LISTS], position + 1);
        if Self::behind(first, end) <= REACH {
            self.follow(first, end, found);
        }
    }

    /// How far before `end` a start is.
    fn behind(start: u32, end: u64) -> u64 {
        u64::from((end as u32).wrapping_add(1).wrapping_sub(start))
    }

    /// Goes through a list, from its latest start on.
    fn follow(&self, mut start: u32, end: u64, found: &mut Vec<u64>) {
        let mut length = 0;
        let mut equal = 0;
        while equal < CHAIN {
            // Older entries of the table belong to positions that are over; their numbers may have come round.
            let behind = Self::behind(start, end);
            if behind <= length || behind > REACH || end - self.floor < behind {
                break;
            }
            length = behind;
            let at = end - behind;
            let (key, before) = self.ring[at as usize % RING];
            if key == self.prefix {
                equal += 1;
                if behind >= 4 {
                    found.push(at);
                }
            }
            start = before;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checksum::{crc16, step};
    use proptest::prelude::*;

    #[test]
    fn eight_times_back_undoes_a_step() {
        for state in 0..=u16::MAX {
            assert_eq!((0..8).fold(step(state, 0), |state, _| back(state)), state);
        }
    }

    #[test]
    fn the_tables_come_round() {
        let powers = powers();
        assert_eq!(powers.bits[ORDER..], powers.bits[..8]);
        assert_eq!(powers.ones.len(), ORDER);
        // T^-1 of the last of them is the first one again.
        assert_eq!((0..8).fold(powers.ones[ORDER - 1], |state, _| back(state)), 0xFFFF);
    }

    fn naive(data: &[u8]) -> Vec<(u64, u64)> {
        let mut all = Vec::new();
        for end in 0..=data.len() {
            for start in (end.saturating_sub(REACH as usize)..end.saturating_sub(3)).rev() {
                if crc16(&data[start..end]) == 0 {
                    all.push((start as u64, end as u64));
                }
            }
        }
        all
    }

    fn joined(data: &[u8]) -> Vec<(u64, u64)> {
        let mut join = Join::default();
        join.restart(0);
        let (mut all, mut found) = (Vec::new(), Vec::new());
        for (i, &byte) in data.iter().enumerate() {
            join.push(i as u64, byte, &mut found);
            all.extend(found.iter().map(|&start| (start, i as u64 + 1)));
        }
        all
    }

    #[test]
    fn positions_beyond_four_gigabytes_and_more_bytes_than_the_order() {
        let body = [1u8, 3, 0, 10, 0, 2];
        let frame = [&body[..], &crc16(&body).to_le_bytes()].concat();
        let from = (1u64 << 32) - 100_000;
        let (mut join, mut found) = (Join::default(), Vec::new());
        join.restart(from);
        let mut ends = 0;
        for (i, &byte) in frame.iter().cycle().take(200_000).enumerate() {
            join.push(from + i as u64, byte, &mut found);
            if i % 8 == 7 {
                assert!(found.contains(&(from + i as u64 - 7)), "{i}");
                ends += 1;
            }
        }
        assert_eq!(ends, 25_000);
    }

    proptest! {
        #[test]
        fn finds_what_the_naive_search_finds(parts in proptest::collection::vec((proptest::collection::vec(any::<u8>(), 2..40), 0usize..4), 0..12)) {
            let mut data = Vec::new();
            for (body, zeros) in parts {
                data.extend(&body);
                data.extend(crc16(&body).to_le_bytes());
                data.extend(std::iter::repeat_n(0, zeros));
            }
            prop_assert_eq!(joined(&data), naive(&data));
        }
    }
}
