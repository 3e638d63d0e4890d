//! Ranks the types and orders that two or four registers may have, by the values that they had over time.
//!
//! Evidence, in bits: a lower register that jumps over its whole range while the upper one hardly moves; carries, where
//! the upper register steps as the lower one wraps; and numbers that are short in decimal, as people and sensors make
//! them. Where an upper register never moves, the order that the device
//! uses elsewhere decides. Without any such evidence the registers are reported as separate 16-bit values.

use crate::learn::evidence::{TypeHypothesis, MIN_HYPOTHESIS_BITS, MIN_MARGIN_BITS, PLAUSIBLE_MAGNITUDES};
use crate::learn::float_hypothesis::float_hypothesis;
use crate::learn::habits::Habits;
use crate::learn::integer_hypothesis::integer_hypothesis;
use crate::learn::sequence::Sequence;
use crate::points::Conversion;
use crate::profile::{Order, Type};

/// The further evidence that a rare hypothesis needs where nothing is known of the device, in bits.
const RARE_BITS: f64 = 1.0;

/// Ranks the hypotheses for two or four consecutive registers, best first. `rows` has one sample per row,
/// `follows` says which of them directly follow the row before; `habits` are what the device does elsewhere.
///
/// Hypotheses of one kind (floats or integers) are compared by how smoothly the number moves: each doubling of the mean
/// step costs a bit.
pub fn rank_types(rows: &[&[u16]], follows: &[bool], habits: &Habits) -> Vec<TypeHypothesis> {
    let words = rows.first().map_or(0, |row| row.len());
    if !matches!(words, 2 | 4) || rows.iter().all(|row| row.iter().all(|&word| word == 0)) {
        return Vec::new();
    }
    let mut hypotheses: Vec<TypeHypothesis> = Vec::new();
    for (order, _) in Order::ALL {
        let values = bits_of(rows, words, order);
        let sequence = Sequence { values: &values, follows };
        hypotheses.extend(float_hypothesis(&sequence, words, order, habits));
        hypotheses.extend(integer_hypothesis(&sequence, words, order, habits));
    }
    for is_float in [false, true] {
        let is_of_kind = |hypothesis: &TypeHypothesis| matches!(hypothesis.kind, Type::F32 | Type::F64) == is_float;
        let least_step = hypotheses
            .iter()
            .filter(|hypothesis| is_of_kind(hypothesis))
            .map(|hypothesis| hypothesis.mean_step)
            .fold(f64::MAX, f64::min)
            .max(1.0);
        for hypothesis in hypotheses.iter_mut().filter(|hypothesis| is_of_kind(hypothesis)) {
            hypothesis.bits -= (hypothesis.mean_step.max(1.0) / least_step).log2().min(10.0);
        }
    }
    for hypothesis in &mut hypotheses {
        hypothesis.bits += habits.order_bits(hypothesis.order);
    }
    hypotheses.retain(|hypothesis| hypothesis.bits > 0.0);
    hypotheses.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    let margin = match &hypotheses[..] {
        [] => return hypotheses,
        [only] => only.bits,
        [best, next, ..] => best.bits - next.bits,
    };
    let least = MIN_HYPOTHESIS_BITS + if is_rare(&hypotheses[0], words) && !habits.are_known() { RARE_BITS } else { 0.0 };
    hypotheses[0].is_certain = hypotheses[0].bits >= least && margin >= MIN_MARGIN_BITS;
    hypotheses
}

/// Whether a hypothesis is one of many that few devices have: swapped bytes, or integers of four registers.
fn is_rare(hypothesis: &TypeHypothesis, words: usize) -> bool {
    let is_swapped = matches!(hypothesis.order, Order::Badc | Order::Dcba);
    is_swapped || (words == 4 && !matches!(hypothesis.kind, Type::F64))
}

/// Whether the bytes of two or four registers are a plausible float in this order. If one sample is not, `rank_types` does
/// not consider a float.
pub fn is_plausible_float(registers: &[u8], order: Order) -> bool {
    let kind = if registers.len() == 4 { Type::F32 } else { Type::F64 };
    let number = Conversion::of_type(kind, order).value(registers, None).number();
    number.is_some_and(|number| number == 0.0 || PLAUSIBLE_MAGNITUDES.contains(&number.abs()))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The best hypothesis, if it is certain.
    fn best(rows: &[[u16; 2]]) -> Option<(Type, Order)> {
        let rows: Vec<&[u16]> = rows.iter().map(|row| &row[..]).collect();
        let hypotheses = rank_types(&rows, &vec![true; rows.len()], &Habits::default());
        hypotheses.first().filter(|hypothesis| hypothesis.is_certain).map(|hypothesis| (hypothesis.kind, hypothesis.order))
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

    fn best_with_device_order(rows: &[[u16; 2]], device_order: Option<Order>) -> Option<(Type, Order)> {
        let rows: Vec<&[u16]> = rows.iter().map(|row| &row[..]).collect();
        let habits = device_order.map_or_else(Habits::default, |order| Habits::with_votes(order, 5.0));
        rank_types(&rows, &vec![true; rows.len()], &habits)
            .first()
            .filter(|hypothesis| hypothesis.is_certain)
            .map(|hypothesis| (hypothesis.kind, hypothesis.order))
    }

    #[test]
    fn a_constant_upper_register_needs_the_order_of_the_device_or_a_long_rise() {
        let total: Vec<_> = (0..60u32).map(|i| words(0x0007_1234 + 3 * i, Order::Cdab)).collect();
        let debt: Vec<_> = (0..60u32).map(|i| words((-3_000_000i32 - 7 * (i % 13) as i32) as u32, Order::Cdab)).collect();
        for (rows, kind) in [(total, Type::U32), (debt, Type::S32)] {
            assert_eq!(best_with_device_order(&rows, Some(Order::Cdab)), Some((kind, Order::Cdab)));
            assert_eq!(best_with_device_order(&rows, Some(Order::Abcd)), None);
            let is_rising = kind == Type::U32;
            assert_eq!(best_with_device_order(&rows, None), is_rising.then_some((kind, Order::Cdab)));
            assert_eq!(best_with_device_order(&rows[..20], None), None);
        }
        // A small counter of its own beside a constant.
        let small: Vec<_> = (0..60u16).map(|i| [7, 700 + 3 * i]).collect();
        assert_eq!(best_with_device_order(&small, None), None);
        // 65535 and 0 often stand beside counters to which they do not belong.
        for idle in [0, 0xFFFF] {
            let rows: Vec<_> = (0..60u16).map(|i| [idle, 700 + 3 * i]).collect();
            assert_eq!(best_with_device_order(&rows, Some(Order::Abcd)), None);
        }
    }

    #[test]
    fn a_round_constant_alone_is_no_float() {
        // 12.25 and 100.0 as floats (IEEE 754); without the order of the device and other floats they are two numbers.
        assert_eq!(best(&[[0x4144, 0]; 40]), None);
        assert_eq!(best(&[[0, 0x42C8]; 40]), None);
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
