//! Converts bytes on the wire to a value. The conversion is chosen once, when the plan is compiled: a function that
//! loads the bits in the given order, and the interpretation of those bits.

use crate::points::value::Value;
use crate::profile::{Decimal, Order, Point, Sentinel, Type};

/// How the registers of a point are converted.
#[derive(Clone, Debug)]
pub struct Conversion {
    /// Loads the registers as one integer, most significant byte first.
    load: fn(&[u8]) -> u64,
    /// The significant bits: shift to the right by `shift`, then keep `width` bits.
    shift: u32,
    width: u32,
    interpretation: Interpretation,
    /// value = raw * scale + offset.
    linear: Option<(Decimal, Decimal)>,
    /// Raw values that mean "no value".
    nan: Vec<Sentinel>,
}

/// How the bits are interpreted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interpretation {
    Unsigned,
    Signed,
    Half,
    Single,
    Double,
    Digits,
    Text { order: Order, text_bytes: TextBytes },
    Hex,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TextBytes {
    Both,
    High,
    Low,
}

impl Conversion {
    /// Chooses the conversion of a point.
    pub fn new(point: &Point) -> Self {
        let mut chosen = Self::of_type(point.kind, point.order);
        if let Some((first, last)) = point.bits {
            (chosen.shift, chosen.width) = (u32::from(first), u32::from(last - first) + 1);
        }
        if point.scale.is_some() || point.offset.is_some() {
            chosen.linear = Some((point.scale.unwrap_or(Decimal::ONE), point.offset.unwrap_or(Decimal::ZERO)));
        }
        chosen.nan.clone_from(&point.nan);
        chosen
    }

    /// Chooses the conversion of a type without scale and labels.
    pub fn of_type(kind: Type, order: Order) -> Self {
        let text = |text_bytes| Interpretation::Text { order, text_bytes };
        let interpretation = match kind {
            Type::F16 => Interpretation::Half,
            Type::F32 => Interpretation::Single,
            Type::F64 => Interpretation::Double,
            Type::Bcd16 | Type::Bcd32 => Interpretation::Digits,
            Type::Str => text(TextBytes::Both),
            Type::Strh => text(TextBytes::High),
            Type::Strl => text(TextBytes::Low),
            Type::Raw => Interpretation::Hex,
            kind if kind.is_signed() => Interpretation::Signed,
            _ => Interpretation::Unsigned,
        };
        let shift = if matches!(kind, Type::U8h | Type::S8h) { 8 } else { 0 };
        let width = if kind == Type::Bool { 1 } else { kind.bits() };
        Self { load: loader(kind.registers(), order), shift, width, interpretation, linear: None, nan: Vec::new() }
    }

    /// The significant bits (shift, width) and their interpretation.
    pub(super) fn part(&self) -> (u32, u32, Interpretation) {
        (self.shift, self.width, self.interpretation)
    }

    /// The value of a coil or discrete input.
    pub fn bit(bit: i32) -> Value<'static> {
        Value::Decimal(i128::from(bit), 0)
    }

    /// The value of these registers. `factor` is the exponent of the point's scale factor, if it has one.
    #[inline]
    pub fn value(&self, bytes: &[u8], factor: Option<i32>) -> Value<'static> {
        match self.interpretation {
            Interpretation::Unsigned | Interpretation::Signed | Interpretation::Digits => self.whole(bytes, factor),
            Interpretation::Half => self.float(half((self.load)(bytes) as u16), bytes, factor),
            Interpretation::Single => self.float(f32::from_bits((self.load)(bytes) as u32), bytes, factor),
            Interpretation::Double => self.double(f64::from_bits((self.load)(bytes)), bytes, factor),
            Interpretation::Text { order, text_bytes } => Value::Text(text(bytes, order, text_bytes)),
            Interpretation::Hex => Value::Text(modlens_protocol::hex::hex(bytes)),
        }
    }

    /// The significant bits, not interpreted yet.
    #[inline]
    pub fn bits(&self, bytes: &[u8]) -> u64 {
        let raw = (self.load)(bytes) >> self.shift;
        if self.width >= 64 {
            raw
        } else {
            raw & ((1 << self.width) - 1)
        }
    }

    /// The integer on the wire, before scaling. `None` if the bits are no number (BCD) or mean "no value".
    #[inline]
    pub fn raw(&self, bytes: &[u8]) -> Option<i128> {
        let bits = self.bits(bytes);
        let number = match self.interpretation {
            Interpretation::Signed => i128::from(((bits << (64 - self.width)) as i64) >> (64 - self.width)),
            Interpretation::Digits => digits(bits)?,
            _ => i128::from(bits),
        };
        let missing = |nan: &Sentinel| matches!(nan, Sentinel::Whole(nan) if *nan == number || *nan == i128::from(bits));
        (!self.nan.iter().any(missing)).then_some(number)
    }

    /// Converts an integer, with its scale, offset and scale factor.
    #[inline]
    fn whole(&self, bytes: &[u8], factor: Option<i32>) -> Value<'static> {
        let Some(number) = self.raw(bytes) else { return Value::Missing };
        let Some((scale, offset)) = self.linear else { return Value::Decimal(number, factor.unwrap_or(0)) };
        linear(number, scale, offset, factor.unwrap_or(0))
    }

    /// Converts a single precision number. It stays single if it is not scaled, so that its text stays short.
    fn float(&self, number: f32, bytes: &[u8], factor: Option<i32>) -> Value<'static> {
        if self.linear.is_none() && factor.is_none() && self.nan.is_empty() {
            return Value::Single(number);
        }
        match self.double(f64::from(number), bytes, factor) {
            Value::Double(_) if self.linear.is_none() && factor.is_none() => Value::Single(number),
            other => other,
        }
    }

    /// Converts a double precision number, or one that has to be scaled.
    fn double(&self, number: f64, bytes: &[u8], factor: Option<i32>) -> Value<'static> {
        let missing = |nan: &Sentinel| match nan {
            Sentinel::Whole(nan) => *nan == i128::from(self.bits(bytes)) || (*nan as f64).total_cmp(&number).is_eq(),
            Sentinel::Float(nan) => nan.total_cmp(&number).is_eq(),
        };
        if self.nan.iter().any(missing) {
            return Value::Missing;
        }
        // Scaling is skipped rather than neutral: -0 * 1 + 0 would be +0.
        let scaled = self.linear.map_or(number, |(scale, offset)| number * scale.to_f64() + offset.to_f64());
        Value::Double(factor.map_or(scaled, |power| scaled * 10f64.powi(power)))
    }
}

