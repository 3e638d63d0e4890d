//! Which type, in which order? Judged from the values that the same registers had over time.
//!
//! What counts, in bits: a lower register that jumps all over its range while the upper one hardly moves; carries, where
//! the upper one steps as the lower one wraps; numbers that are short in decimal, as people and sensors make them;
//! and that a master asks for just these registers. What an upper register that never moves leaves open, the order tells
//! that the device has elsewhere. Without any of it the registers are told as what they are, single.

use std::fmt::Write;

use crate::learn::floats::{float, SIZES};
use crate::learn::movement::Movement;
use crate::learn::whole::whole;
use crate::points::{Convert, Value};
use crate::profile::{Order, Type};

/// A reading of some registers, with what speaks for it.
#[derive(Clone, Debug)]
pub struct Claim {
    /// How they are read.
    pub kind: Type,
    /// In which order.
    pub order: Order,
    /// What speaks for it, in bits.
    pub bits: f64,
    /// The same in words.
    pub reason: String,
    /// Whether nothing else comes near.
    pub sure: bool,
    /// Mean step of the number: in the wrong order it is larger.
    pub(super) step: f64,
}

/// Enough to claim a type.
pub(super) const ENOUGH: f64 = 6.0;

/// Devices keep to an order, most of them.
const USUAL: f64 = 3.0;

/// Hardly any device turns the bytes of its registers.
const TURNED: f64 = 4.0;

/// What a carry is worth: that the upper part steps by one just where the lower one wraps, of all samples.
pub(super) const CARRY: f64 = 8.0;

/// What the best claim has to be ahead.
pub const AHEAD: f64 = 2.0;

/// A lower register that moves so far at a time is no quantity of its own.
pub(super) const WILD: f64 = 6_000.0;

/// Judges windows of two or four registers; `asked` is the share of requests that asked for just them, `usual` the order
/// that the device has shown elsewhere. Best claim first.
pub fn judge(rows: &[&[u16]], asked: f64, usual: Option<Order>) -> Vec<Claim> {
    let words = rows.first().map_or(0, |row| row.len());
    if !matches!(words, 2 | 4) || rows.iter().all(|row| row.iter().all(|&word| word == 0)) {
        return Vec::new();
    }
    let mut claims: Vec<Claim> = Vec::new();
    for (order, _) in Order::ALL {
        let values = bits_of(rows, words, order);
        claims.extend(float(&values, words, order, asked));
        claims.extend(whole(&values, words, order, asked));
    }
    for float in [false, true] {
        let same = |claim: &Claim| matches!(claim.kind, Type::F32 | Type::F64) == float;
        let least = claims.iter().filter(|claim| same(claim)).map(|claim| claim.step).fold(f64::MAX, f64::min).max(1.0);
        for claim in claims.iter_mut().filter(|claim| same(claim)) {
            claim.bits -= (claim.step.max(1.0) / least).log2().min(10.0);
        }
    }
    for claim in &mut claims {
        if Some(claim.order) == usual {
            claim.bits += USUAL;
        } else if matches!(claim.order, Order::Badc | Order::Dcba) {
            claim.bits -= TURNED;
        }
    }
    claims.retain(|claim| claim.bits > 0.0);
    claims.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    let ahead = match &claims[..] {
        [] => return claims,
        [only] => only.bits,
        [best, next, ..] => best.bits - next.bits,
    };
    claims[0].sure = claims[0].bits >= ENOUGH && ahead >= AHEAD;
    claims
}

/// Whether two or four registers may be a float in this order; where one sample is none, `judge` claims no float.
pub fn sensible_float(registers: &[u8], order: Order) -> bool {
    let kind = if registers.len() == 4 { Type::F32 } else { Type::F64 };
    let number = Convert::of_type(kind, order).value(registers, None).number();
    number.is_some_and(|number| number == 0.0 || SIZES.contains(&number.abs()))
}

fn bits_of(rows: &[&[u16]], words: usize, order: Order) -> Vec<u64> {
    let convert = Convert::of_type(if words == 2 { Type::U32 } else { Type::U64 }, order);
    let bits = |row: &&[u16]| {
        let mut bytes = [0; 8];
        for (pair, word) in bytes.chunks_exact_mut(2).zip(*row) {
            pair.copy_from_slice(&word.to_be_bytes());
        }
        convert.bits(&bytes)
    };
    rows.iter().map(bits).collect()
}

/// Bits for the movement, and the words for it.
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

pub(super) fn asked_for(asked: f64, reason: &mut String) -> f64 {
    if asked < 0.5 {
        return 0.0;
    }
    reason.push_str("the master asks for just these registers; ");
    6.0
}

/// The words for what these numbers would be.
pub(super) fn span(kind: Type, numbers: &[f64], reason: &mut String) {
    let least = figure(numbers.iter().copied().fold(f64::MAX, f64::min));
    let most = figure(numbers.iter().copied().fold(f64::MIN, f64::max));
    let _ = write!(reason, "as {} from {least} to {most}", kind.word());
}

fn figure(number: f64) -> String {
    Value::Double(if number.abs() < 1e15 { (number * 1e4).round() / 1e4 } else { number }).text().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn best(rows: &[[u16; 2]]) -> Option<(Type, Order)> {
        let rows: Vec<&[u16]> = rows.iter().map(|row| &row[..]).collect();
        let claims = judge(&rows, 0.0, None);
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
        judge(&rows, 0.0, usual).first().filter(|claim| claim.sure).map(|claim| (claim.kind, claim.order))
    }

    #[test]
    fn a_still_upper_half_needs_the_order_that_the_device_keeps_to() {
        let total: Vec<_> = (0..60u32).map(|i| words(0x0007_1234 + 3 * i, Order::Cdab)).collect();
        let debt: Vec<_> = (0..60u32).map(|i| words((-300_000i32 - 7 * (i % 13) as i32) as u32, Order::Cdab)).collect();
        for (rows, kind) in [(total, Type::U32), (debt, Type::S32)] {
            assert_eq!(claimed(&rows, Some(Order::Cdab)), Some((kind, Order::Cdab)));
            assert_eq!(claimed(&rows, Some(Order::Abcd)), None);
            assert_eq!(claimed(&rows, None), None);
        }
        // 65535 and 0 stand beside counters that have nothing to do with them.
        for idle in [0, 0xFFFF] {
            let rows: Vec<_> = (0..60u16).map(|i| [idle, 700 + 3 * i]).collect();
            assert_eq!(claimed(&rows, Some(Order::Abcd)), None);
        }
    }

    #[test]
    fn round_constants_are_floats() {
        // 12.25 and 100.0 (IEEE 754).
        assert_eq!(best(&[[0x4144, 0]; 40]), Some((Type::F32, Order::Abcd)));
        assert_eq!(best(&[[0, 0x42C8]; 40]), Some((Type::F32, Order::Cdab)));
        assert_eq!(best(&[[4711, 0]; 40]), None);
    }

    #[test]
    fn what_only_rises_is_no_float_below_zero() {
        let rows: Vec<_> = (0..90u32).map(|i| words(0xB747_1000 + 4001 * i, Order::Abcd)).collect();
        assert_eq!(best(&rows), Some((Type::U32, Order::Abcd)));
    }

    #[test]
    fn neighbours_that_have_nothing_to_do_with_each_other_are_undecided() {
        let pairs: Vec<_> = (0..60u16).map(|i| [200 + i % 7, 1000 + 3 * (i % 11)]).collect();
        assert_eq!(best(&pairs), None);
        assert_eq!(best(&[[1, 34_464]; 40]), None);
    }
}
