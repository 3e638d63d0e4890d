//! Which type, in which order? Judged from the values that the same registers had over time.
//!
//! What counts, in bits: a lower register that jumps all over its range while the upper one hardly moves; carries, where
//! the upper one steps as the lower one wraps; numbers that are short in decimal, as people and sensors make them; and
//! that a master asks for just these registers. Without any of it the registers are told as what they are, single.

use std::fmt::Write;

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

/// Bits for a fit of registers, at least and at most.
const LEAST_FIT: f64 = 8.0;
const MOST_FIT: f64 = 16.0;

/// What the best claim has to be ahead.
const AHEAD: f64 = 2.0;

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

/// Whether these registers make sense as floats in an order other than this one; if not, `judge` claims no such float.
pub fn float_elsewhere(rows: &[&[u16]], order: Order) -> bool {
    let words = rows.first().map_or(0, |row| row.len());
    let others = Order::ALL.iter().filter(|(other, _)| *other != order);
    matches!(words, 2 | 4) && others.clone().any(|(other, _)| sizes(&floats(&bits_of(rows, words, *other), words)).is_some())
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

/// Smallest and largest size, where they are those of quantities of plants: from hundredths of a milli to some hundred
/// millions.
fn sizes(numbers: &[f64]) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::MAX, 0.0f64);
    for size in numbers.iter().filter(|&&number| number != 0.0).map(|number| number.abs()) {
        if !(1e-5..1e9).contains(&size) {
            return None;
        }
        (low, high) = (low.min(size), high.max(size));
    }
    (high > 0.0 && high / low <= 1e6).then_some((low, high))
}

/// What the values do as numbers of one order.
struct Movement {
    /// Mean step of the lowest register, in the order of its bytes that makes it smaller.
    low_step: f64,
    /// The same of the one above it, where there are four.
    next_step: f64,
    /// Mean step of the highest register.
    high_step: f64,
    /// Steps at which all above the lowest register moved otherwise than usual, and how many of these were carries.
    high_changes: u32,
    carries: u32,
    distinct: usize,
    /// How much more often an upper byte moves than one below it.
    disorder: f64,
    /// Mean step of the whole number.
    step: f64,
    /// Bits for the lower half as digits behind the upper one.
    fit: f64,
}

fn movement(values: &[u64], words: usize, float: bool) -> Movement {
    let numbers: Vec<i128> = values.iter().map(|&bits| sortable(bits, words, float)).collect();
    let steps = |of: &dyn Fn(u64) -> i64| {
        let sum: u64 = values.windows(2).map(|pair| (of(pair[1]) - of(pair[0])).unsigned_abs()).sum();
        sum as f64 / values.len().saturating_sub(1).max(1) as f64
    };
    let word = |bits: u64, at: usize| (bits >> (16 * at)) as u16;
    let low = |at: usize| steps(&|bits| i64::from(word(bits, at))).min(steps(&|bits| i64::from(word(bits, at).swap_bytes())));
    // The sign of a float is no size; that of a whole number wraps through zero.
    let high = |bits: u64| {
        let top = word(bits, words - 1);
        if float {
            i64::from(top & 0x7FFF)
        } else {
            i64::from(top as i16)
        }
    };
    let deltas: Vec<i128> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let uppers: Vec<i128> = numbers.windows(2).map(|pair| (pair[1] >> 16) - (pair[0] >> 16)).collect();
    let (usual, usual_upper) = (median(&deltas), median(&uppers));
    let odd = || deltas.iter().zip(&uppers).filter(|(_, upper)| **upper != usual_upper);
    let carries = odd().filter(|(delta, _)| (**delta - usual).abs() < 0x4000).count();
    let mut distinct = values.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    let step = deltas.iter().map(|delta| delta.unsigned_abs() as f64).sum::<f64>() / deltas.len().max(1) as f64;
    Movement {
        low_step: low(0),
        next_step: low(words / 2 - 1),
        high_step: steps(&high),
        high_changes: odd().count() as u32,
        carries: carries as u32,
        distinct: distinct.len(),
        disorder: disorder(values, words),
        step,
        fit: fit(&numbers, 8 * words as u32),
    }
}

