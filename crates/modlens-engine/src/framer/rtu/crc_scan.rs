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

use modlens_protocol::checksum::ORDER;

/// The longest frame that is looked for.
pub const REACH: u64 = 272;

/// Starts with one key that are followed; zeros and crafted bytes make endless chains of equal keys.
const CHAIN: usize = 32;

/// The ring of waiting starts; more than `REACH`, a power of two.
const RING: usize = 512;

/// Lists of waiting starts. Few enough for the nearest cache, many enough to be nearly always empty.
const LISTS: usize = 4096;

/// Effects of single bits and of the start value FFFF, so many positions on.
struct Powers {
    /// Single steps backwards from 0001 on; the first eight come again at the end.
    bits: Vec<u16>,
    /// T^-k(FFFF).
    ones: Vec<u16>,
    /// For every byte, FFFF where its bits are set, the lowest first.
    masks: Box<[[u16; 8]; 256]>,
}

/// One bit of the register's step, backwards.
pub fn back(state: u16) -> u16 {
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
            masks: Box::new(std::array::from_fn(mask)),
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
        Self { powers: powers(), heads: Box::new([0; LISTS]), ring: Box::new([(0, 0); RING]), floor: 0, prefix: 0, turn: 0 }
    }
}

impl Join {
    /// Begins anew at this position: no frame reaches across.
    pub fn restart(&mut self, position: u64) {
        self.floor = position;
        self.prefix = 0;
        self.turn = 0;
    }

    /// Takes bytes, the first of them at `position`, until valid substrings end behind one; says how many it took.
    ///
    /// `found` gets their starts, the latest first; nothing, if all bytes were taken and no substring ends with the last.
    pub fn scan(&mut self, position: u64, bytes: &[u8], found: &mut Vec<u64>) -> usize {
        found.clear();
        let Powers { bits, ones, masks } = self.powers;
        let (heads, ring) = (&mut *self.heads, &mut *self.ring);
        let (mut prefix, mut turn, mut effect, mut start) = (self.prefix, self.turn, 8 * self.turn % ORDER, position as u32);
        let mut taken = bytes.len();
        for (i, &byte) in bytes.iter().enumerate() {
            let key = prefix ^ ones[turn];
            let head = &mut heads[usize::from(key) % LISTS];
            ring[start as usize % RING] = (key, *head);
            start = start.wrapping_add(1);
            *head = start;
            let effects: &[u16; 8] = bits[effect..effect + 8].try_into().expect("eight of them");
            let mask = &masks[usize::from(byte)];
            prefix ^= (0..8).fold(0, |sum, bit| sum ^ (effects[bit] & mask[bit]));
            turn = if turn + 1 == ORDER { 0 } else { turn + 1 };
            effect = if effect + 8 >= ORDER { effect + 8 - ORDER } else { effect + 8 };
            let first = heads[usize::from(prefix) % LISTS];
            if u64::from(start.wrapping_add(1).wrapping_sub(first)) <= REACH {
                follow(ring, first, prefix, position + i as u64 + 1, self.floor, found);
                if !found.is_empty() {
                    taken = i + 1;
                    break;
                }
            }
        }
        (self.prefix, self.turn) = (prefix, turn);
        taken
    }
}

/// Goes through a list of starts, from its latest one on: those with this key are the starts of valid substrings.
fn follow(ring: &[(u16, u32); RING], mut start: u32, key: u16, end: u64, floor: u64, found: &mut Vec<u64>) {
    let mut length = 0;
    let mut equal = 0;
    while equal < CHAIN {
        // Older entries of the table belong to positions that are over; their numbers may have come round.
        let behind = u64::from((end as u32).wrapping_add(1).wrapping_sub(start));
        if behind <= length || behind > REACH || end - floor < behind {
            break;
        }
        length = behind;
        let at = end - behind;
        let (other, before) = ring[at as usize % RING];
        if other == key {
            equal += 1;
            if behind >= 4 {
                found.push(at);
            }
        }
        start = before;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::checksum::{crc16, step};
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
        let mut at = 0;
        while at < data.len() {
            at += join.scan(at as u64, &data[at..], &mut found);
            all.extend(found.iter().map(|&start| (start, at as u64)));
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
        let bytes: Vec<u8> = frame.iter().copied().cycle().take(200_000).collect();
        let (mut at, mut whole) = (0, 0);
        while at < bytes.len() {
            at += join.scan(from + at as u64, &bytes[at..], &mut found);
            whole += usize::from(at % 8 == 0 && found.contains(&(from + at as u64 - 8)));
        }
        assert_eq!(whole, 25_000);
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
