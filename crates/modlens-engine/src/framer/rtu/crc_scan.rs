//! Finds every substring with a valid CRC, in constant time per byte.
//!
//! Let P[i] be the CRC register over the first `i` bytes (start value 0) and T its step on a zero byte, a linear and
//! invertible map. The substring from `i` to `j` is valid if and only if T^-i(FFFF xor P[i]) = T^-j(P[j]). So each position has
//! a key as a start and a key as an end. Starts are kept in a hash table until an end with the same key comes: a hash join of
//! starts and ends. The running value T^-k P[k] grows by T^-k(byte).
//!
//! The step is linear, and one bit of it, backwards, turns 0001 into 0002, then 0004 and so on. The effects T^-k of the
//! eight bits of a byte are therefore neighbours in the sequence that these single steps run through, which repeats after
//! 32,767 of them (the order of x modulo the polynomial). The sequence stands in a table; for each byte its eight
//! neighbours are masked and summed.

use std::sync::OnceLock;

use modlens_protocol::checksum::CRC_PERIOD_BITS;

/// The longest substring that is looked for. Some masters announce more than the 256 bytes of the specification; a byte
/// count cannot announce more than this.
pub const MAX_CANDIDATE_BYTES: usize = 272;

/// `MAX_CANDIDATE_BYTES` as a distance between stream offsets.
pub const MAX_CANDIDATE_SPAN: u64 = MAX_CANDIDATE_BYTES as u64;

/// Starts with one key that are followed at most: zeros and crafted bytes make endless chains of equal keys.
const MAX_EQUAL_KEYS: usize = 32;

/// Starts kept in the ring; more than `MAX_CANDIDATE_BYTES`, and a power of two.
const RING_STARTS: usize = 512;

/// Buckets of the hash table. Few enough for the nearest cache, many enough to be nearly always empty.
const BUCKETS: usize = 4096;

/// Effects T^-k of single bits and of the start value FFFF.
struct InversePowers {
    /// The states that single bit steps backwards run through from 0001 on; the first eight come again at the end.
    bits: Vec<u16>,
    /// T^-k(FFFF) for each k.
    start_values: Vec<u16>,
    /// For each byte value, FFFF for each bit that is one and 0 for the others, the lowest bit first.
    masks: Box<[[u16; 8]; 256]>,
}

/// Takes back one bit of the register's step.
pub fn step_back_bit(state: u16) -> u16 {
    // The step sets the highest bit if and only if it shifted a one out.
    if state & 0x8000 == 0 {
        state << 1
    } else {
        (state ^ 0xA001) << 1 | 1
    }
}

fn inverse_powers() -> &'static InversePowers {
    static POWERS: OnceLock<InversePowers> = OnceLock::new();
    POWERS.get_or_init(|| {
        let steps = |from: u16| std::iter::successors(Some(from), |&state| Some(step_back_bit(state)));
        let mask = |byte: usize| std::array::from_fn(|i| 0u16.wrapping_sub((byte >> i & 1) as u16));
        InversePowers {
            bits: steps(1).take(CRC_PERIOD_BITS + 8).collect(),
            start_values: steps(0xFFFF).step_by(8).take(CRC_PERIOD_BITS).collect(),
            masks: Box::new(std::array::from_fn(mask)),
        }
    })
}

/// The state of the scan over one stretch of bytes.
pub struct CrcScanner {
    powers: &'static InversePowers,
    /// The latest start in each bucket: the low 32 bits of its position + 1.
    heads: Box<[u32; BUCKETS]>,
    /// By position: its key, and the start before it in the same bucket.
    ring: Box<[(u16, u32); RING_STARTS]>,
    /// Where the stretch began.
    first: u64,
    /// T^-k P[k].
    prefix: u16,
    /// Bytes since the beginning of the stretch, modulo the order.
    power: usize,
}

impl Default for CrcScanner {
    fn default() -> Self {
        Self {
            powers: inverse_powers(),
            heads: Box::new([0; BUCKETS]),
            ring: Box::new([(0, 0); RING_STARTS]),
            first: 0,
            prefix: 0,
            power: 0,
        }
    }
}

impl CrcScanner {
    /// Begins a new stretch at this position: no substring reaches across.
    pub fn restart(&mut self, position: u64) {
        self.first = position;
        self.prefix = 0;
        self.power = 0;
    }

