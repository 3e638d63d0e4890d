//! Counts that are floating-point numbers, because they are halved at times, and ones that are added to them.

/// Explicit bits of a count's mantissa: its exponent stands above them.
const MANTISSA_BITS: u32 = f32::MANTISSA_DIGITS - 1;

/// From here on, a count stays as it is: what is added is rounded away.
const GREATEST_COUNT: f32 = (1 << f32::MANTISSA_DIGITS) as f32;

/// Adds 1 so many times, to the bit as one by one. Between two powers of two nothing is rounded, so that all ones may be added at
/// once.
#[inline]
pub(crate) fn add_ones(count: &mut f32, ones: u32) {
    let sum = *count + ones as f32;
    if sum.to_bits() >> MANTISSA_BITS == count.to_bits() >> MANTISSA_BITS && sum < GREATEST_COUNT {
        *count = sum;
    } else {
        add_ones_beyond(count, ones);
    }
}

/// The same beyond the next power of two.
#[cold]
fn add_ones_beyond(count: &mut f32, mut ones: u32) {
    while ones > 0 && *count < GREATEST_COUNT {
        let next_power = f32::from_bits(((count.to_bits() >> MANTISSA_BITS) + 1) << MANTISSA_BITS);
        let step = ((next_power - *count) as u32).clamp(1, ones);
        *count += step as f32;
        ones -= step;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ones_are_added_as_one_by_one(whole in 0u32..40_000, halved in 0i32..24, ones in 0u32..5000) {
            let mut at_once = whole as f32 * (-halved as f32).exp2();
            let mut one_by_one = at_once;
            add_ones(&mut at_once, ones);
            (0..ones).for_each(|_| one_by_one += 1.0);
            prop_assert_eq!(at_once.to_bits(), one_by_one.to_bits());
        }
    }
}
