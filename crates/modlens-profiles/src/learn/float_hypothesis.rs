//! The evidence that registers are a float.

use crate::learn::evidence::{
    coupling_bits, push_range, request_bits, TypeHypothesis, MIN_HYPOTHESIS_BITS, PLAUSIBLE_MAGNITUDES, WILD_STEP,
};
use crate::learn::movement::Movement;
use crate::points::Value;
use crate::profile::{Order, Type};

/// Penalty in bits for bits that only rise: that is a counter rather than a measured value.
const RISING_PENALTY_BITS: f64 = 8.0;

/// Evidence in bits for a constant that is a round number as a float.
const ROUND_CONSTANT_BITS: f64 = 6.0;

/// The bits of the samples as floating point numbers.
fn as_floats(values: &[u64], words: usize) -> Vec<f64> {
    let float_hypothesis = |&bits: &u64| if words == 2 { f64::from(f32::from_bits(bits as u32)) } else { f64::from_bits(bits) };
    values.iter().map(float_hypothesis).collect()
}

/// The smallest and the largest magnitude, if all numbers have plausible magnitudes that differ by less than a factor
/// of a million.
fn magnitude_range(numbers: &[f64]) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::MAX, 0.0f64);
    for size in numbers.iter().filter(|&&number| number != 0.0).map(|number| number.abs()) {
        if !PLAUSIBLE_MAGNITUDES.contains(&size) {
            return None;
        }
        (low, high) = (low.min(size), high.max(size));
    }
    (high > 0.0 && high / low <= 1e6).then_some((low, high))
}

/// The hypothesis that the registers are a float in the order that `values` were loaded with; `None` if the evidence is
/// too weak.
pub fn float_hypothesis(values: &[u64], words: usize, order: Order, exact_request_share: f64) -> Option<TypeHypothesis> {
    let kind = if words == 2 { Type::F32 } else { Type::F64 };
    let numbers = as_floats(values, words);
    magnitude_range(&numbers)?;
    let mut reason = String::new();
    let movement = Movement::of(values, words, true);
    let mut bits = 2.0 + coupling_bits(&movement, &mut reason) + request_bits(exact_request_share, &mut reason);
    if words == 4 && (movement.low_step < WILD_STEP || movement.next_step < WILD_STEP) {
        bits = 0.0;
    } else if words == 4 {
        let halves: Vec<u64> = values.iter().map(|value| value >> 32).collect();
        bits += coupling_bits(&Movement::of(&halves, 2, true), &mut String::new());
    }
    let short_decimal_bits = short_decimals(values, words);
    if short_decimal_bits > 0.0 {
        bits += short_decimal_bits;
        reason.push_str("plausible round values; ");
    }
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
    // If the bits rise while the sign bit is set, the float falls; so this looks at the bits.
    if movement.distinct > 16 && values.windows(2).all(|pair| pair[0] <= pair[1]) && short_decimal_bits == 0.0 {
        bits -= RISING_PENALTY_BITS;
    }
    if words == 2 && !order.swaps_bytes() && is_round_constant(values) {
        bits += ROUND_CONSTANT_BITS;
        reason.push_str("a constant that is a round number as a float; ");
    }
    if bits < MIN_HYPOTHESIS_BITS {
        return None;
    }
    push_range(kind, &numbers, &mut reason);
    // Floats with plausible exponents are a small part of all bit patterns, so a float is preferred to an integer with
    // the same evidence.
    Some(TypeHypothesis { kind, order, bits: bits + 3.0, reason, is_certain: false, mean_step: movement.step })
}

/// Evidence in bits for numbers that are short in decimal although their low bits are not zero, as if somebody had
/// typed them. Nothing is subtracted if most numbers are long, since the values of a noisy sensor are.
fn short_decimals(values: &[u64], words: usize) -> f64 {
    let mut distinct: Vec<u64> = values.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    distinct.truncate(64);
    let (mask, digits, bits_each) = if words == 2 { (0xFFFF, 5, 6.0) } else { (0xFFFF_FFFF, 9, 12.0) };
    let with_low_bits: Vec<&u64> = distinct.iter().filter(|&&bits| bits & mask != 0).collect();
    let short = with_low_bits.iter().filter(|&&&bits| significant_digits(bits, words) <= digits).count();
    if with_low_bits.is_empty() || short * 5 < with_low_bits.len() * 4 {
        return 0.0;
    }
    (bits_each * short as f64).min(24.0)
}

/// Whether the value is a constant with a zero lower register that has at most four decimal digits, as people set them.
/// One in 25 of all registers is the upper half of such a number, and few of these are followed by a zero.
fn is_round_constant(values: &[u64]) -> bool {
    let constant = values.iter().all(|&bits| bits == values[0]);
    let size = f32::from_bits(values[0] as u32).abs();
    constant && values[0].trailing_zeros() >= 16 && (1e-3..1e6).contains(&size) && significant_digits(values[0], 2) <= 4
}

/// The number of significant decimal digits of the shortest text of a float.
fn significant_digits(bits: u64, words: usize) -> usize {
    let text = if words == 2 { Value::Single(f32::from_bits(bits as u32)) } else { Value::Double(f64::from_bits(bits)) };
    let text = text.text().unwrap_or_default();
    let mantissa = text.split('e').next().unwrap_or_default().trim_start_matches(['-', '0', '.']);
    mantissa.bytes().filter(u8::is_ascii_digit).count()
}