/// Whether the steps of a number are smoother than those of its upper half alone.
///
/// They are where the lower half are its digits: rounding them off adds the variance of rounding twice, 1/6. Where
/// they belong to something else, they are noise, and it is the whole that has so much more.
fn fit(numbers: &[i128], below: u32) -> f64 {
    // Counters wrap through zero, and their upper halves.
    let wrapped = |step: i128, width: u32| (step + (1 << (width - 1))).rem_euclid(1 << width) - (1 << (width - 1));
    let variance = |of: &dyn Fn(i128, i128) -> f64| {
        let steps: Vec<f64> = numbers.windows(2).map(|pair| of(pair[0], pair[1])).collect();
        let count = steps.len().max(1) as f64;
        let mean = steps.iter().sum::<f64>() / count;
        steps.iter().map(|step| (step - mean) * (step - mean)).sum::<f64>() / count
    };
    let top = variance(&|one, next| wrapped((next >> below) - (one >> below), below) as f64);
    let whole = variance(&|one, next| wrapped(next - one, 2 * below) as f64 / (1u128 << below) as f64);
    if top == 0.0 || whole == 0.0 {
        return 0.0;
    }
    (numbers.len() as f64 / 2.0 * (top / whole).log2()).clamp(-LEAST_FIT, MOST_FIT)
}

/// The bits as a number that is larger where the value is.
fn sortable(bits: u64, words: usize, float: bool) -> i128 {
    let width = 16 * words as u32;
    let negative = bits >> (width - 1) & 1 == 1;
    let magnitude = i128::from(bits & !(1 << (width - 1)));
    match (negative, float) {
        (false, _) => i128::from(bits),
        (true, true) => -magnitude,
        (true, false) => magnitude - (1 << (width - 1)),
    }
}

fn median(numbers: &[i128]) -> i128 {
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).copied().unwrap_or(0)
}

fn disorder(values: &[u64], words: usize) -> f64 {
    let mut moves = vec![0.0; 2 * words];
    for pair in values.windows(2) {
        for (i, count) in moves.iter_mut().enumerate() {
            let shift = 8 * (2 * words - 1 - i);
            *count += f64::from(u8::from(pair[0] >> shift & 0xFF != pair[1] >> shift & 0xFF));
        }
    }
    let steps = values.len().saturating_sub(1).max(1) as f64;
    let mut worst = 0.0f64;
    for i in 0..moves.len() {
        for j in i + 1..moves.len() {
            worst = worst.max((moves[i] - moves[j]) / steps);
        }
    }
    worst
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
    let movement = movement(values, words, true);
    let mut bits = 2.0 + coupling(&movement, &mut reason) + asked_for(asked, &mut reason);
    if words == 4 && (movement.low_step < WILD || movement.next_step < WILD) {
        bits = 0.0;
    } else if words == 4 {
        let halves: Vec<u64> = values.iter().map(|value| value >> 32).collect();
        bits += coupling(&self::movement(&halves, 2, true), &mut String::new());
    }
    let short = short_decimals(values, words);
    if short > 0.0 {
        bits += short;
        reason.push_str("the numbers are short in decimal; ");
    }
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
    if movement.distinct > 16 && numbers.windows(2).all(|pair| pair[0] <= pair[1]) && short == 0.0 {
        bits -= RISING;
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

fn significant(bits: u64, words: usize) -> usize {
    let text = if words == 2 { Value::Single(f32::from_bits(bits as u32)) } else { Value::Double(f64::from_bits(bits)) };
    let text = text.text().unwrap_or_default();
    let mantissa = text.split('e').next().unwrap_or_default().trim_start_matches(['-', '0', '.']);
    mantissa.bytes().filter(u8::is_ascii_digit).count()
}

fn whole(values: &[u64], words: usize, order: Order, asked: f64) -> Option<Claim> {
    let movement = movement(values, words, false);
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
    bits += if words == 4 { halves(values, &movement, signed, &mut reason) } else { coupling(&movement, &mut reason) };
    bits -= 12.0 * (movement.disorder - 0.15).max(0.0);
    if all_negative && !any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("small below zero; ");
    }
    if signed && any_small && bits > 0.0 {
        bits += 2.0;
        reason.push_str("the sign changes where the value passes zero; ");
    }
    if bits < ENOUGH {
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

/// Bits for a whole number of four registers: its halves are judged as numbers of two.
fn halves(values: &[u64], whole: &Movement, signed: bool, reason: &mut String) -> f64 {
    let upper: Vec<u64> = values.iter().map(|value| value >> 32).collect();
    let changes = upper.windows(2).filter(|pair| pair[0] != pair[1]).count();
    if changes * 20 <= upper.len() {
        // A total whose upper half hardly moves; or a shorter one behind constants.
        let lower: Vec<u64> = values.iter().map(|value| value & 0xFFFF_FFFF).collect();
        let bits = coupling(&movement(&lower, 2, false), reason);
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
    let bits = coupling(whole, reason) + coupling(&movement(&upper, 2, false), &mut String::new());
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

    #[test]
    fn neighbours_that_have_nothing_to_do_with_each_other_are_undecided() {
        let pairs: Vec<_> = (0..60u16).map(|i| [200 + i % 7, 1000 + 3 * (i % 11)]).collect();
        assert_eq!(best(&pairs), None);
        assert_eq!(best(&[[1, 34_464]; 40]), None);
    }
}
