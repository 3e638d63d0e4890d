//! The logarithm that evidence is counted in.

use std::f32::consts::LN_2;

/// The logarithm to base 2 of a positive, normal number, with an error below 2e-5.
///
/// The standard library's depends on the machine's mathematics library and costs several times as much.
///
/// With t = (m - 1) / (m + 1), ln m is 2 (t + t^3/3 + t^5/5 + ...), and for the mantissa m in 1..2 t is at most 1/3.
#[inline]
pub fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits(bits & 0x007F_FFFF | 0x3F80_0000);
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    exponent as f32 + t * (2.0 / LN_2) * (1.0 + square * (1.0 / 3.0 + square * (0.2 + square / 7.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_standard_library() {
        let values = (-60..60).flat_map(|exponent| (0..100).map(move |i| (1.0 + i as f32 / 100.0) * f32::exp2(exponent as f32)));
        for x in values {
            assert!((log2(x) - x.log2()).abs() < 3e-5, "{x}");
        }
    }
}
