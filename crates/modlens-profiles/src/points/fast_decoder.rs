//! Decodes registers to numbers in a tight loop, for simple points: integers of up to 32 bits with scale, offset, scale
//! factor, "no value" and labels, and unscaled floats. The results equal `Value::number` of the general conversion in
//! `conversion`.

use crate::points::conversion::{Conversion, Interpretation};
use crate::profile::{Decimal, Order, Point, Sentinel, Type};

/// How the number of a point is decoded. Points that are encoded alike share one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FastDecoder {
    /// The number of registers or bits that a value takes.
    pub width: u16,
    kind: DecoderKind,
    integer: IntegerDecoder,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DecoderKind {
    /// Not covered here: the caller has to take the general path through a `Value`.
    General,
    /// An unsigned register without scale.
    UnsignedRegister,
    /// A single precision float in two registers.
    Float32,
    /// An unsigned register divided by a power of ten.
    ScaledRegister,
    /// An integer with everything that `IntegerDecoder` can express.
    Integer,
    /// An integer with the scale factor in `factors[slot]`, whose exponent is added to this one.
    Factor { exponent: i32, slot: u16 },
    /// A double precision float in four registers.
    Float64(Order),
}

/// How the numbers of a group of points are decoded, for which there is a loop of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NumberForm {
    /// An unsigned register without scale.
    Register,
    /// An unsigned register divided by a power of ten.
    ScaledRegister {
        divisor: f64,
    },
    /// A single precision float in two registers.
    Float32 {
        order: WordOrder,
    },
    /// An integer in one register, or in two.
    Integer {
        integer: IntegerDecoder,
        order: WordOrder,
    },
    LongInteger {
        integer: IntegerDecoder,
        order: WordOrder,
    },
}

/// Where the most significant byte of a number is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WordOrder {
    /// In the second of two registers.
    is_second_higher: bool,
    /// In the low byte of a register.
    has_swapped_bytes: bool,
}

impl WordOrder {
    /// The 32 bits in two registers, the higher one first.
    #[inline]
    fn join(self, [high, low]: [u16; 2]) -> u32 {
        let bits = u32::from(high) << 16 | u32::from(low);
        if self.has_swapped_bytes {
            (bits & 0x00FF_00FF) << 8 | bits >> 8 & 0x00FF_00FF
        } else {
            bits
        }
    }
}

impl NumberForm {
    /// The places in the block of the registers of an entry that begins at this one, in the order in which `any` wants them.
    pub(super) fn places(self, at: u8) -> impl Iterator<Item = u8> {
        let places = match self {
            Self::Register | Self::ScaledRegister { .. } | Self::Integer { .. } => [Some(at), None],
            Self::Float32 { order } | Self::LongInteger { order, .. } if order.is_second_higher => [Some(at + 1), Some(at)],
            Self::Float32 { .. } | Self::LongInteger { .. } => [Some(at), Some(at + 1)],
        };
        places.into_iter().flatten()
    }

    /// Whether one of the numbers in these registers satisfies `is_wanted`. Without branches, so that the numbers are decoded side
    /// by side.
    #[inline]
    pub(super) fn any(self, registers: &[u16], is_wanted: impl Fn(f64) -> bool) -> bool {
        let pairs = registers.as_chunks().0;
        match self {
            Self::Register => any_of(registers, |&register| is_wanted(f64::from(register))),
            Self::ScaledRegister { divisor } => any_of(registers, |&register| is_wanted(f64::from(register) / divisor)),
            Self::Float32 { order } if order.has_swapped_bytes => any_of(pairs, |pair| is_wanted(float(order.join(*pair)))),
            Self::Float32 { .. } => any_of(pairs, |[high, low]| is_wanted(float(u32::from(*high) << 16 | u32::from(*low)))),
            Self::Integer { integer, order } => {
                any_of(registers, |&register| is_wanted(integer.scaled(order.join([register, 0]))))
            }
            Self::LongInteger { integer, order } => any_of(pairs, |pair| is_wanted(integer.scaled(order.join(*pair)))),
        }
    }
}

/// Whether one of the items satisfies `is_wanted`; all of them are looked at.
#[inline]
fn any_of<T>(items: &[T], is_wanted: impl Fn(&T) -> bool) -> bool {
    items.iter().fold(false, |any, item| any | is_wanted(item))
}

