//! The evidence that registers are an integer.

use crate::learn::evidence::{coupling_bits, push_range, TypeHypothesis, CARRY_BITS, MIN_HYPOTHESIS_BITS, WILD_STEP};
use crate::learn::habits::Habits;
use crate::learn::movement::Movement;
use crate::learn::sequence::Sequence;
use crate::profile::{Order, Type};

/// A counter of four registers hardly ever uses more than the low bits of its highest register: this value bounds it.
const MAX_TOP_REGISTER: u64 = 0x0200;

/// The upper registers of floats that devices hold, from 1e-10 to 1e10.
const FLOATS: std::ops::Range<u64> = 0x3000..0x5000;

/// The upper registers of totals as floats: from one hundredth to 1e10.
const FLOAT_TOTALS: std::ops::Range<u64> = 0x3C20..0x5000;

/// The binary digits that integers of four registers use without a penalty.
const USUAL_DIGITS: f64 = 44.0;

/// So many different values that only rise are those of a counter.
const LONG_RISE: usize = 24;

/// Evidence in bits for a constant upper register beside a moving lower one.
const CONSTANT_UPPER_BITS: f64 = 3.5;

/// The hypothesis that the registers are an integer in the order that `values` were loaded with; `None` if the evidence
/// is too weak.
pub fn integer_hypothesis(sequence: &Sequence<'_, u64>, words: usize, order: Order, habits: &Habits) -> Option<TypeHypothesis> {
    let values = sequence.values;
    let movement = Movement::of(sequence, words, false);
    let width = 16 * words as u32;
    let top = |value: u64| value >> (width - 16);
    // An integer whose upper half is always zero is reported with the shorter type.
    let upper_half_empty = words == 4 && values.iter().all(|&value| value >> 32 == 0);
    let (any_negative, all_negative) =
        (values.iter().any(|&value| top(value) >= 0xFF00), values.iter().all(|&value| top(value) >= 0xF000));
    let any_small = values.iter().any(|&value| top(value) < 0x0100);
    let signed = (any_negative && any_small) || all_negative;
    // Integers of this size are rarer than floats by far: a u32 would be above a thousand million, and not a time. Of a
    // total, the other totals of the device say which.
    let floats = if movement.is_rising { FLOAT_TOTALS } else { FLOATS };
    let is_integer_total = movement.is_rising && habits.has_integer_totals();
    let all_floats = !is_integer_total && values.iter().all(|&value| value == 0 || floats.contains(&top(value)));
    if movement.distinct < 2 || upper_half_empty || all_floats {
        return None;
    }
    let mut reason = String::new();
    let constant_upper_bits = if words == 2 { constant_upper_half(sequence, habits.are_known(), &mut reason) } else { 0.0 };
    let mut bits =
        if words == 4 { four_registers(sequence, &movement, signed, &mut reason) } else { coupling_bits(&movement, &mut reason) };
    bits = bits.max(constant_upper_bits);
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0) + movement.stillness;
    if all_negative && !any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("small negative numbers; ");
    }
    if signed && any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("the sign changes where the value crosses zero; ");
    }
    if bits < MIN_HYPOTHESIS_BITS && constant_upper_bits == 0.0 {
        return None;
    }
    let kind = match (words, signed) {
        (2, false) => Type::U32,
        (2, true) => Type::S32,
        (_, false) => Type::U64,
        (_, true) => Type::S64,
    };
    let number = |value: &u64| {
        if words == 2 && signed {
            f64::from(*value as u32 as i32)
        } else if signed {
            *value as i64 as f64
        } else {
            *value as f64
        }
    };
    let numbers: Vec<f64> = values.iter().map(number).collect();
    push_range(kind, &numbers, &mut reason);
    Some(TypeHypothesis { kind, order, bits, reason, is_certain: false, is_rising: movement.is_rising, mean_step: movement.step })
}

/// Penalty in bits for an integer of four registers that moves and is larger than plants need: half a bit for each doubling.
fn size_penalty(values: &[u64], signed: bool) -> f64 {
    let size = |&value: &u64| if signed { (value as i64).unsigned_abs() } else { value };
    let most = values.iter().map(size).max().unwrap_or(0).max(1);
    0.5 * ((most as f64).log2() - USUAL_DIGITS).max(0.0)
}

