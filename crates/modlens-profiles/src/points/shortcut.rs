//! From registers to numbers in a tight loop, for the points that are simple: whole numbers of up to 32 bits with scale,
//! offset, scale factor, "no value", labels, and floats as they are. The same numbers as `Value::number` of their values.

use crate::points::convert::{Convert, Make};
use crate::profile::{Decimal, Order, Point, Sentinel, Type};

/// How a point's number is come to. Points of a plan share them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shortcut {
    /// Registers or bits of a value.
    pub width: u16,
    form: Form,
    quick: Quick,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// The way of a `Value`.
    Long,
    /// An unsigned register as it is.
    Plain,
    /// A float of two registers.
    Float,
    /// An unsigned register in tenths, hundredths and so on.
    Scaled,
    Quick,
    /// A scale factor, in `Bound::factors`, goes with this exponent.
    Factor {
        exponent: i32,
        slot: u16,
    },
    /// A float of four registers.
    Double(Order),
}

/// A whole number of up to two registers, with all that there may be.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Quick {
    /// Whether the low byte of a register comes first.
    swapped: bool,
    /// To the left around the end, so that the register that counts more stands in front.
    turn: u8,
    /// To the left, so that the bits that count stand in front, then with their sign to the right.
    up: u8,
    down: u8,
    /// Takes the sign off where there is none.
    mask: i64,
    /// A number that says "no value"; or one that never is.
    nan: i64,
    /// (raw * digits + offset) / divisor, all of it exact but the division.
    digits: i64,
    offset: i64,
    divisor: f64,
}

/// A number that is none: what a point has no number for.
pub const NOTHING: f64 = f64::NAN;

/// No 32 bits are this.
const NEVER: i64 = i64::MIN;

/// Powers of ten that a float64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

impl Shortcut {
    /// That of a bare register.
    pub const BARE: Self = Self { width: 1, form: Form::Plain, quick: Quick::BARE };

    /// The long way.
    pub fn long(width: u16) -> Self {
        Self { width, form: Form::Long, quick: Quick::BARE }
    }

    /// Chooses for a point.
    pub fn new(point: &Point, convert: &Convert, factor: Option<u16>) -> Self {
        let (width, long) = (point.step(), Self::long(point.step()));
        let bare = point.scale.is_none() && point.offset.is_none() && factor.is_none();
        let plain = bare && point.nan.is_empty();
        match point.kind {
            Type::F64 if plain => return Self { form: Form::Double(point.order), ..long },
            Type::F32 if plain => return Self { width, form: Form::Float, quick: Quick::of(2, point.order) },
            _ => {}
        }
        // The label of a scaled number is that of the raw one, and so is the number then.
        if !(bare || point.labels.is_empty() && point.bit_labels.is_empty()) {
            return long;
        }
        let Some((quick, exponent)) = Quick::whole(point, convert) else { return long };
        if let Some(slot) = factor {
            return Self { width, form: Form::Factor { exponent, slot }, quick };
        }
        match POWERS.get(-exponent as usize).map(|&divisor| Quick { divisor, ..quick }) {
            Some(Quick::BARE) => Self::BARE,
            Some(quick @ Quick { divisor, .. }) if quick == (Quick { divisor, ..Quick::BARE }) => {
                Self { width, form: Form::Scaled, quick }
            }
            Some(quick) => Self { width, form: Form::Quick, quick },
            None => long,
        }
    }

    /// The number that stands at `at` in these registers; `Err` where it takes the long way, or is not there.
    ///
    /// Neighbours are seldom alike, but their order comes again: a branch for each of the frequent forms costs less than
    /// one way for all of them.
    #[inline]
    pub fn number(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        if self.form == Form::Plain {
            return Ok(f64::from(u16::from_be_bytes(array(bytes, at)?)));
        }
        if self.form == Form::Scaled {
            return Ok(f64::from(u16::from_be_bytes(array(bytes, at)?)) / self.quick.divisor);
        }
        if self.form == Form::Float {
            let number = f32::from_bits(self.quick.turned(u32::from_be_bytes(array(bytes, at)?)));
            return Ok(if number.is_finite() { f64::from(number) } else { NOTHING });
        }
        if self.form == Form::Quick {
            return Ok(self.quick.number(loaded(bytes, at, self.width)?));
        }
        self.rarer(bytes, at, factors)
    }

