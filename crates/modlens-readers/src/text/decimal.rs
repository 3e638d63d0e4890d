//! Decimal numbers in front of lines.

use crate::text::date::number;
use modlens_protocol::Ns;

/// The nanoseconds of a second.
pub(super) const SECOND_NS: Ns = 1_000_000_000;

/// The decimal digits that the text begins with, at most `most` of them, as a number, and how many there are.
#[inline]
pub(super) fn digits(text: &[u8], most: usize) -> (i64, usize) {
    let (mut value, mut length) = (0, 0);
    for &b in text.iter().take(most) {
        let digit = b.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        value = value * 10 + i64::from(digit);
        length += 1;
    }
    (value, length)
}

/// Converts decimal seconds to ns exactly; returns also the number of decimals, at most 9.
pub(super) fn decimal(text: &[u8]) -> Option<(Ns, u32)> {
    let (sign, text) = text.strip_prefix(b"-").map_or((1, text), |rest| (-1, rest));
    let point = text.iter().position(|&b| b == b'.').unwrap_or(text.len());
    let fraction = text.get(point + 1..).unwrap_or(&[]);
    let whole = Some(&text[..point]).filter(|whole| !whole.is_empty() && whole.len() <= 10)?;
    let kept = &fraction[..fraction.len().min(9)];
    if !fraction[kept.len()..].iter().all(u8::is_ascii_digit) {
        return None;
    }
    let fraction_ns = if kept.is_empty() { 0 } else { number(kept)? * 10i64.pow(9 - kept.len() as u32) };
    Some((sign * number(whole)?.checked_mul(SECOND_NS)?.checked_add(fraction_ns)?, kept.len() as u32))
}