/// The float with these bits; `NO_NUMBER` if it is not finite.
#[inline]
fn float(bits: u32) -> f64 {
    let number = f32::from_bits(bits);
    if number.is_finite() {
        f64::from(number)
    } else {
        NO_NUMBER
    }
}

/// How to extract an integer from one or two registers. All of the operations below are always executed; neutral
/// operands disable them, so that the code needs no branches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct IntegerDecoder {
    /// Whether the low byte of a register comes first.
    has_swapped_bytes: bool,
    /// Rotation to the left, in bits, that moves the most significant register to the front.
    rotate_left: u8,
    /// Shift to the left, in bits, that moves the first significant bit to the front; `shift_right` then shifts to the right,
    /// extending the sign.
    shift_left: u8,
    shift_right: u8,
    /// Clears the extended sign bits of an unsigned number.
    mask: i64,
    /// The raw number that means "no value"; `NO_SENTINEL` if there is none.
    nan: i64,
    /// The value is (raw * digits + offset) / divisor. Everything but the division is exact.
    digits: i64,
    offset: i64,
    divisor: f64,
}

/// Stands for "this point has no number".
pub const NO_NUMBER: f64 = f64::NAN;

/// A raw number that 32 bits cannot represent.
const NO_SENTINEL: i64 = i64::MIN;

/// The powers of ten that a float64 represents exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21,
    1e22,
];

impl FastDecoder {
    /// The decoder of a register without a point.
    pub const BARE: Self = Self { width: 1, kind: DecoderKind::UnsignedRegister, integer: IntegerDecoder::BARE };

    /// A decoder that refers the caller to the general path.
    pub fn general(width: u16) -> Self {
        Self { width, kind: DecoderKind::General, integer: IntegerDecoder::BARE }
    }

    /// Chooses the decoder of a point. `factor` is the index of its scale factor.
    pub fn new(point: &Point, conversion: &Conversion, factor: Option<u16>) -> Self {
        let (width, general) = (point.registers_per_value(), Self::general(point.registers_per_value()));
        let has_no_scale = point.scale.is_none() && point.offset.is_none() && factor.is_none();
        let is_unscaled = has_no_scale && point.nan.is_empty();
        match point.kind {
            Type::F64 if is_unscaled => return Self { kind: DecoderKind::Float64(point.order), ..general },
            Type::F32 if is_unscaled => {
                return Self { width, kind: DecoderKind::Float32, integer: IntegerDecoder::of(2, point.order) }
            }
            _ => {}
        }
        // A label belongs to the raw number, and the number of a labelled value is the raw one as well. The decoders below
        // would return the scaled number.
        if !(has_no_scale || point.labels.is_empty() && point.bit_labels.is_empty()) {
            return general;
        }
        let Some((integer, exponent)) = IntegerDecoder::for_point(point, conversion) else { return general };
        if let Some(slot) = factor {
            return Self { width, kind: DecoderKind::Factor { exponent, slot }, integer };
        }
        match POWERS.get(-exponent as usize).map(|&divisor| IntegerDecoder { divisor, ..integer }) {
            Some(IntegerDecoder::BARE) => Self::BARE,
            Some(integer @ IntegerDecoder { divisor, .. }) if integer == (IntegerDecoder { divisor, ..IntegerDecoder::BARE }) => {
                Self { width, kind: DecoderKind::ScaledRegister, integer }
            }
            Some(integer) => Self { width, kind: DecoderKind::Integer, integer },
            None => general,
        }
    }

    /// How its numbers are decoded in a loop; `None` of the rare ways, which have none.
    pub(super) fn form(&self) -> Option<NumberForm> {
        let (integer, order) = (self.integer, self.integer.word_order());
        match self.kind {
            DecoderKind::UnsignedRegister => Some(NumberForm::Register),
            DecoderKind::ScaledRegister => Some(NumberForm::ScaledRegister { divisor: integer.divisor }),
            DecoderKind::Float32 => Some(NumberForm::Float32 { order }),
            DecoderKind::Integer if self.width == 1 => Some(NumberForm::Integer { integer, order }),
            DecoderKind::Integer => Some(NumberForm::LongInteger { integer, order }),
            DecoderKind::General | DecoderKind::Factor { .. } | DecoderKind::Float64(_) => None,
        }
    }

