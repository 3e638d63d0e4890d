//! From registers to numbers in a tight loop, for the points that are simple: whole numbers of up to 32 bits with scale,
//! offset, scale factor, "no value", labels, and floats as they are. The same numbers as `Value::number` of their values.

use crate::points::convert::{Convert, Make};
use crate::profile::{Decimal, Order, Point, Sentinel, Type};

/// How a point's number is come to. Points of a plan share them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shortcut {
    load: Load,
    /// Registers or bits of a value.
    pub width: u16,
    form: Form,
}

/// How the bits are loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Load {
    One,
    OneTurned,
    Two(Order),
    Four(Order),
}

/// What is made of them.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// The way of a `Value`.
    Long,
    /// An unsigned register.
    Plain,
    /// A float.
    Float,
    /// raw * digits / divisor, all of it exact but the division.
    Scaled { signed: bool, digits: i64, divisor: f64 },
    /// With all that there may be.
    Whole(Whole),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Whole {
    shift: u8,
    width: u8,
    signed: bool,
    /// Bits that say "no value".
    nan: Option<u32>,
    digits: i64,
    offset: i64,
    exponent: i32,
    factor: Option<u16>,
}

/// A number that is none: what a point has no number for.
pub const NOTHING: f64 = f64::NAN;

/// Powers of ten that a float64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

impl Shortcut {
    /// That of a bare register.
    pub const BARE: Self = Self { load: Load::One, width: 1, form: Form::Plain };

    /// The long way.
    pub fn long(width: u16) -> Self {
        Self { load: Load::One, width, form: Form::Long }
    }

    /// Chooses for a point.
    pub fn new(point: &Point, convert: &Convert, factor: Option<u16>) -> Self {
        let (width, long) = (point.step(), Self::long(point.step()));
        let Some(load) = load(point.kind, point.order) else { return long };
        let bare = point.scale.is_none() && point.offset.is_none() && factor.is_none();
        if matches!(point.kind, Type::F32 | Type::F64) {
            return if bare && point.nan.is_empty() { Self { load, width, form: Form::Float } } else { long };
        }
        // The label of a scaled number is that of the raw one, and so is the number then.
        if !(bare || point.labels.is_empty() && point.bit_labels.is_empty()) {
            return long;
        }
        whole(point, convert, factor).map_or(long, |whole| Self { load, width, form: whole.form(load) })
    }

    /// The number that stands at `at` in these registers; `Err` where it takes the long way, or is not there.
    ///
    /// What is most frequent stands here, and the rest elsewhere: the loop around it has to fit into the registers of a CPU.
    #[inline]
    pub fn number(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        match (self.form, self.load) {
            (Form::Plain, _) => Ok(f64::from(u16::from_be_bytes(array(bytes, at)?))),
            (Form::Scaled { signed, digits, divisor }, Load::One) => {
                let bits = u16::from_be_bytes(array(bytes, at)?);
                let raw = if signed { i64::from(bits as i16) } else { i64::from(bits) };
                Ok((raw * digits) as f64 / divisor)
            }
            (Form::Float, Load::Two(order)) => {
                let number = f32::from_bits(two(array(bytes, at)?, order));
                Ok(if number.is_finite() { f64::from(number) } else { NOTHING })
            }
            _ => self.rarer(bytes, at, factors),
        }
    }

    #[inline(never)]
    fn rarer(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        match (self.form, self.load) {
            (Form::Scaled { signed, digits, divisor }, Load::Two(order)) => {
                let bits = two(array(bytes, at)?, order);
                let raw = if signed { i64::from(bits as i32) } else { i64::from(bits) };
                Ok((raw * digits) as f64 / divisor)
            }
            (Form::Float, Load::Four(order)) => {
                let number = f64::from_bits(four(array(bytes, at)?, order));
                Ok(if number.is_finite() { number } else { NOTHING })
            }
            (Form::Whole(whole), Load::Two(order)) => whole.number(two(array(bytes, at)?, order), factors),
            (Form::Whole(whole), Load::One) => whole.number(u32::from(u16::from_be_bytes(array(bytes, at)?)), factors),
            (Form::Whole(whole), Load::OneTurned) => whole.number(u32::from(u16::from_le_bytes(array(bytes, at)?)), factors),
            _ => Err(()),
        }
    }
}