/// Computes (raw * scale + offset) * 10^factor exactly, or as a floating point number if the exact result overflows.
fn linear(number: i128, scale: Decimal, offset: Decimal, factor: i32) -> Value<'static> {
    let exponent = if offset.digits == 0 { scale.exponent } else { scale.exponent.min(offset.exponent) };
    let with_common_exponent =
        |number: i128, from: i32| number.checked_mul(10i128.checked_pow((from - exponent).unsigned_abs())?);
    let exact = || {
        let product = with_common_exponent(number.checked_mul(i128::from(scale.digits))?, scale.exponent)?;
        let scaled_offset =
            if offset.digits == 0 { 0 } else { with_common_exponent(i128::from(offset.digits), offset.exponent)? };
        product.checked_add(scaled_offset)
    };
    exact().map_or_else(
        || Value::Double((number as f64 * scale.to_f64() + offset.to_f64()) * 10f64.powi(factor)),
        |digits| Value::Decimal(digits, exponent + factor),
    )
}

/// Binary coded decimal: the number whose decimal digits are the half bytes; `None` if one of them is above 9.
fn digits(bits: u64) -> Option<i128> {
    let nibbles = (0..16).rev().map(|i| (bits >> (4 * i) & 0xF) as i128);
    nibbles.into_iter().try_fold(0, |number, digit| (digit < 10).then_some(number * 10 + digit))
}

/// Half precision (IEEE 754 binary16), which Rust has no stable type for.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1F), f32::from(bits & 0x3FF));
    match exponent {
        0 => sign * fraction * 2f32.powi(-24),
        0x1F if fraction == 0.0 => sign * f32::INFINITY,
        0x1F => f32::NAN,
        _ => sign * (1.0 + fraction / 1024.0) * 2f32.powi(exponent - 15),
    }
}

/// The function that loads one, two or four registers in this order.
fn loader(registers: u16, order: Order) -> fn(&[u8]) -> u64 {
    match (registers, order) {
        (2, Order::Abcd) => |b| u64::from(u32::from_be_bytes([b[0], b[1], b[2], b[3]])),
        (2, Order::Cdab) => |b| u64::from(u32::from_be_bytes([b[2], b[3], b[0], b[1]])),
        (2, Order::Badc) => |b| u64::from(u32::from_be_bytes([b[1], b[0], b[3], b[2]])),
        (2, Order::Dcba) => |b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        (4, Order::Abcd) => |b| u64::from_be_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]),
        (4, Order::Cdab) => |b| u64::from_be_bytes([b[6], b[7], b[4], b[5], b[2], b[3], b[0], b[1]]),
        (4, Order::Badc) => |b| u64::from_be_bytes([b[1], b[0], b[3], b[2], b[5], b[4], b[7], b[6]]),
        (4, Order::Dcba) => |b| u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]),
        (_, order) if order.swaps_bytes() => |b| u64::from(u16::from_le_bytes([b[0], b[1]])),
        _ => |b| u64::from(u16::from_be_bytes([b[0], b[1]])),
    }
}

/// The text in some registers, up to the first zero byte and without trailing blanks. Bytes that are not valid UTF-8
/// are read as Latin-1, so that none is lost.
fn text(bytes: &[u8], order: Order, text_bytes: TextBytes) -> String {
    let mut letters: Vec<u8> = Vec::with_capacity(bytes.len());
    for pair in bytes.chunks_exact(2) {
        let (high, low) = if order.swaps_bytes() { (pair[1], pair[0]) } else { (pair[0], pair[1]) };
        match text_bytes {
            TextBytes::Both => letters.extend([high, low]),
            TextBytes::High => letters.push(high),
            TextBytes::Low => letters.push(low),
        }
    }
    let end = letters.iter().position(|&byte| byte == 0).unwrap_or(letters.len());
    letters.truncate(end);
    let text = String::from_utf8(letters).unwrap_or_else(|wrong| wrong.into_bytes().into_iter().map(char::from).collect());
    text.trim_end_matches(' ').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_examples_of_the_standard() {
        // Values of IEEE 754-2019, 3.6: largest, smallest normal, smallest subnormal, one third.
        for (bits, value) in
            [(0x7BFF, 65_504.0), (0x0400, 6.103_515_6e-5), (0x0001, 5.960_464_5e-8), (0x3555, 0.333_251_95), (0x8000, -0.0)]
        {
            assert_eq!(half(bits).to_bits(), f32::to_bits(value), "{bits:04x}");
        }
        assert!(half(0x7E00).is_nan());
        assert_eq!(half(0xFC00).to_bits(), f32::NEG_INFINITY.to_bits());
    }

    #[test]
    fn decimal_digits() {
        assert_eq!(digits(0x1234), Some(1234));
        assert_eq!(digits(0x12A4), None);
    }
}