    /// Scans bytes up to the first one with which valid substrings end; returns how many it scanned. `position` is the stream
    /// offset of the first: that of `restart`, or where the call before has ended.
    ///
    /// `found` is cleared and gets the stream offsets at which these substrings start, the latest first; it stays empty if all
    /// bytes were scanned and no valid substring ends with any of them.
    pub fn scan(&mut self, position: u64, bytes: &[u8], found: &mut Vec<u64>) -> usize {
        found.clear();
        let InversePowers { bits, start_values, masks } = self.powers;
        let (heads, ring) = (&mut *self.heads, &mut *self.ring);
        // `effect` is the index in `bits` for the next byte, `start` the low 32 bits of its position.
        let (mut prefix, mut power, mut effect, mut start) =
            (self.prefix, self.power, 8 * self.power % CRC_PERIOD_BITS, position as u32);
        let mut scanned = bytes.len();
        for (i, &byte) in bytes.iter().enumerate() {
            let key = prefix ^ start_values[power];
            let head = &mut heads[usize::from(key) % BUCKETS];
            ring[start as usize % RING_STARTS] = (key, *head);
            start = start.wrapping_add(1);
            *head = start;
            let effects: &[u16; 8] = bits[effect..effect + 8].try_into().expect("eight of them");
            let mask = &masks[usize::from(byte)];
            prefix ^= (0..8).fold(0, |sum, bit| sum ^ (effects[bit] & mask[bit]));
            power = if power + 1 == CRC_PERIOD_BITS { 0 } else { power + 1 };
            effect = if effect + 8 >= CRC_PERIOD_BITS { effect + 8 - CRC_PERIOD_BITS } else { effect + 8 };
            let latest = heads[usize::from(prefix) % BUCKETS];
            if u64::from(start.wrapping_add(1).wrapping_sub(latest)) <= MAX_CANDIDATE_SPAN {
                follow_bucket(ring, latest, prefix, position + i as u64 + 1, self.first, found);
                if !found.is_empty() {
                    scanned = i + 1;
                    break;
                }
            }
        }
        (self.prefix, self.power) = (prefix, power);
        scanned
    }
}

/// Goes through a bucket of starts, from the latest one on: those with this key are the starts of valid substrings that end
/// at stream offset `end`, and are added to `found` if the substring has at least four bytes. None begins before `first`. `start`
/// is the latest entry: the low 32 bits of a position, plus one.
///
/// It ends at an entry too far back or out of date, and after `MAX_EQUAL_KEYS` starts.
fn follow_bucket(ring: &[(u16, u32); RING_STARTS], mut start: u32, key: u16, end: u64, first: u64, found: &mut Vec<u64>) {
    let mut length = 0;
    let mut equal_keys = 0;
    while equal_keys < MAX_EQUAL_KEYS {
        // Old entries of the table belong to positions that are over, and positions of 32 bits may have wrapped around.
        let behind = u64::from((end as u32).wrapping_add(1).wrapping_sub(start));
        if behind <= length || behind > MAX_CANDIDATE_SPAN || end - first < behind {
            break;
        }
        length = behind;
        let at = end - behind;
        let (other, before) = ring[at as usize % RING_STARTS];
        if other == key {
            equal_keys += 1;
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
    use modlens_protocol::checksum::{crc16, update_byte};
    use proptest::prelude::*;

    #[test]
    fn eight_bit_steps_back_undo_a_byte() {
        for state in 0..=u16::MAX {
            assert_eq!((0..8).fold(update_byte(state, 0), |state, _| step_back_bit(state)), state);
        }
    }

    #[test]
    fn the_tables_repeat_after_the_order() {
        let powers = inverse_powers();
        assert_eq!(powers.bits[CRC_PERIOD_BITS..], powers.bits[..8]);
        assert_eq!(powers.start_values.len(), CRC_PERIOD_BITS);
        // T^-1 of the last of them is the first one again.
        assert_eq!((0..8).fold(powers.start_values[CRC_PERIOD_BITS - 1], |state, _| step_back_bit(state)), 0xFFFF);
    }

    fn naive(data: &[u8]) -> Vec<(u64, u64)> {
        let mut all = Vec::new();
        for end in 0..=data.len() {
            for start in (end.saturating_sub(MAX_CANDIDATE_BYTES)..end.saturating_sub(3)).rev() {
                if crc16(&data[start..end]) == 0 {
                    all.push((start as u64, end as u64));
                }
            }
        }
        all
    }

    fn scanned(data: &[u8]) -> Vec<(u64, u64)> {
        let mut scanner = CrcScanner::default();
        scanner.restart(0);
        let (mut all, mut found) = (Vec::new(), Vec::new());
        let mut at = 0;
        while at < data.len() {
            at += scanner.scan(at as u64, &data[at..], &mut found);
            all.extend(found.iter().map(|&start| (start, at as u64)));
        }
        all
    }

    #[test]
    fn positions_beyond_four_gigabytes_and_more_bytes_than_the_order() {
        let body = [1u8, 3, 0, 10, 0, 2];
        let frame = [&body[..], &crc16(&body).to_le_bytes()].concat();
        let from = (1u64 << 32) - 100_000;
        let (mut scanner, mut found) = (CrcScanner::default(), Vec::new());
        scanner.restart(from);
        let bytes: Vec<u8> = frame.iter().copied().cycle().take(200_000).collect();
        let (mut at, mut frames) = (0, 0);
        while at < bytes.len() {
            at += scanner.scan(from + at as u64, &bytes[at..], &mut found);
            frames += usize::from(at % 8 == 0 && found.contains(&(from + at as u64 - 8)));
        }
        assert_eq!(frames, 25_000);
    }

    proptest! {
        #[test]
        fn finds_what_the_naive_scan_finds(parts in proptest::collection::vec((proptest::collection::vec(any::<u8>(), 2..40), 0usize..4), 0..12)) {
            let mut data = Vec::new();
            for (body, zeros) in parts {
                data.extend(&body);
                data.extend(crc16(&body).to_le_bytes());
                data.extend(std::iter::repeat_n(0, zeros));
            }
            prop_assert_eq!(scanned(&data), naive(&data));
        }
    }
}