/// The least number in a lower half that suffices where the order of the device is not known: smaller ones are often counters
/// of their own.
const LEAST_LOWER: u64 = 0x1000;

/// The upper halves of totals where the order of the device is not known.
const USUAL_UPPER: u64 = 0x800;

/// Evidence in bits for an upper register that never changes, beside a lower one that does. Without the order that the
/// device uses elsewhere, it suffices for a long rise only.
fn constant_upper_half(sequence: &Sequence<'_, u64>, is_order_known: bool, reason: &mut String) -> f64 {
    let values = sequence.values;
    let top = values[0] >> 16;
    let mut lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF).collect();
    let rising = lower.windows(2).all(|pair| pair[0] <= pair[1]);
    lower.dedup();
    let is_long = rising && lower.len() >= LONG_RISE && lower.last() >= Some(&LEAST_LOWER) && top < USUAL_UPPER;
    if !is_order_known && !is_long {
        return 0.0;
    }
    if values.iter().any(|value| value >> 16 != top) || lower.len() < 5 {
        return 0.0;
    }
    match top {
        // Small negative registers of their own, such as exponents, are more frequent than that.
        0xFF00..=0xFFF0 => {
            reason.push_str("the upper register is that of a small negative number; ");
            CONSTANT_UPPER_BITS
        }
        1..0x8000 if rising => {
            reason.push_str("one register only rises and the other is constant, like the halves of a counter; ");
            // Counters have values of all magnitudes, so small upper halves are more frequent than large ones
            // (Benford's law). Unrelated constants are small, too, but less often.
            let rises = if lower.len() >= LONG_RISE { 2.0 } else { 0.0 };
            let upper = (65_536.0 / (11.0 * top as f64)).log2().clamp(-CONSTANT_UPPER_BITS, 2.0);
            // The lower half of a number has all values alike; a counter of its own has small ones more often.
            let most = lower.iter().copied().max().unwrap_or(0).max(1);
            let lower = (11.0 * most as f64 / 65_536.0).log2().clamp(-2.5, 0.0);
            CONSTANT_UPPER_BITS + upper + rises + lower
        }
        _ => 0.0,
    }
}

/// Evidence in bits for an integer of four registers. Its upper and lower halves are judged as numbers of two
/// registers.
fn four_registers(sequence: &Sequence<'_, u64>, movement: &Movement, signed: bool, reason: &mut String) -> f64 {
    let upper: Vec<u64> = sequence.values.iter().map(|value| value >> 32).collect();
    let halves = |values: &[u64]| Movement::of(&Sequence { values, follows: sequence.follows }, 2, false);
    let changes = upper.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let is_large = |half: &u64| (MAX_TOP_REGISTER..0xFFFF - MAX_TOP_REGISTER).contains(&(half >> 16));
    // Only carries show that a number is so large.
    if upper.iter().any(is_large) && (changes == 0 || changes * 20 > upper.len()) {
        return 0.0;
    }
    if changes * 20 <= upper.len() {
        // Either a counter whose upper half hardly moves, or a shorter number after constants. The carries
        // decide.
        let lower: Vec<u64> = sequence.values.iter().map(|value| value & 0xFFFF_FFFF).collect();
        let bits = coupling_bits(&halves(&lower), reason);
        let carries = (1..upper.len()).filter(|&at| upper[at] == upper[at - 1] + 1).count();
        let is_plausible_counter = !signed && upper[0] > 0 && upper[0] >> 16 < MAX_TOP_REGISTER;
        return match (bits > 0.0, carries == changes) {
            (true, true) if changes > 0 => bits + CARRY_BITS * changes as f64,
            (true, true) => bits + if is_plausible_counter { 2.0 } else { -3.0 },
            _ => 0.0,
        };
    }
    // If the upper half changes often, the lower registers must jump over their whole range.
    if movement.low_step < WILD_STEP || movement.next_step < WILD_STEP {
        return 0.0;
    }
    let mut bits = coupling_bits(movement, reason) + coupling_bits(&halves(&upper), &mut String::new());
    bits -= size_penalty(sequence.values, signed);
    if signed && upper.iter().all(|half| matches!(half >> 16, 0 | 0xFFFF)) {
        reason.push_str("the highest register holds only the sign; ");
        return bits + 8.0;
    }
    bits
}
