//! A converted value. It is exact wherever the number on the wire is.

use std::fmt::{Display, LowerExp};
use std::io::Write;

use crate::profile::decimal_text;
use modlens_protocol::decimal::push_int;

/// A converted value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'p> {
    /// The device reports that it has no value, or the bytes are not valid for the type (BCD with a digit above 9).
    Missing,
    /// `digits * 10^exponent`, exact.
    Decimal(i128, i32),
    /// Single precision as it was on the wire.
    Single(f32),
    /// Double precision, or the result of scaling a floating point number.
    Double(f64),
    /// A number, and its label in the profile.
    Label(i64, &'p str),
    /// A number, and the labels of its bits.
    Flags(u64, &'p [(u8, String)]),
    /// Text.
    Text(String),
}

/// Largest integer up to which every integer has an exact float64.
const EXACT_INTEGER_MAX: i128 = 1 << 53;

impl Value<'_> {
    /// The value as a number, if it is one and a float64 represents it without losing digits.
    pub fn number(&self) -> Option<f64> {
        match *self {
            Self::Missing | Self::Text(_) => None,
            Self::Decimal(digits, exponent) => decimal(digits, exponent),
            Self::Single(value) => Some(f64::from(value)).filter(|value| value.is_finite()),
            Self::Double(value) => Some(value).filter(|value| value.is_finite()),
            Self::Label(number, _) => decimal(i128::from(number), 0),
            Self::Flags(number, _) => decimal(i128::from(number), 0),
        }
    }

    /// The value as exact text; `None` if there is no value.
    pub fn text(&self) -> Option<String> {
        let mut out = Vec::new();
        self.push(&mut out);
        (*self != Self::Missing).then(|| String::from_utf8(out).unwrap_or_default())
    }

    /// Whether its text is a number, and so needs no quoting in CSV.
    pub fn is_number(&self) -> bool {
        matches!(self, Self::Decimal(..) | Self::Single(_) | Self::Double(_))
    }

    /// Appends the text of the value; nothing if there is no value.
    pub fn push(&self, out: &mut Vec<u8>) {
        match self {
            Self::Missing => {}
            Self::Decimal(digits, exponent) => push_decimal(*digits, *exponent, out),
            Self::Single(value) => push_float(f64::from(*value), value, out),
            Self::Double(value) => push_float(*value, value, out),
            Self::Label(_, label) => out.extend_from_slice(label.as_bytes()),
            Self::Flags(number, labels) => out.extend_from_slice(flags_text(*number, labels).as_bytes()),
            Self::Text(text) => out.extend_from_slice(text.as_bytes()),
        }
    }
}

/// Appends a decimal number. Most are integers, which need no intermediate text.
fn push_decimal(digits: i128, exponent: i32, out: &mut Vec<u8>) {
    match i64::try_from(digits) {
        Ok(digits) if exponent == 0 => push_int(digits, out),
        _ => out.extend_from_slice(decimal_text(digits, exponent).as_bytes()),
    }
}

/// Appends the shortest text that reads back as the same number in the same precision, with an exponent where there
/// would be many zeros. `size` is the number as a float64.
pub fn push_float<F: Display + LowerExp>(size: f64, value: &F, out: &mut Vec<u8>) {
    let plain = size == 0.0 || (1e-5..1e16).contains(&size.abs()) || !size.is_finite();
    let written = if plain { write!(out, "{value}") } else { write!(out, "{value:e}") };
    // Writing to a vector cannot fail.
    debug_assert!(written.is_ok(), "a vector takes everything");
}

/// The float64 nearest to `digits * 10^exponent`; `None` if integer digits would be lost.
fn decimal(digits: i128, exponent: i32) -> Option<f64> {
    if digits.abs() <= EXACT_INTEGER_MAX && (-22..=0).contains(&exponent) {
        // Both operands are exact, so the rounded quotient is the nearest float64.
        return Some(digits as f64 / 10f64.powi(-exponent));
    }
    if exponent < 0 {
        return format!("{digits}e{exponent}").parse().ok().filter(|value: &f64| value.abs() <= EXACT_INTEGER_MAX as f64);
    }
    let whole = digits.checked_mul(10i128.checked_pow(exponent.unsigned_abs())?)?;
    Some(whole as f64).filter(|value| *value as i128 == whole)
}

/// The labels of all bits that are set, separated by blanks; a bit without a label is called `bit7`.
fn flags_text(number: u64, labels: &[(u8, String)]) -> String {
    let named = labels.iter().filter(|(bit, _)| number >> bit & 1 == 1).map(|(_, label)| label.clone());
    let labelled_bits = labels.iter().fold(0, |labelled_bits, (bit, _)| labelled_bits | 1 << bit);
    let unlabelled = (0..64).filter(|bit| number & !labelled_bits & 1 << bit != 0).map(|bit| format!("bit{bit}"));
    named.chain(unlabelled).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_exact_or_absent() {
        assert_eq!(Value::Decimal(214, -1).number(), Some(21.4));
        assert_eq!(Value::Decimal(214, -1).text().unwrap(), "21.4");
        assert_eq!(Value::Decimal(i128::from(u64::MAX), 0).number(), None);
        assert_eq!(Value::Decimal(i128::from(u64::MAX), 0).text().unwrap(), "18446744073709551615");
        assert_eq!(Value::Decimal(1 << 53, 0).number(), Some(9_007_199_254_740_992.0));
        assert_eq!(Value::Decimal((1 << 53) + 1, 0).number(), None);
        assert_eq!(Value::Decimal(5, 3).number(), Some(5000.0));
        assert_eq!(Value::Single(21.4).text().unwrap(), "21.4");
        assert_eq!(Value::Single(f32::NAN).number(), None);
        assert_eq!(Value::Double(1e300).text().unwrap(), "1e300");
    }

    #[test]
    fn flags_list_the_bits_that_are_set() {
        let labels = [(0, "run".to_owned()), (3, "fault".to_owned())];
        assert_eq!(Value::Flags(0b1101, &labels).text().unwrap(), "run fault bit2");
        assert_eq!(Value::Flags(0, &labels).text().unwrap(), "");
    }
}
