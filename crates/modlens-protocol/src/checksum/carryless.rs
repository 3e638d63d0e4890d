//! Checks CRCs by carry-less multiplication (PCLMULQDQ), 16 bytes per step. The only file of the core with `unsafe`.
//!
//! The bytes of a frame are read, lowest bit first, as a polynomial in y: bit i of byte k is the coefficient of y^(8k+i).
//! The CRC register shifts to the right and its initial value is all ones. So the CRC is valid if and only if the
//! polynomial, with its first 16 coefficients inverted, is a multiple of P = y^16 + y^14 + y + 1, the mirror image of the
//! generator (serial line specification, 6.2.2). Three properties make this test fast:
//!
//! * Zeros after a frame change nothing, so the last step only needs a mask.
//! * The first 128 coefficients may be multiplied by y^-128 modulo P and added to the next 128: y has an inverse, because
//!   P has a constant term.
//! * 64 coefficients are a multiple of P if and only if their product with the inverse of P as a power series is a
//!   polynomial of degree below 48.

// Reason: it is unsafe to call instructions that not every processor has. Only `valid` calls them, after it has asked the
// processor; memory is read through slices only.
#![allow(unsafe_code)]

use std::arch::x86_64::{__m128i, _mm_clmulepi64_si128, _mm_cvtsi128_si64, _mm_set_epi64x, _mm_srli_si128, _mm_xor_si128};

/// The polynomial P.
const MODULUS: u64 = 0x1_4003;

/// Bytes per step.
const STEP_BYTES: usize = 16;

/// The longest frame that is copied to be padded where no further bytes follow it. No byte count can announce a longer one.
const MAX_PADDED_BYTES: usize = 288;

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

/// y^-128 and y^-64, the factors that carry the first and the last 64 coefficients of a step over to the next one.
const FOLD: [u64; 2] = [inverse_power(128), inverse_power(64)];

/// y^64, which folds coefficients beyond the first 64, and 1 / P.
const LAST: [u64; 2] = [power(64), inverse()];

/// Whether the first `length` bytes, at least 4, end with their CRC; `None` if this processor lacks the instruction or the
/// frame is too long to be padded.
#[inline]
pub fn valid(bytes: &[u8], length: usize) -> Option<bool> {
    if !is_x86_feature_detected!("pclmulqdq") {
        return None;
    }
    if bytes.len() >= length.next_multiple_of(STEP_BYTES) {
        // SAFETY: the processor has the instruction, as tested above.
        return Some(unsafe { is_multiple_of_p(bytes, length) });
    }
    let mut padded = [0; MAX_PADDED_BYTES];
    padded.get_mut(..length)?.copy_from_slice(&bytes[..length]);
    // SAFETY: the processor has the instruction.
    Some(unsafe { is_multiple_of_p(&padded, length) })
}

/// Packs two words into a register, the first one in its lower half.
#[target_feature(enable = "pclmulqdq")]
fn pack(values: [u64; 2]) -> __m128i {
    _mm_set_epi64x(values[1] as i64, values[0] as i64)
}

/// The 16 bytes of a step.
#[target_feature(enable = "pclmulqdq")]
fn step(bytes: &[u8]) -> __m128i {
    let value = u128::from_le_bytes(bytes.try_into().expect("sixteen of them"));
    pack([value as u64, (value >> 64) as u64])
}

/// Whether the first `length` bytes, as a polynomial, are a multiple of P. `bytes` must reach to the end of the last step.
#[target_feature(enable = "pclmulqdq")]
fn is_multiple_of_p(bytes: &[u8], length: usize) -> bool {
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight of them"));
    let last = pack(LAST);
    let divides = |value: __m128i| {
        let quotient = _mm_clmulepi64_si128::<0x10>(value, last);
        _mm_cvtsi128_si64(quotient) as u64 >> 48 == 0
    };
    // Most requests have eight bytes, for which one multiplication is enough.
    if length <= 8 {
        let mask = u64::MAX >> (64 - 8 * length);
        return divides(pack([(word(0) ^ 0xFFFF) & mask, 0]));
    }
    let fold = pack(FOLD);
    let ends = (length - 1) / STEP_BYTES * STEP_BYTES;
    let keep = u128::MAX >> (128 - 8 * (length - ends));
    let masked = |at: usize| {
        let value = u128::from_le_bytes(bytes[at..at + STEP_BYTES].try_into().expect("sixteen of them")) & keep;
        pack([value as u64, (value >> 64) as u64])
    };
    let carried = |sum: __m128i| _mm_xor_si128(_mm_clmulepi64_si128::<0x00>(sum, fold), _mm_clmulepi64_si128::<0x11>(sum, fold));
    let mut sum = pack([0xFFFF, 0]);
    if ends == 0 {
        sum = _mm_xor_si128(sum, masked(0));
    } else {
        let (first, others) = bytes[..ends].split_at(STEP_BYTES);
        sum = _mm_xor_si128(sum, step(first));
        for next in others.chunks_exact(STEP_BYTES) {
            sum = _mm_xor_si128(carried(sum), step(next));
        }
        sum = _mm_xor_si128(carried(sum), masked(ends));
    }
    // Reduce 128 coefficients to 80, and these to 64.
    let sum = _mm_xor_si128(_mm_clmulepi64_si128::<0x10>(sum, fold), _mm_srli_si128::<8>(sum));
    divides(_mm_xor_si128(_mm_clmulepi64_si128::<0x01>(sum, last), sum))
}
