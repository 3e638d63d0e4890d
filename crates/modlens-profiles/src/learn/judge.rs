//! Ranks the types and orders that two or four registers may have, by the values that they had over time.
//!
//! Evidence, in bits: a lower register that jumps over its whole range while the upper one hardly moves; carries, where
//! the upper register steps as the lower one wraps; numbers that are short in decimal, as people and sensors make them;
//! and a master that requests exactly these registers. Where an upper register never moves, the order that the device
//! uses elsewhere decides. Without any such evidence the registers are reported as separate 16-bit values.

use std::fmt::Write;

use crate::learn::floats::{float, SIZES};
use crate::learn::movement::Movement;
use crate::learn::whole::whole;
use crate::points::{Conversion, Value};
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
    pub sure: bool,
    /// Mean absolute difference between consecutive samples. A wrong order makes it larger.
    pub(super) step: f64,
}

/// The evidence that a type needs to be reported, in bits.
pub(super) const ENOUGH: f64 = 6.0;

/// Bonus in bits for the order that the device uses elsewhere; most devices use only one.
const DEVICE_ORDER_BITS: f64 = 3.0;

/// Penalty in bits for an order with the low byte first, which hardly any device uses.
const SWAPPED_BYTES_PENALTY_BITS: f64 = 4.0;

/// Evidence in bits for one carry: among all samples, the upper part steps by one exactly where the lower part wraps.
pub(super) const CARRY: f64 = 8.0;

/// The margin in bits by which the best hypothesis must beat the second to be certain.
pub const AHEAD: f64 = 2.0;

/// A register with a mean step above this moves too far to be a quantity of its own, so it is likely the lower part of
/// a larger number.
pub(super) const WILD: f64 = 6_000.0;

/// Ranks the hypotheses for two or four consecutive registers, best first. `rows` has one sample per row. `asked` is
/// the share of requests for these registers that asked for exactly them, `usual` the order that the device uses
/// elsewhere.
///
/// Hypotheses of one kind (floats or integers) are compared by how smoothly the number moves: each doubling of the mean
/// step costs a bit.
pub fn rank_types(rows: &[&[u16]], asked: f64, usual: Option<Order>) -> Vec<TypeHypothesis> {
    let words = rows.first().map_or(0, |row| row.len());
    if !matches!(words, 2 | 4) || rows.iter().all(|row| row.iter().all(|&word| word == 0)) {
        return Vec::new();
    }
    let mut claims: Vec<TypeHypothesis> = Vec::new();
    for (order, _) in Order::ALL {
        let values = bits_of(rows, words, order);
        claims.extend(float(&values, words, order, asked));
        claims.extend(whole(&values, words, order, asked));
    }
    for float in [false, true] {
        let is_of_kind = |claim: &TypeHypothesis| matches!(claim.kind, Type::F32 | Type::F64) == float;
        let least_step =
            claims.iter().filter(|claim| is_of_kind(claim)).map(|claim| claim.step).fold(f64::MAX, f64::min).max(1.0);
        for claim in claims.iter_mut().filter(|claim| is_of_kind(claim)) {
            claim.bits -= (claim.step.max(1.0) / least_step).log2().min(10.0);
        }
    }
    for claim in &mut claims {
        if Some(claim.order) == usual {
            claim.bits += DEVICE_ORDER_BITS;
        } else if matches!(claim.order, Order::Badc | Order::Dcba) {
            claim.bits -= SWAPPED_BYTES_PENALTY_BITS;
        }
    }
    claims.retain(|claim| claim.bits > 0.0);
    claims.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    let margin = match &claims[..] {
        [] => return claims,
        [only] => only.bits,
        [best, next, ..] => best.bits - next.bits,
    };
    claims[0].sure = claims[0].bits >= ENOUGH && margin >= AHEAD;
    claims
}

/// Whether the bytes of two or four registers are a plausible float in this order. If one sample is not, `rank_types` does
/// not consider a float.
pub fn sensible_float(registers: &[u8], order: Order) -> bool {
    let kind = if registers.len() == 4 { Type::F32 } else { Type::F64 };
    let number = Conversion::of_type(kind, order).value(registers, None).number();
    number.is_some_and(|number| number == 0.0 || SIZES.contains(&number.abs()))
}

/// The samples as integers, with the registers and bytes in this order.
fn bits_of(rows: &[&[u16]], words: usize, order: Order) -> Vec<u64> {
    let convert = Conversion::of_type(if words == 2 { Type::U32 } else { Type::U64 }, order);
    let bits = |row: &&[u16]| {
        let mut bytes = [0; 8];
        for (pair, word) in bytes.chunks_exact_mut(2).zip(*row) {
            pair.copy_from_slice(&word.to_be_bytes());
        }
        convert.bits(&bytes)
    };
    rows.iter().map(bits).collect()
}

