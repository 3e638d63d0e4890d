//! Which type, in which order? Judged from the values that the same registers had over time.
//!
//! What counts, in bits: a lower register that jumps all over its range while the upper one hardly moves; carries, where
//! the upper one steps as the lower one wraps; numbers that are short in decimal, as people and sensors make them;
//! and that a master asks for just these registers. What an upper register that never moves leaves open, the order tells
//! that the device has elsewhere. Without any of it the registers are told as what they are, single.

use std::fmt::Write;

use crate::learn::movement::Movement;
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
    step: f64,
}

/// Enough to claim a type.
const ENOUGH: f64 = 6.0;

/// Devices keep to an order, most of them.
const USUAL: f64 = 3.0;

/// Hardly any device turns the bytes of its registers.
const TURNED: f64 = 4.0;

/// What a carry is worth: that the upper part steps by one just where the lower one wraps, of all samples.
const CARRY: f64 = 8.0;

/// A number that only rises is a counter, not what a sensor gives.
const RISING: f64 = 8.0;

/// A total in four registers is not so large that more than these bits of the highest one are used.
const TOP: u64 = 0x0200;

/// A constant that is a round number as a float.
const ROUND: f64 = 6.0;

/// An upper register that never moves.
const STILL: f64 = 3.5;

/// What the best claim has to be ahead.
pub(super) const AHEAD: f64 = 2.0;

/// A lower register that moves so far at a time is no quantity of its own.
const WILD: f64 = 6_000.0;

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

fn floats(values: &[u64], words: usize) -> Vec<f64> {
    let float = |&bits: &u64| if words == 2 { f64::from(f32::from_bits(bits as u32)) } else { f64::from_bits(bits) };
    values.iter().map(float).collect()
}

/// Sizes of quantities of plants: from hundredths of a milli to some hundred millions.
const SIZES: std::ops::Range<f64> = 1e-5..1e9;

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

/// Bits for the movement, and the words for it.
fn coupling(movement: &Movement, reason: &mut String) -> f64 {
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

fn asked_for(asked: f64, reason: &mut String) -> f64 {
    if asked < 0.5 {
        return 0.0;
    }
    reason.push_str("the master asks for just these registers; ");
    6.0
}

fn float(values: &[u64], words: usize, order: Order, asked: f64) -> Option<Claim> {
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
    let _ = write!(
        reason,
        "as {} from {} to {}",
        kind.word(),
        figure(numbers.iter().copied().fold(f64::MAX, f64::min)),
        figure(numbers.iter().copied().fold(f64::MIN, f64::max))
    );
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

fn whole(values: &[u64], words: usize, order: Order, asked: f64) -> Option<Claim> {
    let movement = Movement::of(values, words, false);
    let width = 16 * words as u32;
    let top = |value: u64| value >> (width - 16);
    // Numbers whose upper half is empty are told as the shorter type they may be.
    let upper_half_empty = words == 4 && values.iter().all(|&value| value >> 32 == 0);
    let (any_negative, all_negative) =
        (values.iter().any(|&value| top(value) >= 0xFF00), values.iter().all(|&value| top(value) >= 0xF000));
    let any_small = values.iter().any(|&value| top(value) < 0x0100);
    let signed = (any_negative && any_small) || all_negative;
    if movement.distinct < 2 || (upper_half_empty && asked < 0.5) {
        return None;
    }
    let mut reason = String::new();
    let mut bits = asked_for(asked, &mut reason);
    let still = if words == 2 { still_half(values, &mut reason) } else { 0.0 };
    bits += if words == 4 { halves(values, &movement, signed, &mut reason) } else { coupling(&movement, &mut reason) };
    bits = bits.max(still);
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
    if all_negative && !any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("small below zero; ");
    }
    if signed && any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("the sign changes where the value passes zero; ");
    }
    if bits < ENOUGH && still == 0.0 {
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
    let _ = write!(
        reason,
        "as {} from {} to {}",
        kind.word(),
        figure(numbers.iter().copied().fold(f64::MAX, f64::min)),
        figure(numbers.iter().copied().fold(f64::MIN, f64::max))
    );
    Some(Claim { kind, order, bits, reason, sure: false, step: movement.step })
}

/// Bits for an upper register that never moves, beside a lower one that does: never enough without the order that the
/// device has shown elsewhere.
fn still_half(values: &[u64], reason: &mut String) -> f64 {
    let top = values[0] >> 16;
    let mut lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF).collect();
    let rising = lower.windows(2).all(|pair| pair[0] <= pair[1]);
    lower.dedup();
    if values.iter().any(|value| value >> 16 != top) || lower.len() < 5 {
        return 0.0;
    }
    match top {
        // 65535 alone says "not there" in many devices.
        0xFF00..=0xFFFE => {
            reason.push_str("the upper register is that of a small number below zero; ");
            STILL
        }
        1..0x8000 if rising => {
            reason.push_str("a register that only rises beside a constant one, as the halves of a total; ");
            // Totals are of all sizes, so small upper halves are more frequent than large ones (Benford); constants of
            // their own are small, too, but not that much.
            STILL + (65_536.0 / (11.0 * top as f64)).log2().clamp(-STILL, 2.0)
        }
        _ => 0.0,
    }
}

/// Bits for a whole number of four registers: its halves are judged as numbers of two.
fn halves(values: &[u64], whole: &Movement, signed: bool, reason: &mut String) -> f64 {
    let upper: Vec<u64> = values.iter().map(|value| value >> 32).collect();
    let changes = upper.windows(2).filter(|pair| pair[0] != pair[1]).count();
    if changes * 20 <= upper.len() {
        // A total whose upper half hardly moves; or a shorter one behind constants.
        let lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF_FFFF).collect();
        let bits = coupling(&Movement::of(&lower, 2, false), reason);
        let carries = (1..upper.len()).filter(|&at| upper[at] == upper[at - 1] + 1 && lower[at] < lower[at - 1]).count();
        let total = !signed && upper[0] > 0 && upper[0] >> 16 < TOP;
        return match (bits > 0.0, carries == changes) {
            (true, true) => bits + CARRY * changes as f64 + if total { 2.0 } else { -3.0 },
            _ => 0.0,
        };
    }
    // An upper half that moves leaves nothing smooth below it.
    if whole.low_step < WILD || whole.next_step < WILD {
        return 0.0;
    }
    let bits = coupling(whole, reason) + coupling(&Movement::of(&upper, 2, false), &mut String::new());
    if signed && upper.iter().all(|half| matches!(half >> 16, 0 | 0xFFFF)) {
        reason.push_str("the highest register is nothing but the sign; ");
        return bits + 8.0;
    }
    bits
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