    #[inline(never)]
    fn rarer(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        match self.form {
            Form::Factor { exponent, slot } => {
                // A factor that was never seen is not guessed.
                let Some(Some(power)) = factors.get(usize::from(slot)) else { return Ok(NOTHING) };
                let divisor = *POWERS.get(-(exponent + power) as usize).ok_or(())?;
                Ok(Quick { divisor, ..self.quick }.number(loaded(bytes, at, self.width)?))
            }
            Form::Double(order) => {
                let number = f64::from_bits(four(array(bytes, at)?, order));
                Ok(if number.is_finite() { number } else { NOTHING })
            }
            _ => Err(()),
        }
    }
}

/// Two registers; zeros stand for a second one that does not belong to the value and is not there.
#[inline]
fn loaded(bytes: &[u8], at: usize, width: u16) -> Result<u32, ()> {
    match bytes.get(at..).ok_or(())? {
        [a, b, c, d, ..] => Ok(u32::from_be_bytes([*a, *b, *c, *d])),
        [a, b, ..] if width == 1 => Ok(u32::from_be_bytes([*a, *b, 0, 0])),
        _ => Err(()),
    }
}

impl Quick {
    /// An unsigned register.
    const BARE: Self =
        Self { swapped: false, turn: 0, up: 0, down: 16, mask: 0xFFFF, nan: NEVER, digits: 1, offset: 0, divisor: 1.0 };

    /// All bits of so many registers.
    fn of(registers: u16, order: Order) -> Self {
        // Turned in its bytes, the first register stands behind the second.
        let behind = match registers {
            1 => order.swaps_bytes(),
            _ => matches!(order, Order::Cdab | Order::Badc),
        };
        let turn = 16 * u8::from(behind);
        if registers == 1 {
            Self { swapped: order.swaps_bytes(), turn, ..Self::BARE }
        } else {
            Self { swapped: order.swaps_bytes(), turn, down: 0, mask: 0xFFFF_FFFF, ..Self::BARE }
        }
    }

    #[inline]
    fn number(&self, loaded: u32) -> f64 {
        let raw = self.raw(self.turned(loaded));
        if raw == self.nan {
            return NOTHING;
        }
        (raw * self.digits + self.offset) as f64 / self.divisor
    }

    #[inline]
    fn turned(&self, loaded: u32) -> u32 {
        if self.swapped { loaded.swap_bytes() } else { loaded }.rotate_left(u32::from(self.turn))
    }

    #[inline]
    fn raw(&self, turned: u32) -> i64 {
        i64::from((turned << self.up) as i32 >> self.down) & self.mask
    }

    /// The whole number of a point, where an i64 and a float64 hold it exactly; and the power of ten that it takes.
    fn whole(point: &Point, convert: &Convert) -> Option<(Self, i32)> {
        let registers = point.kind.registers();
        let (shift, width, make) = convert.part();
        if !matches!(make, Make::Unsigned | Make::Signed) || registers > 2 {
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
        let all = 16 * u32::from(registers);
        // The bits that count stand behind those of higher value; and the half without registers is below all.
        let up = all.checked_sub(shift + width)? as u8;
        let down = (32 - width) as u8;
        let mask = if signed { -1 } else { (1 << width) - 1 };
        let mut quick = Self { up, down, mask, digits, offset, ..Self::of(registers, point.order) };
        quick.nan = match &point.nan[..] {
            [] => NEVER,
            [Sentinel::Whole(nan)] => quick.raw(pattern(*nan, width, signed)? << (32 - width) >> up),
            _ => return None,
        };
        exact.then_some((quick, exponent))
    }
}

/// The bits of a number that means "no value".
fn pattern(nan: i128, width: u32, signed: bool) -> Option<u32> {
    let bits = u32::try_from(nan).ok().filter(|&bits| u64::from(bits) < 1 << width);
    bits.or_else(|| (signed && -(1 << (width - 1)) <= nan && nan < 0).then_some(nan as u32 & (u32::MAX >> (32 - width))))
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

#[inline]
fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], ()> {
    let found = bytes.get(at..).and_then(<[u8]>::first_chunk);
    found.copied().ok_or(())
}
