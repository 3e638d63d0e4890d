//! Right checksums by carry-less multiplication (PCLMULQDQ), 16 bytes a step. The only file of the core with `unsafe`.
//!
//! Read the bytes of a frame, lowest bit first, as a polynomial in y: bit i of byte k is the coefficient of y^(8k+i).
//! The CRC register shifts to the right and begins with ones, so the checksum is right if and only if that polynomial,
//! its first 16 coefficients inverted, is a multiple of P = y^16 + y^14 + y + 1, the mirror image of the generator
//! (serial line specification, 6.2.2). Three things make that quick:
//!
//! * Zeros behind a frame change nothing, so the last step needs a mask only.
//! * 128 coefficients in front of others may be multiplied by y^-128 modulo P and added to those behind them: P has a
//!   constant term, so y has an inverse.
//! * 64 coefficients are a multiple of P if and only if, times the inverse of P as a power series, they are a
//!   polynomial of degree below 48.

// Reason: instructions that not every processor has are unsafe to call. `valid` asks the processor, and nothing else
// calls them; memory is read through slices only.
#![allow(unsafe_code)]

use std::arch::x86_64::{__m128i, _mm_clmulepi64_si128, _mm_cvtsi128_si64, _mm_set_epi64x, _mm_srli_si128, _mm_xor_si128};

/// P.
const MODULUS: u64 = 0x1_4003;

/// Bytes of a step.
const STEP: usize = 16;

/// The longest frame that is copied where the bytes end: a byte count cannot announce more.
const LONGEST: usize = 288;

/// 1 / y^n modulo P.
const fn inverse_power(n: usize) -> u64 {
    let (mut value, mut i) = (1, 0);
    while i < n {
        value = if value & 1 == 1 { (value ^ MODULUS) >> 1 } else { value >> 1 };
        i += 1;
    }
    value
}

/// y^n modulo P.
const fn power(n: usize) -> u64 {
    let (mut value, mut i) = (1, 0);
    while i < n {
        value <<= 1;
        if value >> 16 == 1 {
            value ^= MODULUS;
        }
        i += 1;
    }
    value
}

/// The first 64 coefficients of 1 / P.
const fn inverse() -> u64 {
    let (mut value, mut rest, mut i) = (0u64, 1u64, 0);
    while i < 64 {
        if rest >> i & 1 == 1 {
            value |= 1 << i;
            rest ^= MODULUS << i;
        }
        i += 1;
    }
    value
}

/// y^-128 and y^-64: what the first and the last 64 coefficients of a step take to the next.
const FOLD: [u64; 2] = [inverse_power(128), inverse_power(64)];

/// y^64, for what sticks out of 64 coefficients, and 1 / P.
const LAST: [u64; 2] = [power(64), inverse()];

/// Whether the checksum at the end of the first `length` bytes is right; `None` if this processor cannot tell so.
///
/// There are at least 4 of them.
#[inline]
pub fn valid(bytes: &[u8], length: usize) -> Option<bool> {
    if !is_x86_feature_detected!("pclmulqdq") {
        return None;
    }
    if bytes.len() >= length.next_multiple_of(STEP) {
        // SAFETY: the processor has the instruction.
        return Some(unsafe { multiple(bytes, length) });
    }
    let mut padded = [0; LONGEST];
    padded.get_mut(..length)?.copy_from_slice(&bytes[..length]);
    // SAFETY: the processor has the instruction.
    Some(unsafe { multiple(&padded, length) })
}

#[target_feature(enable = "pclmulqdq")]
fn both(values: [u64; 2]) -> __m128i {
    _mm_set_epi64x(values[1] as i64, values[0] as i64)
}

/// Whether the first `length` bytes are a multiple of P; bytes up to the end of the last step may be read.
#[target_feature(enable = "pclmulqdq")]
fn multiple(bytes: &[u8], length: usize) -> bool {
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight of them"));
    let last = both(LAST);
    let divides = |value: __m128i| {
        let quotient = _mm_clmulepi64_si128::<0x10>(value, last);
        _mm_cvtsi128_si64(quotient) as u64 >> 48 == 0
    };
    // Requests are short: one multiplication.
    if length <= 8 {
        let mask = u64::MAX >> (64 - 8 * length);
        return divides(both([(word(0) ^ 0xFFFF) & mask, 0]));
    }
    let fold = both(FOLD);
    let ends = (length - 1) / STEP * STEP;
    let keep = u128::MAX >> (128 - 8 * (length - ends));
    let masked = |at: usize| {
        let value = (u128::from(word(at + 8)) << 64 | u128::from(word(at))) & keep;
        both([value as u64, (value >> 64) as u64])
    };
    let start = both([0xFFFF, 0]);
    let mut sum = if ends == 0 { masked(0) } else { both([word(0), word(8)]) };
    sum = _mm_xor_si128(sum, start);
    let mut at = STEP;
    while at <= ends {
        let next = if at == ends { masked(at) } else { both([word(at), word(at + 8)]) };
        let carried = _mm_xor_si128(_mm_clmulepi64_si128::<0x00>(sum, fold), _mm_clmulepi64_si128::<0x11>(sum, fold));
        sum = _mm_xor_si128(carried, next);
        at += STEP;
    }
    // 128 coefficients become 80, and those 64.
    let sum = _mm_xor_si128(_mm_clmulepi64_si128::<0x10>(sum, fold), _mm_srli_si128::<8>(sum));
    divides(_mm_xor_si128(_mm_clmulepi64_si128::<0x01>(sum, last), sum))
}
