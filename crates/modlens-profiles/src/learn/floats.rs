//! What speaks for a float.

use crate::learn::judge::{asked_for, coupling, span, Claim, ENOUGH, WILD};
use crate::learn::movement::Movement;
use crate::points::Value;
use crate::profile::{Order, Type};

/// Sizes of quantities of plants: from hundredths of a milli to some hundred millions.
pub const SIZES: std::ops::Range<f64> = 1e-5..1e9;

/// A number that only rises is a counter, not what a sensor gives.
const RISING: f64 = 8.0;

/// A constant that is a round number as a float.
const ROUND: f64 = 6.0;

fn floats(values: &[u64], words: usize) -> Vec<f64> {
    let float = |&bits: &u64| if words == 2 { f64::from(f32::from_bits(bits as u32)) } else { f64::from_bits(bits) };
    values.iter().map(float).collect()
}

/// Smallest and largest size, where they are those of quantities of plants.
fn sizes(numbers: &[f64]) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::MAX, 0.0f64);
    for size in numbers.iter().filter(|&&number| number != 0.0).map(|number| number.abs()) {
        if !SIZES.contains(&size) {
            return None;
        }
        (low, high) = (low.min(size), high.max(size));
    }
    (high > 0.0 && high / low <= 1e6).then_some((low, high))
}

/// The registers as a float.
pub fn float(values: &[u64], words: usize, order: Order, asked: f64) -> Option<Claim> {
    let kind = if words == 2 { Type::F32 } else { Type::F64 };
    let numbers = floats(values, words);
    sizes(&numbers)?;
    let mut reason = String::new();
    let movement = Movement::of(values, words, true);
    let mut bits = 2.0 + coupling(&movement, &mut reason) + asked_for(asked, &mut reason);
    if words == 4 && (movement.low_step < WILD || movement.next_step < WILD) {
        bits = 0.0;
    } else if words == 4 {
        let halves: Vec<u64> = values.iter().map(|value| value >> 32).collect();
        bits += coupling(&Movement::of(&halves, 2, true), &mut String::new());
    }
    let short = short_decimals(values, words);
    if short > 0.0 {
        bits += short;
        reason.push_str("the numbers are short in decimal; ");
    }
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
    // Bits that only rise: a float below zero falls then.
    if movement.distinct > 16 && values.windows(2).all(|pair| pair[0] <= pair[1]) && short == 0.0 {
        bits -= RISING;
    }
    if words == 2 && !order.swaps_bytes() && round(values) {
        bits += ROUND;
        reason.push_str("a constant that is a round number as a float; ");
    }
    if bits < ENOUGH {
        return None;
    }
    span(kind, &numbers, &mut reason);
    // Exponents in the range of plants are the rarer thing: so a float stands before a whole number of the same bits.
    Some(Claim { kind, order, bits: bits + 3.0, reason, sure: false, step: movement.step })
}

/// Bits for numbers that are short in decimal though their lower bits are not zero; negative where most are not short
/// would be too hard on noisy sensors, so that counts nothing.
fn short_decimals(values: &[u64], words: usize) -> f64 {
    let mut distinct: Vec<u64> = values.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    distinct.truncate(64);
    let (mask, digits, each) = if words == 2 { (0xFFFF, 5, 6.0) } else { (0xFFFF_FFFF, 9, 12.0) };
    let full: Vec<&u64> = distinct.iter().filter(|&&bits| bits & mask != 0).collect();
    let short = full.iter().filter(|&&&bits| significant(bits, words) <= digits).count();
    if full.is_empty() || short * 5 < full.len() * 4 {
        return 0.0;
    }
    (each * short as f64).min(24.0)
}

/// A constant with an empty lower register that is a number of four figures at most, as people set them. Of all
/// registers one in 25 is the upper half of such a number, and few have an empty one behind them.
fn round(values: &[u64]) -> bool {
    let constant = values.iter().all(|&bits| bits == values[0]);
    let size = f32::from_bits(values[0] as u32).abs();
    constant && values[0].trailing_zeros() >= 16 && (1e-3..1e6).contains(&size) && significant(values[0], 2) <= 4
}

fn significant(bits: u64, words: usize) -> usize {
    let text = if words == 2 { Value::Single(f32::from_bits(bits as u32)) } else { Value::Double(f64::from_bits(bits)) };
    let text = text.text().unwrap_or_default();
    let mantissa = text.split('e').next().unwrap_or_default().trim_start_matches(['-', '0', '.']);
    mantissa.bytes().filter(u8::is_ascii_digit).count()
}
