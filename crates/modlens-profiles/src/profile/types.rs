//! The types of values, the orders of registers and bytes, and exact decimal numbers.

use std::fmt;

/// The type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Type {
    /// A bit.
    Bool,
    /// The high byte of a register.
    U8h,
    /// The low byte of a register.
    U8l,
    /// The high byte, signed.
    S8h,
    /// The low byte, signed.
    S8l,
    /// One register.
    U16,
    /// One register, signed.
    S16,
    /// Two registers.
    U32,
    /// Two registers, signed.
    S32,
    /// Four registers.
    U64,
    /// Four registers, signed.
    S64,
    /// Floating point, half precision.
    F16,
    /// Floating point, single precision.
    F32,
    /// Floating point, double precision.
    F64,
    /// Four decimal digits, one per half byte.
    Bcd16,
    /// Eight decimal digits, one per half byte.
    Bcd32,
    /// Text, two characters per register.
    Str,
    /// Text, one character per register, in the high byte.
    Strh,
    /// Text, one character per register, in the low byte.
    Strl,
    /// Bytes without further meaning, shown as hex.
    Raw,
}

impl Type {
    /// All types: name, registers of one value (0: as many as `count` says), description.
    pub const ALL: [(Self, &'static str, u16, &'static str); 20] = [
        (Self::Bool, "bool", 1, "a bit"),
        (Self::U8h, "u8h", 1, "the high half of a register"),
        (Self::U8l, "u8l", 1, "the low half of a register"),
        (Self::S8h, "s8h", 1, "the high half, signed"),
        (Self::S8l, "s8l", 1, "the low half, signed"),
        (Self::U16, "u16", 1, "a register"),
        (Self::S16, "s16", 1, "a register, signed"),
        (Self::U32, "u32", 2, "two registers"),
        (Self::S32, "s32", 2, "two registers, signed"),
        (Self::U64, "u64", 4, "four registers"),
        (Self::S64, "s64", 4, "four registers, signed"),
        (Self::F16, "f16", 1, "floating point, half precision"),
        (Self::F32, "f32", 2, "floating point, single precision"),
        (Self::F64, "f64", 4, "floating point, double precision"),
        (Self::Bcd16, "bcd16", 1, "four decimal digits"),
        (Self::Bcd32, "bcd32", 2, "eight decimal digits"),
        (Self::Str, "str", 0, "text, two characters a register"),
        (Self::Strh, "strh", 0, "text, one character a register, in its high half"),
        (Self::Strl, "strl", 0, "text, one character a register, in its low half"),
        (Self::Raw, "raw", 0, "uninterpreted bytes"),
    ];

    /// The type with this name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|row| row.1 == word).map(|row| row.0)
    }

    /// Its name in profiles.
    pub fn word(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// The number of registers of one value; 0 if `count` says it.
    pub fn registers(self) -> u16 {
        Self::ALL[self as usize].2
    }

    /// Whether it is an integer, so that values can have labels.
    pub fn is_integer(self) -> bool {
        self.is_number() && !matches!(self, Self::F16 | Self::F32 | Self::F64)
    }

    /// Whether it is a number, so that it can be scaled.
    pub fn is_number(self) -> bool {
        !matches!(self, Self::Bool | Self::Str | Self::Strh | Self::Strl | Self::Raw)
    }

    /// Whether it is a signed integer.
    pub fn is_signed(self) -> bool {
        matches!(self, Self::S8h | Self::S8l | Self::S16 | Self::S32 | Self::S64)
    }

    /// The number of bits of one value, if it is a number.
    pub fn bits(self) -> u32 {
        match self {
            Self::U8h | Self::U8l | Self::S8h | Self::S8l => 8,
            other => 16 * u32::from(other.registers()),
        }
    }
}

/// The order of registers and bytes on the wire, named by where the bytes of 0xAABBCCDD are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Order {
    /// Most significant register first, high byte first (big-endian).
    #[default]
    Abcd,
    /// Least significant register first, high byte first (word swap).
    Cdab,
    /// Most significant register first, low byte first (byte swap).
    Badc,
    /// Least significant register first, low byte first (little-endian).
    Dcba,
}

