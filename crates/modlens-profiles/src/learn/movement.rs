//! How numbers made of several registers move from sample to sample. Related registers move together, unrelated ones do
//! not.

use crate::learn::sequence::Sequence;

/// Bounds in bits of the evidence in `Movement::fit`.
const MAX_PENALTY_BITS: f64 = 8.0;
const MAX_EVIDENCE_BITS: f64 = 16.0;

/// Bound in bits of `Movement::stillness`.
const MOST_STILLNESS_BITS: f64 = 24.0;

/// The movement of the values, taken as numbers in one order.
pub(super) struct Movement {
    /// Mean step of the lowest register, with its bytes in the order that makes it smaller.
    pub low_step: f64,
    /// Mean step of the register next to the middle, for numbers of four registers.
    pub next_step: f64,
    /// Mean step of the highest register.
    pub high_step: f64,
    /// The number of steps at which the part above the lowest register moved differently from its median step; and how
    /// many of these were carries out of the lowest register.
    pub high_changes: u32,
    pub carries: u32,
    /// The number of different values.
    pub distinct: usize,
    /// The largest difference between how often a more significant and a less significant byte changes (0 to 1). In a
    /// number the upper bytes change less often.
    pub disorder: f64,
    /// Mean absolute step of the number.
    pub step: f64,
    /// Whether the values only rise.
    pub is_rising: bool,
    /// Evidence in bits against one number: the lower register jumps as far as a number that would have moved its upper
    /// register more often.
    pub stillness: f64,
    /// Evidence in bits that the lower half continues the upper one as its digits.
    pub fit: f64,
}

impl Movement {
    /// Measures the movement of the values of `words` registers.
    pub fn of(sequence: &Sequence<'_, u64>, words: usize, float: bool) -> Self {
        let steps: Vec<(u64, u64)> = sequence.steps().collect();
        let count = steps.len().max(1) as f64;
        let numbers: Vec<(i128, i128)> =
            steps.iter().map(|&(from, to)| (sortable(from, words, float), sortable(to, words, float))).collect();
        let mean_step = |of: &dyn Fn(u64) -> i64| {
            let sum: u64 = steps.iter().map(|&(from, to)| (of(to) - of(from)).unsigned_abs()).sum();
            sum as f64 / count
        };
        let word = |bits: u64, at: usize| (bits >> (16 * at)) as u16;
        let low = |at: usize| {
            mean_step(&|bits| i64::from(word(bits, at))).min(mean_step(&|bits| i64::from(word(bits, at).swap_bytes())))
        };
        // The sign bit of a float does not belong to its magnitude; an integer crosses zero as a signed number.
        let high = |bits: u64| {
            let top = word(bits, words - 1);
            if float {
                i64::from(top & 0x7FFF)
            } else {
                i64::from(top as i16)
            }
        };
        let steps_of_number: Vec<i128> = numbers.iter().map(|(from, to)| to - from).collect();
        // Over the gaps of a long recording, too: carries are rare.
        let gaps: Vec<(i128, i128)> =
            sequence.gaps().map(|(from, to)| (sortable(from, words, float), sortable(to, words, float))).collect();
        let (changes, carries) =
            [&numbers, &gaps].map(|pairs| carries(pairs)).into_iter().fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let mut distinct = sequence.values.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let step = steps_of_number.iter().map(|delta| delta.unsigned_abs() as f64).sum::<f64>() / count;
        Self {
            low_step: low(0),
            next_step: low(words / 2 - 1),
            high_step: mean_step(&high),
            high_changes: changes,
            carries,
            distinct: distinct.len(),
            disorder: disorder(&steps, words),
            step,
            is_rising: sequence.values.windows(2).all(|pair| pair[0] <= pair[1])
                && sequence.values.first() != sequence.values.last(),
            stillness: stillness(&steps),
            fit: fit(&numbers, 8 * words as u32),
        }
    }
}

/// Of pairs of numbers: how often the part above the lowest register moved differently from its median step, and how
/// many of these steps were carries out of the lowest register.
fn carries(pairs: &[(i128, i128)]) -> (u32, u32) {
    let steps: Vec<i128> = pairs.iter().map(|(from, to)| to - from).collect();
    let upper: Vec<i128> = pairs.iter().map(|(from, to)| (to >> 16) - (from >> 16)).collect();
    let (usual, usual_upper) = (median(&steps), median(&upper));
    let unusual = || steps.iter().zip(&upper).filter(|(_, upper)| **upper != usual_upper);
    let carries = unusual().filter(|(step, _)| (**step - usual).abs() < 0x4000).count();
    (unusual().count() as u32, carries as u32)
}