impl Whole {
    fn form(self, load: Load) -> Form {
        let all = self.shift == 0 && self.width == if matches!(load, Load::Two(_)) { 32 } else { 16 };
        let simple = all && self.offset == 0 && self.nan.is_none() && self.factor.is_none() && load != Load::OneTurned;
        match POWERS.get(-self.exponent as usize).filter(|_| simple) {
            Some(1.0) if load == Load::One && !self.signed && self.digits == 1 => Form::Plain,
            Some(&divisor) => Form::Scaled { signed: self.signed, digits: self.digits, divisor },
            None => Form::Whole(self),
        }
    }

    fn number(&self, loaded: u32, factors: &[Option<i32>]) -> Result<f64, ()> {
        let above = 32 - u32::from(self.width);
        let bits = loaded >> self.shift << above >> above;
        let raw = if self.signed { i64::from((bits << above) as i32 >> above) } else { i64::from(bits) };
        let power = match self.factor {
            None => 0,
            Some(slot) => match factors.get(usize::from(slot)) {
                Some(Some(power)) => *power,
                // A factor that was never seen is not guessed.
                _ => return Ok(NOTHING),
            },
        };
        if self.nan == Some(bits) {
            return Ok(NOTHING);
        }
        let divisor = POWERS.get(-(self.exponent + power) as usize).ok_or(())?;
        Ok((raw * self.digits + self.offset) as f64 / divisor)
    }
}

/// The whole number of a point, where an i64 and a float64 hold it exactly.
fn whole(point: &Point, convert: &Convert, factor: Option<u16>) -> Option<Whole> {
    let (shift, width, make) = convert.part();
    if !matches!(make, Make::Unsigned | Make::Signed) || width > 32 {
        return None;
    }
    let signed = make == Make::Signed;
    let (scale, offset) = (point.scale.unwrap_or(Decimal::ONE), point.offset.unwrap_or(Decimal::ZERO));
    let least = if offset.digits == 0 { scale.exponent } else { scale.exponent.min(offset.exponent) };
    let exponent = least.min(0);
    let aligned = |one: Decimal| one.digits.checked_mul(10i64.checked_pow((one.exponent - exponent).unsigned_abs())?);
    let (digits, offset) = (aligned(scale)?, if offset.digits == 0 { 0 } else { aligned(offset)? });
    // 32 bits times 20, and as much again: a float64 has 53.
    let exact = digits.unsigned_abs() < 1 << 20 && offset.unsigned_abs() < 1 << 52 && exponent >= -22;
    let nan = match &point.nan[..] {
        [] => None,
        [Sentinel::Whole(nan)] => Some(pattern(*nan, width, signed)?),
        _ => return None,
    };
    exact.then_some(Whole { shift: shift as u8, width: width as u8, signed, nan, digits, offset, exponent, factor })
}

/// The bits of a number that means "no value".
fn pattern(nan: i128, width: u32, signed: bool) -> Option<u32> {
    let bits = u32::try_from(nan).ok().filter(|&bits| u64::from(bits) < 1 << width);
    bits.or_else(|| (signed && -(1 << (width - 1)) <= nan && nan < 0).then_some(nan as u32 & (u32::MAX >> (32 - width))))
}

fn load(kind: Type, order: Order) -> Option<Load> {
    match kind.registers() {
        1 if order.swaps_bytes() => Some(Load::OneTurned),
        1 => Some(Load::One),
        2 => Some(Load::Two(order)),
        4 => Some(Load::Four(order)),
        _ => None,
    }
}

#[inline]
fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], ()> {
    let found = bytes.get(at..).and_then(<[u8]>::first_chunk);
    found.copied().ok_or(())
}

/// Without a branch: the low register in front is turned by 16 bits.
#[inline]
fn two(bytes: [u8; 4], order: Order) -> u32 {
    let straight = u32::from_be_bytes(bytes);
    let (mirrored, turn) = (straight.swap_bytes(), 16 * u32::from(matches!(order, Order::Cdab | Order::Badc)));
    (if order.swaps_bytes() { mirrored } else { straight }).rotate_left(turn)
}

#[inline]
fn four(bytes: [u8; 8], order: Order) -> u64 {
    let straight = u64::from_be_bytes(bytes);
    let turned = |bits: u64| (bits & 0x00FF_00FF_00FF_00FF) << 8 | bits >> 8 & 0x00FF_00FF_00FF_00FF;
    match order {
        Order::Abcd => straight,
        Order::Cdab => turned(straight.swap_bytes()),
        Order::Badc => turned(straight),
        Order::Dcba => straight.swap_bytes(),
    }
}
