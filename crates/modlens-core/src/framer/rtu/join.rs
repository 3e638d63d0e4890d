//! Every substring with a right CRC, in constant time a byte.
//!
//! With P the CRC register over all bytes so far (start value 0) and T its step on a zero byte, `[i, j)` is valid if
//! and only if T^-i(FFFF xor P[i]) = T^-j(P[j]). So each position has a key as a start and a key as an end, and starts
//! wait in a table until an end with their key comes. T^-k P[k] grows by T^-k(byte): no multiplication is needed.

/// The longest frame that is looked for.
pub const REACH: u64 = 272;

/// Starts with one key that are followed; zeros and crafted bytes make endless chains of equal keys.
const CHAIN: usize = 32;

/// The ring of waiting starts; more than `REACH`, a power of two.
const RING: usize = 512;

/// The state of the join over one stretch of bytes.
pub struct Join {
    /// Latest start by key, as position + 1.
    heads: Box<[u64]>,
    /// The start before with the same key.
    links: Box<[u64; RING]>,
    /// Starts before this are over.
    floor: u64,
    /// T^-k P[k].
    prefix: u16,
    /// T^-k of the eight bits of a byte.
    bits: [u16; 8],
    /// T^-k(FFFF).
    ones: u16,
}

/// One step of the register backwards on a zero byte.
fn back(state: u16) -> u16 {
    const fn table() -> [u16; 256] {
        // The step maps `low` to TABLE[low], whose high bytes are all different.
        let mut inverse = [0u16; 256];
        let mut low = 0;
        while low < 256 {
            let mut state = low as u16;
            let mut bit = 0;
            while bit < 8 {
                state = if state & 1 == 1 { (state >> 1) ^ 0xA001 } else { state >> 1 };
                bit += 1;
            }
            inverse[(state >> 8) as usize] = ((state & 0xFF) << 8) | low as u16;
            low += 1;
        }
        inverse
    }
    static TABLE: [u16; 256] = table();
    let entry = TABLE[(state >> 8) as usize];
    // The low byte of the step's table entry was added to the high byte of the state.
    ((state & 0xFF) << 8) ^ (entry & 0xFF00) | (entry & 0xFF)
}

impl Default for Join {
    fn default() -> Self {
        Self {
            heads: vec![0; 1 << 16].into_boxed_slice(),
            links: Box::new([0; RING]),
            floor: 0,
            prefix: 0,
            bits: [0; 8],
            ones: 0,
        }
    }
}

impl Join {
    /// Begins anew at this position: no frame reaches across.
    pub fn restart(&mut self, position: u64) {
        self.floor = position;
        self.prefix = 0;
        self.ones = 0xFFFF;
        for (bit, state) in self.bits.iter_mut().enumerate() {
            *state = 1 << bit;
        }
    }

    /// Takes the byte at `position`; `found` gets the starts of all valid substrings that end behind it, the latest first.
    pub fn push(&mut self, position: u64, byte: u8, found: &mut Vec<u64>) {
        found.clear();
        let key = usize::from(self.prefix ^ self.ones);
        self.links[position as usize % RING] = self.heads[key];
        self.heads[key] = position + 1;
        for (bit, state) in self.bits.iter_mut().enumerate() {
            let mask = 0u16.wrapping_sub(u16::from(byte >> bit & 1));
            self.prefix ^= *state & mask;
            *state = back(*state);
        }
        self.ones = back(self.ones);
        let end = position + 1;
        let mut start = self.heads[usize::from(self.prefix)];
        for _ in 0..CHAIN {
            // Older entries of the table belong to positions that are over.
            if start <= self.floor || start + REACH < end + 1 {
                break;
            }
            let at = start - 1;
            if end - at >= 4 {
                found.push(at);
            }
            start = self.links[at as usize % RING];
            if start > at {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checksum::{crc16, step};
    use proptest::prelude::*;

    #[test]
    fn back_undoes_a_step() {
        for state in 0..=u16::MAX {
            assert_eq!(back(step(state, 0)), state);
        }
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
