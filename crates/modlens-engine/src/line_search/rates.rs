//! What bytes tell of the rate of a line that was read at another one.
//!
//! A receiver starts a character at a falling edge, so the zeros at the low end of a byte tell how long the line was low,
//! in bits of the receiver's rate. That length is a multiple of the line's bit time. At a rate nine times too high every
//! byte is 00. So one or two steps lead to the right rate.

/// The rates that are tried, and how usual each is.
pub const RATES: [(u32, f64); 18] = [
    (9600, 0.28),
    (19_200, 0.25),
    (115_200, 0.12),
    (38_400, 0.09),
    (57_600, 0.07),
    (4800, 0.04),
    (2400, 0.03),
    (1200, 0.03),
    (14_400, 0.01),
    (28_800, 0.01),
    (76_800, 0.01),
    (128_000, 0.005),
    (187_500, 0.005),
    (230_400, 0.02),
    (250_000, 0.01),
    (460_800, 0.01),
    (500_000, 0.005),
    (921_600, 0.01),
];

/// Longest low pulse that can be distinguished: a start bit and eight data bits of zero.
const MAX_PULSE_BITS: usize = 9;
/// The share of pulses that are anything, and the ratio of bit times below which nothing can be reported.
const OUTLIER_SHARE: f64 = 0.1;
const MIN_RATIO: f64 = 0.9;
/// The share of characters that are nine bits low.
const ZERO_SHARE: f64 = 0.25;
/// A rate that is less likely than the best one by this is not named.
const MIN_LOG_ODDS: f64 = -3.0;

/// The number of characters that begin with a low pulse of 0, 1, 2 ... bits; the last of `MAX_PULSE_BITS` and any longer.
pub type PulseLengths = [u32; MAX_PULSE_BITS + 1];

/// Counts the low pulses at the starts of characters.
pub fn pulse_lengths(bytes: &[u8]) -> PulseLengths {
    let mut counts = [0; MAX_PULSE_BITS + 1];
    for byte in bytes {
        // The start bit is low as well.
        counts[byte.trailing_zeros() as usize + 1] += 1;
    }
    counts
}

/// The log-likelihood of pulse lengths if a bit of the line takes `ratio` receiver bits.
pub fn log_likelihood(counts: &PulseLengths, ratio: f64) -> f64 {
    let longest = MAX_PULSE_BITS as f64;
    if ratio < MIN_RATIO {
        return f64::from(counts.iter().sum::<u32>()) * (1.0 / longest).ln();
    }
    let mut chances = [OUTLIER_SHARE / longest; MAX_PULSE_BITS + 1];
    for bits in 1..=MAX_PULSE_BITS {
        let share = if bits < MAX_PULSE_BITS { (1.0 - ZERO_SHARE) / f64::from(1u32 << bits) } else { ZERO_SHARE };
        let seen = (bits as f64 * ratio + 0.5).floor().min(longest);
        chances[seen as usize] += (1.0 - OUTLIER_SHARE) * share;
    }
    counts.iter().zip(chances).map(|(count, chance)| f64::from(*count) * chance.ln()).sum()
}

/// The rates that bytes received at another one look like, the most likely first.
///
/// ```
/// use modlens_engine::line_search::likely_rates;
/// // 9600 baud read at 115200: each bit of the line is twelve of the receiver, so that every character is low throughout.
/// assert!(!likely_rates(&[0; 64], 115_200).contains(&115_200));
/// ```
pub fn likely_rates(bytes: &[u8], receiver: u32) -> Vec<u32> {
    let counts = pulse_lengths(bytes);
    let of = |&(rate, usual): &(u32, f64)| (rate, usual.ln() + log_likelihood(&counts, f64::from(receiver) / f64::from(rate)));
    let mut found: Vec<(u32, f64)> = RATES.iter().map(of).collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    let best = found[0].1;
    found.into_iter().take_while(|one| one.1 - best > MIN_LOG_ODDS).map(|one| one.0).collect()
}

/// How many times as long as those of the receiver the bits of a slower line are that are looked for in a recording.
const SLOWER: [f64; 4] = [1.5, 2.0, 3.0, 4.0];
/// Fewer characters say nothing of a recording; the logarithm of the odds from which on they do.
const LEAST_CHARACTERS: usize = 50;
const SURE_LOG_ODDS: f64 = 10.0;

/// Whether recorded bytes look like those of a line that is slower than the receiver: hardly any pulse is one bit long. Characters
/// that are low throughout are left out: they may have other reasons.
///
/// ```
/// use modlens_engine::line_search::is_slower;
/// assert!(is_slower(&[0xFE, 0xF8, 0xE6, 0x80, 0x1E, 0x66].repeat(10)));
/// assert!(!is_slower(&[0x55, 0xFF, 0x01, 0x03, 0x07, 0x0C].repeat(10)));
/// ```
pub fn is_slower(bytes: &[u8]) -> bool {
    let bytes: Vec<u8> = bytes.iter().copied().filter(|byte| *byte != 0).collect();
    let counts = pulse_lengths(&bytes);
    let own = log_likelihood(&counts, 1.0);
    bytes.len() >= LEAST_CHARACTERS && SLOWER.iter().any(|ratio| log_likelihood(&counts, *ratio) - own > SURE_LOG_ODDS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_are_counted_by_their_length() {
        assert_eq!(pulse_lengths(&[0xFF, 0xFE, 0xFE, 0x80, 0x00]), [0, 1, 2, 0, 0, 0, 0, 0, 1, 1]);
    }

    #[test]
    fn a_rate_half_as_high_shows_pulses_twice_as_long() {
        // Pulses of 1, 2, 3 and 4 bits of the line are of 2, 4, 6 and 8 bits of a receiver at twice the rate.
        let bytes = [0xFE, 0xF8, 0xFE, 0xE0, 0xFE, 0x80, 0xFE, 0xF8, 0xFE, 0xFE, 0xF8, 0xFE];
        let found = likely_rates(&bytes, 19_200);
        assert_eq!(found[0], 9600, "{found:?}");
    }
}
