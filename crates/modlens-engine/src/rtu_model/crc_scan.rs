//! Finds every substring with a valid CRC, in constant time per byte.
//!
//! Let P[i] be the CRC register over the first `i` bytes (start value 0) and T its step on a zero byte, a linear and
//! invertible map. The substring from `i` to `j` is valid if and only if T^-i(FFFF xor P[i]) = T^-j(P[j]). So each position has
//! a key as a start and a key as an end. Starts are kept in a hash table until an end with the same key comes: a hash join of
//! starts and ends. The running value T^-k P[k] grows by T^-k(byte).
//!
//! The step is linear, and one bit of it, backwards, turns 0001 into 0002, then 0004 and so on. From there it runs through all
//! states with an odd number of ones but one, and from 0003 on through all with an even number but 0; both sequences repeat
//! after 32,767 single steps (the order of x modulo the polynomial). So a byte is so many steps from 0001 or 0003, its logarithm,
//! and T^-k(byte) is in its sequence 8 k places after it.

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

/// The fewest bytes of a frame (unit, function code, CRC) as a distance between stream offsets.
const MIN_FRAME_SPAN: u64 = 4;

/// Buckets of the hash table. Few enough for the nearest cache, many enough to be nearly always empty.
const BUCKETS: usize = 4096;

/// The states of each sequence, and the entries of its part of the table: the sequence twice, so that the sum of two places in it
/// is a place as well.
const SEQUENCE_ENTRIES: usize = 1 << 16;

/// What T^-k makes of bytes and of the start value FFFF, for each k. A scan has its own copy of it: so the compiler sees that no
/// table entry that is written changes it.
#[derive(Clone, Copy)]
struct InversePowers {
    /// The states that single bit steps backwards run through from 0001 on, and those from 0003 on.
    states: &'static [u16; 2 * SEQUENCE_ENTRIES],
    /// By byte value, its place in `states`; that of 0 means nothing.
    logarithms: &'static [u32; 256],
    /// The place of FFFF.
    start_value: u32,
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

fn inverse_powers() -> InversePowers {
    static POWERS: OnceLock<InversePowers> = OnceLock::new();
    *POWERS.get_or_init(|| {
        let mut states = vec![0; 2 * SEQUENCE_ENTRIES].into_boxed_slice();
        let (mut logarithms, mut start_value) = (Box::new([0; 256]), 0);
        for (part, first) in states.chunks_exact_mut(SEQUENCE_ENTRIES).zip([1, 3]) {
            let sequence = std::iter::successors(Some(first), |&state| Some(step_back_bit(state)));
            part.iter_mut().zip(sequence).for_each(|(place, state)| *place = state);
        }
        for place in (0..CRC_PERIOD_BITS).chain(SEQUENCE_ENTRIES..SEQUENCE_ENTRIES + CRC_PERIOD_BITS) {
            match states[place] {
                u16::MAX => start_value = place as u32,
                state => logarithms.get_mut(usize::from(state)).into_iter().for_each(|known| *known = place as u32),
            }
        }
        let states: Box<[u16; 2 * SEQUENCE_ENTRIES]> = states.try_into().expect("as many as were made");
        InversePowers { states: Box::leak(states), logarithms: Box::leak(logarithms), start_value }
    })
}

impl InversePowers {
    /// What the state at this place becomes in so many single steps backwards, which are fewer than the order.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of the loop over all bytes.
    fn after(self, place: u32, steps: usize) -> u16 {
        self.states[(place as usize + steps) % (2 * SEQUENCE_ENTRIES)]
    }
}

/// T^-k P[k], as it grows byte by byte.
#[derive(Clone, Copy, Default)]
struct Prefix {
    /// T^-k P[k].
    value: u16,
    /// 8 k modulo the order.
    steps: usize,
}

impl Prefix {
    /// The key that the position before the next byte has as a start.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn start_key(self, powers: InversePowers) -> u16 {
        self.value ^ powers.after(powers.start_value, self.steps)
    }

    /// Takes one byte more: then `value` is the key that the position after it has as an end.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn add(&mut self, byte: u8, powers: InversePowers) {
        let effect = powers.after(powers.logarithms[usize::from(byte)], self.steps);
        // Without a branch: no processor could predict the zeros of noise.
        self.value ^= effect & u16::from(byte != 0).wrapping_neg();
        let next = self.steps + 8;
        self.steps = if next >= CRC_PERIOD_BITS { next - CRC_PERIOD_BITS } else { next };
    }
}

