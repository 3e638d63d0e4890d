//! The content of a slave's registers.

use std::collections::BTreeMap;

use crate::rng::Rng;

/// The weights of the kinds of values: zero, small, FFFF, 8000 or 7FFF, random, high word of a float, two characters.
const VALUE_WEIGHTS: [u32; 7] = [35, 25, 4, 2, 18, 8, 8];

/// The weights of the same kinds in scenarios where most values are zero.
const ZERO_HEAVY_WEIGHTS: [u32; 7] = [70, 10, 12, 2, 3, 8, 8];

/// The address from which on words hold coils, eight per word.
pub(crate) const COILS: u32 = 0x1_0000;

/// The registers of one slave; each gets a value when it is first read.
#[derive(Debug)]
pub(crate) struct Registers {
    words: BTreeMap<u32, u16>,
    zero_heavy: bool,
}

impl Registers {
    pub(crate) fn new(zero_heavy: bool) -> Self {
        Self { words: BTreeMap::new(), zero_heavy }
    }

    /// The current value of a register; values other than zero drift between reads.
    pub(crate) fn read(&mut self, address: u32, rng: &mut Rng) -> u16 {
        let zero_heavy = self.zero_heavy;
        let word = self.words.entry(address).or_insert_with(|| draw(zero_heavy, rng));
        if *word != 0 && rng.chance(0.15) {
            *word = word.wrapping_add(rng.below(7) as u16).wrapping_sub(3);
        }
        *word
    }
}

/// A random value for a register.
pub(crate) fn draw(zero_heavy: bool, rng: &mut Rng) -> u16 {
    match rng.weighted(if zero_heavy { &ZERO_HEAVY_WEIGHTS } else { &VALUE_WEIGHTS }) {
        0 => 0,
        1 => rng.range(0, 300) as u16,
        2 => 0xFFFF,
        3 => rng.pick(&[0x8000, 0x7FFF]),
        4 => rng.bits() as u16,
        // High words of floats from 0.1 to 2000, which are 3DCC to 44FA, with either sign.
        5 => rng.range(0x3DCC, 0x44FA) as u16 | if rng.chance(0.2) { 0x8000 } else { 0 },
        _ => u16::from_be_bytes([character(rng), character(rng)]),
    }
}

/// A printable character.
pub(crate) fn character(rng: &mut Rng) -> u8 {
    rng.range(0x20, 0x7E) as u8
}

/// Bytes with the distribution of register values.
pub(crate) fn content(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(length + 1);
    while bytes.len() < length {
        bytes.extend(draw(zero_heavy, rng).to_be_bytes());
    }
    bytes.truncate(length);
    bytes
}

/// The data of a write request. In zero-heavy scenarios 60 % of them consist of 85 % zeros.
pub(crate) fn payload(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    if zero_heavy && rng.chance(0.6) {
        mostly_zeros(length, rng)
    } else {
        content(length, zero_heavy, rng)
    }
}

/// The data of a proprietary function: uniformly random bytes, or mostly zeros in zero-heavy scenarios.
pub(crate) fn anything(length: usize, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    if zero_heavy && rng.chance(0.6) {
        return mostly_zeros(length, rng);
    }
    (0..length).map(|_| rng.byte()).collect()
}

fn mostly_zeros(length: usize, rng: &mut Rng) -> Vec<u8> {
    (0..length).map(|_| if rng.chance(0.85) { 0 } else { rng.byte() }).collect()
}
