//! The evidence that floats and integers have in common, in bits (log2 of a likelihood ratio).

use std::fmt::Write;

use crate::learn::movement::Movement;
use crate::points::Value;
use crate::profile::{Order, Type};

/// A hypothesis about the type and order of some registers, with the evidence for it.
#[derive(Clone, Debug)]
pub struct TypeHypothesis {
    /// The type.
    pub kind: Type,
    /// The order of registers and bytes.
    pub order: Order,
    /// The evidence for it, in bits (log2 of a likelihood ratio against separate registers).
    pub bits: f64,
    /// The evidence as text.
    pub reason: String,
    /// Whether no other hypothesis comes close.
    pub is_certain: bool,
    /// Whether the numbers only rise.
    pub(super) is_rising: bool,
    /// Mean absolute difference between consecutive samples. A wrong order makes it larger.
    pub(super) mean_step: f64,
}

/// The evidence that a type needs to be reported, in bits.
pub(super) const MIN_HYPOTHESIS_BITS: f64 = 6.0;

/// Evidence in bits for one carry: among all samples, the upper part steps by one exactly where the lower part wraps.
pub(super) const CARRY_BITS: f64 = 8.0;

/// The margin in bits by which the best hypothesis must beat the second to be certain.
pub const MIN_MARGIN_BITS: f64 = 2.0;

/// A register with a mean step above this moves too far to be a quantity of its own, so it is likely the lower part of
/// a larger number.
pub(super) const WILD_STEP: f64 = 6_000.0;

/// Plausible magnitudes of quantities in plants: from hundredths of a milli-unit to some hundred millions.
pub const PLAUSIBLE_MAGNITUDES: std::ops::Range<f64> = 1e-5..1e9;

/// The evidence, in bits, that the lower register continues the upper one; appends it as text to `reason`.
pub(super) fn coupling_bits(movement: &Movement, reason: &mut String) -> f64 {
    let mut bits = 0.0;
    if movement.high_changes > 0 && movement.carries == movement.high_changes {
        bits += (CARRY_BITS * f64::from(movement.carries)).min(24.0);
        let _ = write!(reason, "the upper register steps as the lower one wraps around ({} times); ", movement.carries);
    } else if movement.carries >= 4 && movement.carries * 4 >= movement.high_changes * 3 {
        // By chance, a step of the upper register is a carry in one of four cases.
        let misses = movement.high_changes - movement.carries;
        bits += (2.0 * f64::from(movement.carries) - 3.0 * f64::from(misses)).clamp(0.0, 24.0);
        let _ = write!(reason, "the upper register mostly steps as the lower one wraps around; ");
    }
    if movement.low_step > WILD_STEP {
        bits += movement.fit;
        if movement.fit > 2.0 {
            reason.push_str("the lower register fills in between the steps of the upper one; ");
        }
    }
    if movement.distinct > 4 && movement.low_step > WILD_STEP && movement.high_step < movement.low_step / 16.0 {
        bits += 8.0;
        reason.push_str("the lower register varies over its whole range, the upper one hardly changes; ");
        if movement.next_step > WILD_STEP && movement.next_step.to_bits() != movement.low_step.to_bits() {
            bits += 6.0;
        }
    }
    bits
}

/// Appends the range of the numbers to the reason.
pub(super) fn push_range(kind: Type, numbers: &[f64], reason: &mut String) {
    let least = rounded_text(numbers.iter().copied().fold(f64::MAX, f64::min));
    let most = rounded_text(numbers.iter().copied().fold(f64::MIN, f64::max));
    let _ = write!(reason, "read as {} from {least} to {most}", kind.word());
}

/// A number as text, rounded to four decimals.
fn rounded_text(number: f64) -> String {
    Value::Double(if number.abs() < 1e15 { (number * 1e4).round() / 1e4 } else { number }).text().unwrap_or_default()
}