/// The starts of substrings by their keys: a hash table of the latest `RING_STARTS` positions. A position is entered as the low
/// 32 bits of its stream offset, plus one, so that 0 is no entry; where these have wrapped around, only old entries are wrong,
/// and `positions_behind` puts them out of reach. Entries stay when a scan restarts; if it restarts at an earlier offset, some
/// are of positions that it has not reached again yet.
struct StartTable {
    /// The latest entry in each bucket.
    heads: Box<[u32; BUCKETS]>,
    /// By position: its key, and the entry before it in the same bucket.
    ring: Box<[(u16, u32); RING_STARTS]>,
}

/// Returns how many positions an entry is before stream offset `end`, modulo 2^32: 0 for `end` itself, a large number for a
/// position after `end`. The entry 0 of an empty bucket gives `end + 1`: before the beginning of the stream.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
fn positions_behind(end: u64, entry: u32) -> u64 {
    u64::from((end as u32).wrapping_add(1).wrapping_sub(entry))
}

impl StartTable {
    /// Enters the position at this stream offset with its key.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn insert(&mut self, position: u64, key: u16) {
        let head = &mut self.heads[usize::from(key) % BUCKETS];
        self.ring[position as usize % RING_STARTS] = (key, *head);
        *head = (position as u32).wrapping_add(1);
    }

    /// The latest entry of the bucket of this key, if it is at most `MAX_CANDIDATE_BYTES` before stream offset `end`.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn latest(&self, key: u16, end: u64) -> Option<u32> {
        let latest = self.heads[usize::from(key) % BUCKETS];
        (positions_behind(end, latest) <= MAX_CANDIDATE_SPAN).then_some(latest)
    }

    /// Goes through a bucket from this entry to earlier ones, and appends to `found` the positions with this key that
    /// `may_be_frame` admits, from `first` (included) to four bytes before `end` (included). All are stream offsets. Returns
    /// whether there was such a position, admitted or not.
    ///
    /// Stops:
    /// - at a position before `first`;
    /// - at a position whose distance to `end` is greater than `MAX_CANDIDATE_BYTES`;
    /// - at an entry that is out of date;
    /// - after `MAX_EQUAL_KEYS` equal keys, those closer than four bytes included.
    #[inline(never)]
    fn collect(
        &self,
        mut entry: u32,
        key: u16,
        end: u64,
        first: u64,
        may_be_frame: &impl Fn(u64, usize) -> bool,
        found: &mut Vec<u64>,
    ) -> bool {
        let mut is_end = false;
        let mut last_behind = 0;
        let mut equal_keys = 0;
        while equal_keys < MAX_EQUAL_KEYS {
            let behind = positions_behind(end, entry);
            // Each valid entry is further back than the one visited just before. Entries left by an earlier scan need not be.
            let is_outdated = behind <= last_behind;
            if is_outdated || behind > MAX_CANDIDATE_SPAN || end - first < behind {
                break;
            }
            last_behind = behind;
            let position = end - behind;
            let (start_key, older_entry) = self.ring[position as usize % RING_STARTS];
            if start_key == key {
                equal_keys += 1;
                if behind >= MIN_FRAME_SPAN {
                    is_end = true;
                    if may_be_frame(position, behind as usize) {
                        found.push(position);
                    }
                }
            }
            entry = older_entry;
        }
        is_end
    }
}

/// The state of the scan over one stretch of bytes.
pub struct CrcScanner {
    powers: InversePowers,
    starts: StartTable,
    /// Stream offset at which the stretch began.
    first: u64,
    /// What the bytes since then come to.
    prefix: Prefix,
    /// A valid substring ends at the last byte scanned.
    is_at_end: bool,
}

impl Default for CrcScanner {
    fn default() -> Self {
        let starts = StartTable { heads: Box::new([0; BUCKETS]), ring: Box::new([(0, 0); RING_STARTS]) };
        Self { powers: inverse_powers(), starts, first: 0, prefix: Prefix::default(), is_at_end: false }
    }
}

impl CrcScanner {
    /// Begins a new stretch at this stream offset: no substring reaches across.
    pub fn restart(&mut self, position: u64) {
        self.first = position;
        self.prefix = Prefix::default();
    }

