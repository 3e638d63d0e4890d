//! What stands in the registers of a slave.

use std::collections::BTreeMap;

use crate::rng::Rng;

/// Zero, small, FFFF, 8000 or 7FFF, random, high word of a float, two characters.
const KINDS: [u32; 7] = [35, 25, 4, 2, 18, 8, 8];

/// The same where most is zero.
const ZERO_HEAVY: [u32; 7] = [70, 10, 12, 2, 3, 8, 8];

/// Coils live behind the registers, eight to a word.
pub(crate) const COILS: u32 = 0x1_0000;

/// The registers of one slave; they come into being when they are first read.
#[derive(Debug)]
pub(crate) struct Registers {
    words: BTreeMap<u32, u16>,
    zero_heavy: bool,
}

impl Registers {
    pub(crate) fn new(zero_heavy: bool) -> Self {
        Self { words: BTreeMap::new(), zero_heavy }
    }

    /// What the register holds now: values other than zero drift.
    pub(crate) fn read(&mut self, address: u32, rng: &mut Rng) -> u16 {
        let zero_heavy = self.zero_heavy;
        let word = self.words.entry(address).or_insert_with(|| draw(zero_heavy, rng));
        if *word != 0 && rng.chance(0.15) {
            *word = word.wrapping_add(rng.below(7) as u16).wrapping_sub(3);
        }
        *word
    }
}

/// A new value.
pub(crate) fn draw(zero_heavy: bool, rng: &mut Rng) -> u16 {
    match rng.weighted(if zero_heavy { &ZERO_HEAVY } else { &KINDS }) {
        0 => 0,
        1 => rng.range(0, 300) as u16,
        2 => 0xFFFF,
        3 => rng.pick(&[0x8000, 0x7FFF]),
        4 => rng.bits() as u16,
        // 0.1 to 2000 and their negatives: 3DCC to 44FA and the sign.
        5 => rng.range(0x3DCC, 0x44FA) as u16 | if rng.chance(0.2) { 0x8000 } else { 0 },
        _ => u16::from_be_bytes([character(rng), character(rng)]),
    }
}

/// A printable character.
pub(crate) fn character(rng: &mut Rng) -> u8 {
    rng.range(0x20, 0x7E) as u8
}

/// Bytes as registers hold them.
pub(crate) fn content(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(length + 1);
    while bytes.len() < length {
        bytes.extend(draw(zero_heavy, rng).to_be_bytes());
    }
    bytes.truncate(length);
    bytes
}

/// What a write carries: in zero-heavy scenarios 60 % of the payloads are 85 % zeros.
pub(crate) fn payload(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    if zero_heavy && rng.chance(0.6) {
        mostly_zeros(length, rng)
    } else {
        content(length, zero_heavy, rng)
    }
}

/// What a vendor's function carries: anything.
pub(crate) fn anything(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    if zero_heavy && rng.chance(0.6) {
        return mostly_zeros(length, rng);
    }
    (0..length).map(|_| rng.byte()).collect()
}

fn mostly_zeros(length: usize, rng: &mut Rng) -> Vec<u8> {
    (0..length).map(|_| if rng.chance(0.85) { 0 } else { rng.byte() }).collect()
}
