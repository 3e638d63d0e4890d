//! The evidence that registers are an integer.

use crate::learn::evidence::{
    coupling_bits, push_range, request_bits, TypeHypothesis, CARRY_BITS, MIN_HYPOTHESIS_BITS, WILD_STEP,
};
use crate::learn::movement::Movement;
use crate::profile::{Order, Type};

/// A counter of four registers hardly ever uses more than the low bits of its highest register: this value bounds it.
const MAX_TOP_REGISTER: u64 = 0x0200;

/// Evidence in bits for a constant upper register beside a moving lower one.
const CONSTANT_UPPER_BITS: f64 = 3.5;

/// The hypothesis that the registers are an integer in the order that `values` were loaded with; `None` if the evidence
/// is too weak.
pub fn integer_hypothesis(values: &[u64], words: usize, order: Order, exact_request_share: f64) -> Option<TypeHypothesis> {
    let movement = Movement::of(values, words, false);
    let width = 16 * words as u32;
    let top = |value: u64| value >> (width - 16);
    // An integer whose upper half is always zero is reported with the shorter type, unless the master requests all four
    // registers.
    let upper_half_empty = words == 4 && values.iter().all(|&value| value >> 32 == 0);
    let (any_negative, all_negative) =
        (values.iter().any(|&value| top(value) >= 0xFF00), values.iter().all(|&value| top(value) >= 0xF000));
    let any_small = values.iter().any(|&value| top(value) < 0x0100);
    let signed = (any_negative && any_small) || all_negative;
    if movement.distinct < 2 || (upper_half_empty && exact_request_share < 0.5) {
        return None;
    }
    let mut reason = String::new();
    let mut bits = request_bits(exact_request_share, &mut reason);
    let constant_upper_bits = if words == 2 { constant_upper_half(values, &mut reason) } else { 0.0 };
    bits +=
        if words == 4 { four_registers(values, &movement, signed, &mut reason) } else { coupling_bits(&movement, &mut reason) };
    bits = bits.max(constant_upper_bits);
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
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
    Some(TypeHypothesis { kind, order, bits, reason, is_certain: false, mean_step: movement.step })
}

/// Evidence in bits for an upper register that never changes, beside a lower one that does. It never suffices without
/// the order that the device uses elsewhere.
fn constant_upper_half(values: &[u64], reason: &mut String) -> f64 {
    let top = values[0] >> 16;
    let mut lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF).collect();
    let rising = lower.windows(2).all(|pair| pair[0] <= pair[1]);
    lower.dedup();
    if values.iter().any(|value| value >> 16 != top) || lower.len() < 5 {
        return 0.0;
    }
    match top {
        // 65535 is excluded because many devices use it for "not available".
        0xFF00..=0xFFFE => {
            reason.push_str("the upper register is that of a small negative number; ");
            CONSTANT_UPPER_BITS
        }
        1..0x8000 if rising => {
            reason.push_str("one register only rises and the other is constant, like the halves of a counter; ");
            // Counters have values of all magnitudes, so small upper halves are more frequent than large ones
            // (Benford's law). Unrelated constants are small as well, but less often.
            CONSTANT_UPPER_BITS + (65_536.0 / (11.0 * top as f64)).log2().clamp(-CONSTANT_UPPER_BITS, 2.0)
        }
        _ => 0.0,
    }
}

/// Evidence in bits for an integer of four registers. Its upper and lower halves are judged as numbers of two
/// registers.
fn four_registers(values: &[u64], movement: &Movement, signed: bool, reason: &mut String) -> f64 {
    let upper: Vec<u64> = values.iter().map(|value| value >> 32).collect();
    let changes = upper.windows(2).filter(|pair| pair[0] != pair[1]).count();
    if changes * 20 <= upper.len() {
        // Either a counter whose upper half hardly moves, or a shorter number after constants. The two are distinguished
        // by the carries.
        let lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF_FFFF).collect();
        let bits = coupling_bits(&Movement::of(&lower, 2, false), reason);
        let carries = (1..upper.len()).filter(|&at| upper[at] == upper[at - 1] + 1 && lower[at] < lower[at - 1]).count();
        let is_plausible_counter = !signed && upper[0] > 0 && upper[0] >> 16 < MAX_TOP_REGISTER;
        return match (bits > 0.0, carries == changes) {
            (true, true) => bits + CARRY_BITS * changes as f64 + if is_plausible_counter { 2.0 } else { -3.0 },
            _ => 0.0,
        };
    }
    // If the upper half changes often, the lower registers must jump over their whole range.
    if movement.low_step < WILD_STEP || movement.next_step < WILD_STEP {
        return 0.0;
    }
    let bits = coupling_bits(movement, reason) + coupling_bits(&Movement::of(&upper, 2, false), &mut String::new());
    if signed && upper.iter().all(|half| matches!(half >> 16, 0 | 0xFFFF)) {
        reason.push_str("the highest register holds only the sign; ");
        return bits + 8.0;
    }
    bits
}