    /// Scans bytes up to the first one with which valid substrings end that may be frames, that one included; returns how many it
    /// scanned. `position` is the stream offset of the first: that of `restart`, or where the call before has ended. A substring
    /// may be a frame if `may_be_frame` admits it, by the stream offset of its start and its length.
    ///
    /// `found` is cleared and gets the stream offsets at which these substrings start, the latest first. They have from 4 to
    /// `MAX_CANDIDATE_BYTES` bytes, and begin where the stretch began or after. `found` stays empty if all bytes were scanned
    /// and no such substring ends with any of them.
    #[inline(never)] // So that its loop has the registers to itself.
    pub fn scan(
        &mut self,
        position: u64,
        bytes: &[u8],
        may_be_frame: &impl Fn(u64, usize) -> bool,
        found: &mut Vec<u64>,
    ) -> usize {
        found.clear();
        let (mut prefix, powers) = (self.prefix, self.powers);
        let mut scanned = bytes.len();
        let mut last_end = position;
        for (start, &byte) in (position..).zip(bytes) {
            let end = start + 1;
            self.starts.insert(start, prefix.start_key(powers));
            prefix.add(byte, powers);
            if let Some(latest) = self.starts.latest(prefix.value, end) {
                if self.starts.collect(latest, prefix.value, end, self.first, may_be_frame, found) {
                    last_end = end;
                }
                if !found.is_empty() {
                    scanned = (end - position) as usize;
                    break;
                }
            }
        }
        self.prefix = prefix;
        self.is_at_end = last_end == position + scanned as u64 && scanned > 0;
        scanned
    }

    /// Whether a valid substring ends at the last byte scanned, be it such as may be a frame or not.
    pub fn is_at_end(&self) -> bool {
        self.is_at_end
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
    fn the_sequences_repeat_after_the_order() {
        let powers = inverse_powers();
        for sequence in powers.states.chunks_exact(SEQUENCE_ENTRIES) {
            assert_eq!(sequence[CRC_PERIOD_BITS..], sequence[..SEQUENCE_ENTRIES - CRC_PERIOD_BITS]);
        }
    }

    #[test]
    fn each_byte_and_the_start_value_stand_at_their_places() {
        let powers = inverse_powers();
        for byte in 1..=255u8 {
            let place = powers.logarithms[usize::from(byte)];
            assert_eq!(powers.after(place, 0), u16::from(byte));
            // T(T^-1(byte)), by the step on a zero byte.
            assert_eq!(update_byte(powers.after(place, 8), 0), u16::from(byte));
        }
        assert_eq!(powers.after(powers.start_value, 0), 0xFFFF);
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
            at += scanner.scan(at as u64, &data[at..], &|_, _| true, &mut found);
            assert_eq!(scanner.is_at_end(), !found.is_empty());
            all.extend(found.iter().map(|&start| (start, at as u64)));
        }
        all
    }

    /// The substrings that are admitted, five bytes at a time, and where each scan stopped: whether at an end.
    #[allow(clippy::type_complexity)] // Two lists of pairs.
    fn scanned_for_some(data: &[u8], is_admitted: impl Fn(u64, usize) -> bool) -> (Vec<(u64, u64)>, Vec<(u64, bool)>) {
        let mut scanner = CrcScanner::default();
        scanner.restart(0);
        let (mut all, mut stops, mut found) = (Vec::new(), Vec::new(), Vec::new());
        let mut at = 0;
        while at < data.len() {
            let to = data.len().min(at + 5);
            at += scanner.scan(at as u64, &data[at..to], &is_admitted, &mut found);
            all.extend(found.iter().map(|&start| (start, at as u64)));
            stops.push((at as u64, scanner.is_at_end()));
        }
        (all, stops)
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
            at += scanner.scan(from + at as u64, &bytes[at..], &|_, _| true, &mut found);
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

        #[test]
        fn what_is_not_admitted_is_left_out_but_its_end_is_known(
            parts in proptest::collection::vec((proptest::collection::vec(0u8..3, 2..5), 0usize..4), 0..12),
        ) {
            let mut data = Vec::new();
            for (body, zeros) in parts {
                data.extend(&body);
                data.extend(crc16(&body).to_le_bytes());
                data.extend(std::iter::repeat_n(0, zeros));
            }
            let all = naive(&data);
            let is_admitted = |start: u64, length: usize| data[start as usize + 1] % 2 == 0 && length != 5;
            let (found, stops) = scanned_for_some(&data, is_admitted);
            let admitted = all.iter().copied().filter(|&(start, end)| is_admitted(start, (end - start) as usize));
            prop_assert_eq!(found, admitted.collect::<Vec<_>>());
            let is_end = |place: u64| all.iter().any(|&(_, end)| end == place);
            prop_assert!(stops.iter().all(|&(place, is_at_end)| is_at_end == is_end(place)));
        }
    }
}