    /// The number whose first register is at byte offset `at`. `Err` if the caller has to take the general path, or
    /// the registers are not there.
    ///
    /// Neighbouring points are seldom encoded alike, but the sequence repeats with every poll and the branch predictor
    /// learns it: a branch for each of the frequent forms is cheaper than one code path for all of them.
    #[inline]
    pub fn number(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        if self.kind == DecoderKind::UnsignedRegister {
            return Ok(f64::from(u16::from_be_bytes(array(bytes, at)?)));
        }
        if self.kind == DecoderKind::ScaledRegister {
            return Ok(f64::from(u16::from_be_bytes(array(bytes, at)?)) / self.integer.divisor);
        }
        if self.kind == DecoderKind::Float32 {
            return Ok(float(self.integer.most_significant_first(u32::from_be_bytes(array(bytes, at)?))));
        }
        if self.kind == DecoderKind::Integer {
            return Ok(self.integer.number(load_two_registers(bytes, at, self.width)?));
        }
        self.decode_rare_kind(bytes, at, factors)
    }

    /// The forms that are rare, kept out of the inlined code.
    #[inline(never)]
    fn decode_rare_kind(&self, bytes: &[u8], at: usize, factors: &[Option<i32>]) -> Result<f64, ()> {
        match self.kind {
            DecoderKind::Factor { exponent, slot } => {
                // A factor that was never seen is not guessed.
                let Some(Some(power)) = factors.get(usize::from(slot)) else { return Ok(NO_NUMBER) };
                let divisor = *POWERS.get(-(exponent + power) as usize).ok_or(())?;
                Ok(IntegerDecoder { divisor, ..self.integer }.number(load_two_registers(bytes, at, self.width)?))
            }
            DecoderKind::Float64(order) => {
                let number = f64::from_bits(bits_of_four_registers(array(bytes, at)?, order));
                Ok(if number.is_finite() { number } else { NO_NUMBER })
            }
            _ => Err(()),
        }
    }
}

/// Loads two registers. If the value takes only one and the block ends after it, zeros replace the second.
#[inline]
fn load_two_registers(bytes: &[u8], at: usize, width: u16) -> Result<u32, ()> {
    match bytes.get(at..).ok_or(())? {
        [a, b, c, d, ..] => Ok(u32::from_be_bytes([*a, *b, *c, *d])),
        [a, b, ..] if width == 1 => Ok(u32::from_be_bytes([*a, *b, 0, 0])),
        _ => Err(()),
    }
}

impl IntegerDecoder {
    /// An unsigned register.
    const BARE: Self = Self {
        has_swapped_bytes: false,
        rotate_left: 0,
        shift_left: 0,
        shift_right: 16,
        mask: 0xFFFF,
        nan: NO_SENTINEL,
        digits: 1,
        offset: 0,
        divisor: 1.0,
    };

    /// Extracts all bits of one or two registers, in this order.
    fn of(registers: u16, order: Order) -> Self {
        // After the bytes of the loaded 32 bits are swapped, a single register is in the lower half and must be
        // moved to the front.
        let behind = match registers {
            1 => order.swaps_bytes(),
            _ => matches!(order, Order::Cdab | Order::Badc),
        };
        let rotate_left = 16 * u8::from(behind);
        if registers == 1 {
            Self { has_swapped_bytes: order.swaps_bytes(), rotate_left, ..Self::BARE }
        } else {
            Self { has_swapped_bytes: order.swaps_bytes(), rotate_left, shift_right: 0, mask: 0xFFFF_FFFF, ..Self::BARE }
        }
    }

    /// The scaled number in the loaded registers; `NO_NUMBER` if the raw number means "no value".
    #[inline]
    fn number(&self, registers: u32) -> f64 {
        self.scaled(self.most_significant_first(registers))
    }

    /// The order of the registers that it loads.
    fn word_order(&self) -> WordOrder {
        // Swapping the bytes of 32 bits swaps the registers as well, and the rotation swaps them back.
        let is_second_higher = self.has_swapped_bytes != (self.rotate_left != 0);
        WordOrder { is_second_higher, has_swapped_bytes: self.has_swapped_bytes }
    }

