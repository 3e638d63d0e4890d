//! The evidence that registers are a float.

use crate::learn::evidence::{coupling_bits, push_range, TypeHypothesis, MIN_HYPOTHESIS_BITS, PLAUSIBLE_MAGNITUDES, WILD_STEP};
use crate::learn::habits::Habits;
use crate::learn::movement::Movement;
use crate::learn::sequence::Sequence;
use crate::points::Value;
use crate::profile::{Order, Type};

/// Penalty in bits for negative numbers that only fall.
const FALLING_PENALTY_BITS: f64 = 8.0;

/// Penalty in bits for a float that only rises where totals are integers.
const INTEGER_TOTAL_PENALTY_BITS: f64 = 8.0;

/// Totals that are floats are larger than this.
const LEAST_TOTAL: f64 = 0.01;

/// Evidence in bits for a constant that is a round number.
const ROUND_CONSTANT_BITS: f64 = 5.0;

/// Constants that people set.
const ROUND_NUMBERS: std::ops::Range<f32> = 0.01..100_000.0;

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
pub fn float_hypothesis(sequence: &Sequence<'_, u64>, words: usize, order: Order, habits: &Habits) -> Option<TypeHypothesis> {
    let kind = if words == 2 { Type::F32 } else { Type::F64 };
    let values = sequence.values;
    let numbers = as_floats(values, words);
    magnitude_range(&numbers)?;
    let mut reason = String::new();
    let movement = Movement::of(sequence, words, true);
    let mut bits = 2.0 + coupling_bits(&movement, &mut reason);
    if words == 4 && (movement.low_step < WILD_STEP || movement.next_step < WILD_STEP) {
        bits = 0.0;
    } else if words == 4 {
        let halves: Vec<u64> = values.iter().map(|value| value >> 32).collect();
        bits +=
            coupling_bits(&Movement::of(&Sequence { values: &halves, follows: sequence.follows }, 2, true), &mut String::new());
    }
    let short_decimal_bits = short_decimals(values, words).max(round_constant(values, words, habits.has_floats(order)));
    if short_decimal_bits > 0.0 {
        bits += short_decimal_bits;
        reason.push_str("plausible round values; ");
    }
    // A negative number whose bits only rise is a counter rather than a measured value that only falls.
    let negative = values.iter().all(|bits| bits >> (16 * words - 1) == 1);
    if negative && movement.distinct > 16 && values.windows(2).all(|pair| pair[0] <= pair[1]) {
        bits -= FALLING_PENALTY_BITS;
    }
    // Of a total, its size and the other totals of the device say whether it is an integer.
    let is_small = numbers.iter().all(|number| number.abs() < LEAST_TOTAL);
    if words == 2 && movement.is_rising && movement.distinct > 16 && (is_small || habits.has_integer_totals()) {
        bits -= INTEGER_TOTAL_PENALTY_BITS;
    }
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0) + movement.stillness;
    if bits < MIN_HYPOTHESIS_BITS {
        return None;
    }
    push_range(kind, &numbers, &mut reason);
    // Floats with plausible exponents are a small part of all bit patterns, so a float is preferred to an integer with
    // the same evidence.
    Some(TypeHypothesis {
        kind,
        order,
        bits: bits + 3.0,
        reason,
        is_certain: false,
        is_rising: movement.is_rising,
        mean_step: movement.step,
    })
}

/// Evidence in bits for numbers that are short in decimal although their lowest bits are not zero, as if somebody had
/// typed them; a number whose lowest bits are zero is short by itself. Nothing is subtracted if most numbers are long,
/// since the values of a noisy sensor are.
fn short_decimals(values: &[u64], words: usize) -> f64 {
    let mut distinct: Vec<u64> = values.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    distinct.truncate(64);
    let (mask, digits, bits_each) = if words == 2 { (0xFF, 5, 6.0) } else { (0xFFFF, 9, 12.0) };
    let with_low_bits: Vec<&u64> = distinct.iter().filter(|&&bits| bits & mask != 0).collect();
    let short = with_low_bits.iter().filter(|&&&bits| significant_digits(bits, words) <= digits).count();
    if with_low_bits.is_empty() || short * 5 < with_low_bits.len() * 4 {
        return 0.0;
    }
    (bits_each * short as f64).min(24.0)
}

/// Evidence in bits for a constant that is a round number, in a device with other floats of this order. Without these,
/// parts of other numbers look like it too often.
fn round_constant(values: &[u64], words: usize, has_floats: bool) -> f64 {
    let number = f32::from_bits(values[0] as u32);
    let is_constant = values.iter().all(|&value| value == values[0]);
    let is_round = words == 2 && ROUND_NUMBERS.contains(&number) && significant_digits(values[0], words) <= 4;
    if has_floats && is_constant && is_round {
        ROUND_CONSTANT_BITS
    } else {
        0.0
    }
}

/// The number of significant decimal digits of the shortest text of a float.
fn significant_digits(bits: u64, words: usize) -> usize {
    let text = if words == 2 { Value::Single(f32::from_bits(bits as u32)) } else { Value::Double(f64::from_bits(bits)) };
    let text = text.text().unwrap_or_default();
    let mantissa = text.split('e').next().unwrap_or_default().trim_start_matches(['-', '0', '.']);
    mantissa.bytes().filter(u8::is_ascii_digit).count()
}