/// The evidence, in bits, that the lower register continues the upper one; appends it as text to `reason`.
pub(super) fn coupling(movement: &Movement, reason: &mut String) -> f64 {
    let mut bits = 0.0;
    if movement.high_changes > 0 && movement.carries == movement.high_changes {
        bits += (CARRY * f64::from(movement.carries)).min(24.0);
        let _ = write!(reason, "the upper part steps as the lower register wraps ({} times); ", movement.carries);
    }
    if movement.low_step > WILD {
        bits += movement.fit;
        if movement.fit > 2.0 {
            reason.push_str("the lower register tells what the steps of the upper one leave open; ");
        }
    }
    if movement.distinct > 4 && movement.low_step > WILD && movement.high_step < movement.low_step / 16.0 {
        bits += 8.0;
        reason.push_str("the lower register jumps all over its range, the upper one hardly moves; ");
        if movement.next_step > WILD && movement.next_step.to_bits() != movement.low_step.to_bits() {
            bits += 6.0;
        }
    }
    bits
}

/// The evidence, in bits, of the master's requests: a master that reads exactly these registers reads one value.
pub(super) fn asked_for(asked: f64, reason: &mut String) -> f64 {
    if asked < 0.5 {
        return 0.0;
    }
    reason.push_str("the master asks for just these registers; ");
    6.0
}

/// Appends the range of the numbers to the reason.
pub(super) fn span(kind: Type, numbers: &[f64], reason: &mut String) {
    let least = rounded_text(numbers.iter().copied().fold(f64::MAX, f64::min));
    let most = rounded_text(numbers.iter().copied().fold(f64::MIN, f64::max));
    let _ = write!(reason, "as {} from {least} to {most}", kind.word());
}

/// A number as text, rounded to four decimals.
fn rounded_text(number: f64) -> String {
    Value::Double(if number.abs() < 1e15 { (number * 1e4).round() / 1e4 } else { number }).text().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn best(rows: &[[u16; 2]]) -> Option<(Type, Order)> {
        let rows: Vec<&[u16]> = rows.iter().map(|row| &row[..]).collect();
        let claims = rank_types(&rows, 0.0, None);
        claims.first().filter(|claim| claim.sure).map(|claim| (claim.kind, claim.order))
    }

    fn words(bits: u32, order: Order) -> [u16; 2] {
        let (high, low) = ((bits >> 16) as u16, bits as u16);
        match order {
            Order::Abcd => [high, low],
            Order::Cdab => [low, high],
            Order::Badc => [high.swap_bytes(), low.swap_bytes()],
            Order::Dcba => [low.swap_bytes(), high.swap_bytes()],
        }
    }

    #[test]
    fn floats_and_counters_in_every_order() {
        for (order, _) in Order::ALL {
            let floats: Vec<_> =
                (0..60).map(|i| words(((f64::from(i) * 0.37).sin() as f32 * 3.0 + 21.0).to_bits(), order)).collect();
            assert_eq!(best(&floats), Some((Type::F32, order)));
            let counter: Vec<_> = (0..60u32).map(|i| words(1_234_567 + 1_931 * i, order)).collect();
            assert_eq!(best(&counter), Some((Type::U32, order)));
        }
    }

    fn claimed(rows: &[[u16; 2]], usual: Option<Order>) -> Option<(Type, Order)> {
        let rows: Vec<&[u16]> = rows.iter().map(|row| &row[..]).collect();
        rank_types(&rows, 0.0, usual).first().filter(|claim| claim.sure).map(|claim| (claim.kind, claim.order))
    }

    #[test]
    fn a_constant_upper_register_needs_the_order_of_the_device() {
        let total: Vec<_> = (0..60u32).map(|i| words(0x0007_1234 + 3 * i, Order::Cdab)).collect();
        let debt: Vec<_> = (0..60u32).map(|i| words((-300_000i32 - 7 * (i % 13) as i32) as u32, Order::Cdab)).collect();
        for (rows, kind) in [(total, Type::U32), (debt, Type::S32)] {
            assert_eq!(claimed(&rows, Some(Order::Cdab)), Some((kind, Order::Cdab)));
            assert_eq!(claimed(&rows, Some(Order::Abcd)), None);
            assert_eq!(claimed(&rows, None), None);
        }
        // 65535 and 0 often stand beside counters to which they do not belong.
        for idle in [0, 0xFFFF] {
            let rows: Vec<_> = (0..60u16).map(|i| [idle, 700 + 3 * i]).collect();
            assert_eq!(claimed(&rows, Some(Order::Abcd)), None);
        }
    }

    #[test]
    fn round_constants_are_recognised_as_floats() {
        // 12.25 and 100.0 (IEEE 754).
        assert_eq!(best(&[[0x4144, 0]; 40]), Some((Type::F32, Order::Abcd)));
        assert_eq!(best(&[[0, 0x42C8]; 40]), Some((Type::F32, Order::Cdab)));
        assert_eq!(best(&[[4711, 0]; 40]), None);
    }

    #[test]
    fn a_rising_bit_pattern_is_not_a_negative_float() {
        let rows: Vec<_> = (0..90u32).map(|i| words(0xB747_1000 + 4001 * i, Order::Abcd)).collect();
        assert_eq!(best(&rows), Some((Type::U32, Order::Abcd)));
    }

    #[test]
    fn unrelated_neighbours_get_no_type() {
        let pairs: Vec<_> = (0..60u16).map(|i| [200 + i % 7, 1000 + 3 * (i % 11)]).collect();
        assert_eq!(best(&pairs), None);
        assert_eq!(best(&[[1, 34_464]; 40]), None);
    }
}
