//! How numbers made of several registers move from sample to sample. Related registers move together, unrelated ones do
//! not.

/// Bounds in bits of the evidence in `Movement::fit`.
const MAX_PENALTY_BITS: f64 = 8.0;
const MAX_EVIDENCE_BITS: f64 = 16.0;

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
    /// Evidence in bits that the lower half continues the upper one as its digits.
    pub fit: f64,
}

impl Movement {
    /// Measures the movement of the values of `words` registers.
    pub fn of(values: &[u64], words: usize, float: bool) -> Self {
        let numbers: Vec<i128> = values.iter().map(|&bits| sortable(bits, words, float)).collect();
        let steps = |of: &dyn Fn(u64) -> i64| {
            let sum: u64 = values.windows(2).map(|pair| (of(pair[1]) - of(pair[0])).unsigned_abs()).sum();
            sum as f64 / values.len().saturating_sub(1).max(1) as f64
        };
        let word = |bits: u64, at: usize| (bits >> (16 * at)) as u16;
        let low = |at: usize| steps(&|bits| i64::from(word(bits, at))).min(steps(&|bits| i64::from(word(bits, at).swap_bytes())));
        // The sign bit of a float does not belong to its magnitude; an integer crosses zero as a signed number.
        let high = |bits: u64| {
            let top = word(bits, words - 1);
            if float {
                i64::from(top & 0x7FFF)
            } else {
                i64::from(top as i16)
            }
        };
        let steps_of_number: Vec<i128> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let upper_steps: Vec<i128> = numbers.windows(2).map(|pair| (pair[1] >> 16) - (pair[0] >> 16)).collect();
        let (usual, usual_upper) = (median(&steps_of_number), median(&upper_steps));
        let unusual_steps = || steps_of_number.iter().zip(&upper_steps).filter(|(_, upper)| **upper != usual_upper);
        let carries = unusual_steps().filter(|(delta, _)| (**delta - usual).abs() < 0x4000).count();
        let mut distinct = values.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let step =
            steps_of_number.iter().map(|delta| delta.unsigned_abs() as f64).sum::<f64>() / steps_of_number.len().max(1) as f64;
        Self {
            low_step: low(0),
            next_step: low(words / 2 - 1),
            high_step: steps(&high),
            high_changes: unusual_steps().count() as u32,
            carries: carries as u32,
            distinct: distinct.len(),
            disorder: disorder(values, words),
            step,
            fit: fit(&numbers, 8 * words as u32),
        }
    }
}

/// Evidence in bits that the steps of a number are smoother than those of its upper half alone.
///
/// They are if the lower half holds its lower digits: cutting these off adds the variance of rounding twice, 1/6. If
/// the lower half belongs to something else, it is noise, and the number as a whole has more variance than its upper
/// half.
fn fit(numbers: &[i128], below: u32) -> f64 {
    // Counters wrap at zero, and so do their upper halves.
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