impl Order {
    /// All orders with their names.
    pub const ALL: [(Self, &'static str); 4] =
        [(Self::Abcd, "ABCD"), (Self::Cdab, "CDAB"), (Self::Badc, "BADC"), (Self::Dcba, "DCBA")];

    /// The order with this name; not case-sensitive.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|row| row.1.eq_ignore_ascii_case(word)).map(|row| row.0)
    }

    /// Its name.
    pub fn word(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// Whether the low byte of a register comes first.
    pub fn swaps_bytes(self) -> bool {
        matches!(self, Self::Badc | Self::Dcba)
    }

    /// Whether the least significant register comes first.
    pub fn swaps_words(self) -> bool {
        matches!(self, Self::Cdab | Self::Dcba)
    }
}

/// Whether masters read a point, write it, or both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Only read.
    #[default]
    Read,
    /// Only written.
    Write,
    /// Read and written.
    Both,
}

impl Access {
    /// All kinds of access with their names in profiles.
    pub const ALL: [(Self, &'static str); 3] = [(Self::Read, "r"), (Self::Write, "w"), (Self::Both, "rw")];

    /// Its name in profiles.
    pub fn word(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// A decimal number, exactly as it was written: `digits * 10^exponent`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decimal {
    /// All digits as one signed number.
    pub digits: i64,
    /// The power of ten.
    pub exponent: i32,
}

impl Decimal {
    /// One.
    pub const ONE: Self = Self { digits: 1, exponent: 0 };
    /// Zero.
    pub const ZERO: Self = Self { digits: 0, exponent: 0 };

    /// Parses `0.1`, `-40`, `1e-3`. `None` if the text is not a decimal number, or has more than 18 digits.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim().replace('_', "");
        let (mantissa, power) = match text.split_once(['e', 'E']) {
            Some((mantissa, power)) => (mantissa, power.parse::<i32>().ok()?),
            None => (text.as_str(), 0),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        if !fraction.bytes().all(|byte| byte.is_ascii_digit()) || fraction.len() + whole.len() == 0 {
            return None;
        }
        // Trailing zeros do not change the value: 0.10 is stored as 0.1.
        let fraction = fraction.trim_end_matches('0');
        let digits: i64 = format!("{whole}{fraction}").parse().ok()?;
        let exponent = power - fraction.len() as i32;
        (exponent.abs() <= 64 && digits.unsigned_abs() < 10u64.pow(18)).then_some(Self { digits, exponent })
    }

    /// The nearest floating point number.
    pub fn to_f64(self) -> f64 {
        self.to_string().parse().unwrap_or(f64::NAN)
    }
}

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&decimal_text(i128::from(self.digits), self.exponent))
    }
}

/// `digits * 10^exponent` without an exponent: `0.05`, `1200`.
pub fn decimal_text(digits: i128, exponent: i32) -> String {
    if exponent >= 0 {
        let zeros = if digits == 0 { 0 } else { exponent as usize };
        return format!("{digits}{}", "0".repeat(zeros));
    }
    let places = exponent.unsigned_abs() as usize;
    let sign = if digits < 0 { "-" } else { "" };
    let text = format!("{:0>width$}", digits.unsigned_abs(), width = places + 1);
    let (whole, fraction) = text.split_at(text.len() - places);
    format!("{sign}{whole}.{fraction}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::register_type::Space;

    #[test]
    fn tables_of_names_follow_the_order_of_the_variants() {
        assert!(Type::ALL.iter().enumerate().all(|(i, row)| row.0 as usize == i && Type::from_word(row.1) == Some(row.0)));
        assert!(Space::ALL.iter().enumerate().all(|(i, row)| row.0 as usize == i));
        assert!(Order::ALL.iter().enumerate().all(|(i, row)| row.0 as usize == i));
        assert!(Access::ALL.iter().enumerate().all(|(i, row)| row.0 as usize == i));
    }

    #[test]
    fn decimals_are_parsed_exactly() {
        for (text, back) in
            [("0.1", "0.1"), ("-40", "-40"), ("1e-3", "0.001"), ("2.50", "2.5"), ("1e3", "1000"), ("-0.05", "-0.05"), ("0", "0")]
        {
            assert_eq!(Decimal::parse(text).unwrap().to_string(), back);
        }
        for text in ["", ".", "x", "1.2.3", "nan", "inf", "1e999", "0x10", "1.-5"] {
            assert_eq!(Decimal::parse(text), None, "{text}");
        }
    }
}