/// Evidence in bits against the lowest register as part of a larger number.
///
/// A number that moves by a share of 65,536 moves its upper part in at least that share of the steps. Its shortest way
/// is at most half of the range. If the upper part changes less often, the two are separate.
fn stillness(steps: &[(u64, u64)]) -> f64 {
    let way = |from: u64, to: u64| f64::from((to as u16).wrapping_sub(from as u16) as i16).abs() / 65_536.0;
    let expected = steps.iter().map(|&(from, to)| way(from, to)).sum::<f64>() / steps.len().max(1) as f64;
    let changed = steps.iter().filter(|(from, to)| from >> 16 != to >> 16).count() as f64;
    let all = steps.len() as f64;
    if expected < 0.01 || changed >= expected * all {
        return 0.0;
    }
    let bits = |count: f64, expected: f64, seen: f64| if count > 0.0 { count * (seen / expected).log2() } else { 0.0 };
    let seen = changed / all;
    (bits(changed, expected, seen) + bits(all - changed, 1.0 - expected, 1.0 - seen)).min(MOST_STILLNESS_BITS)
}

/// Evidence in bits that the steps of a number are smoother than those of its upper half alone.
///
/// They are if the lower half holds its lower digits: cutting these off adds the variance of rounding twice, 1/6. If
/// the lower half belongs to something else, it is noise, and the number as a whole has more variance than its upper
/// half.
fn fit(numbers: &[(i128, i128)], below: u32) -> f64 {
    // Counters wrap at zero, and so do their upper halves.
    let wrapped = |step: i128, width: u32| (step + (1 << (width - 1))).rem_euclid(1 << width) - (1 << (width - 1));
    let variance = |of: &dyn Fn(i128, i128) -> f64| {
        let steps: Vec<f64> = numbers.iter().map(|&(from, to)| of(from, to)).collect();
        let count = steps.len().max(1) as f64;
        let mean = steps.iter().sum::<f64>() / count;
        steps.iter().map(|step| (step - mean) * (step - mean)).sum::<f64>() / count
    };
    let top = variance(&|one, next| wrapped((next >> below) - (one >> below), below) as f64);
    let whole = variance(&|one, next| wrapped(next - one, 2 * below) as f64 / (1u128 << below) as f64);
    if top == 0.0 || whole == 0.0 {
        return 0.0;
    }
    (numbers.len() as f64 / 2.0 * (top / whole).log2()).clamp(-MAX_PENALTY_BITS, MAX_EVIDENCE_BITS)
}

/// The bits as an integer that has the same order as the numbers they represent.
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

/// The largest difference between the change rates of a more significant and a less significant byte.
fn disorder(steps: &[(u64, u64)], words: usize) -> f64 {
    let mut moves = vec![0.0; 2 * words];
    for (from, to) in steps {
        for (i, count) in moves.iter_mut().enumerate() {
            let shift = 8 * (2 * words - 1 - i);
            *count += f64::from(u8::from(from >> shift & 0xFF != to >> shift & 0xFF));
        }
    }
    let steps = steps.len().max(1) as f64;
    let mut worst = 0.0f64;
    for i in 0..moves.len() {
        for j in i + 1..moves.len() {
            worst = worst.max((moves[i] - moves[j]) / steps);
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wild_register_beside_a_still_one_is_no_part_of_its_number() {
        let wild: Vec<u64> = (0..100u64).map(|i| i * 24_593 % 65_536).collect();
        let beside_constant: Vec<u64> = wild.iter().map(|low| 7 << 16 | low).collect();
        let number: Vec<u64> = (0..100u64).map(|i| (7 << 16) + i * 24_593).collect();
        let bits = |values: &[u64]| stillness(&values.windows(2).map(|pair| (pair[0], pair[1])).collect::<Vec<_>>());
        assert!(bits(&beside_constant) > 10.0);
        assert!(bits(&number) < 1.0);
    }
}