    /// The same of registers with the most significant byte first.
    #[inline]
    fn scaled(&self, registers: u32) -> f64 {
        let raw = self.raw(registers);
        if raw == self.nan {
            return NO_NUMBER;
        }
        (raw * self.digits + self.offset) as f64 / self.divisor
    }

    /// The loaded registers with the most significant byte first.
    #[inline]
    fn most_significant_first(&self, registers: u32) -> u32 {
        if self.has_swapped_bytes { registers.swap_bytes() } else { registers }.rotate_left(u32::from(self.rotate_left))
    }

    /// The significant bits as a signed number.
    #[inline]
    fn raw(&self, registers: u32) -> i64 {
        i64::from((registers << self.shift_left) as i32 >> self.shift_right) & self.mask
    }

    /// The extraction of an integer point and the power of ten that its number must be multiplied with. `None` if the
    /// result would not be exact in an i64 and a float64.
    fn for_point(point: &Point, conversion: &Conversion) -> Option<(Self, i32)> {
        let registers = point.kind.registers();
        let (shift, width, interpretation) = conversion.part();
        if !matches!(interpretation, Interpretation::Unsigned | Interpretation::Signed) || registers > 2 {
            return None;
        }
        let signed = interpretation == Interpretation::Signed;
        let (scale, offset) = (point.scale.unwrap_or(Decimal::ONE), point.offset.unwrap_or(Decimal::ZERO));
        let least = if offset.digits == 0 { scale.exponent } else { scale.exponent.min(offset.exponent) };
        let exponent = least.min(0);
        let aligned = |one: Decimal| one.digits.checked_mul(10i64.checked_pow((one.exponent - exponent).unsigned_abs())?);
        let (digits, offset) = (aligned(scale)?, if offset.digits == 0 { 0 } else { aligned(offset)? });
        // 32 bits times 20 bits plus an offset of 52 bits: the sum stays within the 53 bits of a float64.
        let exact = digits.unsigned_abs() < 1 << 20 && offset.unsigned_abs() < 1 << 52 && exponent >= -22;
        let all = 16 * u32::from(registers);
        // The significant bits end `shift` bits above the lowest one. A point of one register is loaded into the upper
        // half of the 32 bits.
        let shift_left = all.checked_sub(shift + width)? as u8;
        let shift_right = (32 - width) as u8;
        let mask = if signed { -1 } else { (1 << width) - 1 };
        let mut integer = Self { shift_left, shift_right, mask, digits, offset, ..Self::of(registers, point.order) };
        integer.nan = match &point.nan[..] {
            [] => NO_SENTINEL,
            [Sentinel::Whole(nan)] => integer.raw(sentinel_bits(*nan, width, signed)? << (32 - width) >> shift_left),
            _ => return None,
        };
        exact.then_some((integer, exponent))
    }
}

/// The bit pattern of the number that means "no value"; `None` if the width cannot represent it.
fn sentinel_bits(nan: i128, width: u32, signed: bool) -> Option<u32> {
    let bits = u32::try_from(nan).ok().filter(|&bits| u64::from(bits) < 1 << width);
    bits.or_else(|| (signed && -(1 << (width - 1)) <= nan && nan < 0).then_some(nan as u32 & (u32::MAX >> (32 - width))))
}

/// The bits of four registers in this order, most significant first.
#[inline]
fn bits_of_four_registers(bytes: [u8; 8], order: Order) -> u64 {
    let straight = u64::from_be_bytes(bytes);
    let swap_bytes_of_registers = |bits: u64| (bits & 0x00FF_00FF_00FF_00FF) << 8 | bits >> 8 & 0x00FF_00FF_00FF_00FF;
    match order {
        Order::Abcd => straight,
        Order::Cdab => swap_bytes_of_registers(straight.swap_bytes()),
        Order::Badc => swap_bytes_of_registers(straight),
        Order::Dcba => straight.swap_bytes(),
    }
}

#[inline]
fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], ()> {
    let found = bytes.get(at..).and_then(<[u8]>::first_chunk);
    found.copied().ok_or(())
}
