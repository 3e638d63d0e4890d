//! The values of registers over time, and every way to read them as numbers.

use crate::points::Conversion;
use crate::profile::{Order, Type};
use modlens_protocol::register_type::Space;

/// The samples of one block of registers or bits that a master reads or writes, in the order of time.
#[derive(Clone, Debug)]
pub struct BlockSeries {
    /// The unit.
    pub unit: u8,
    /// The table of the unit.
    pub space: Space,
    /// Address of the first register.
    pub first: u16,
    /// The number of registers.
    pub width: usize,
    /// The time of each sample, in nanoseconds since 1970.
    pub times: Vec<i64>,
    /// The samples, one row of `width` registers after the other.
    pub cells: Vec<u16>,
}

impl BlockSeries {
    /// The number of samples.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Whether the block has no samples.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// The index of the last sample at this time or before it; the first sample if there is none.
    pub fn at_or_before(&self, time: i64) -> usize {
        self.times.partition_point(|&other| other <= time).saturating_sub(1)
    }

    /// The index of the first sample after this time; the last sample if there is none.
    pub fn after(&self, time: i64) -> usize {
        self.times.partition_point(|&other| other <= time).min(self.len() - 1)
    }

    /// Whether the samples cover this time, give or take one poll.
    pub fn covers(&self, time: i64) -> bool {
        let (first, last) = (self.times[0], self.times[self.len() - 1]);
        let poll = (last - first) / self.len().max(2) as i64;
        let reach = (3 * poll).max(5_000_000_000);
        first - reach <= time && time <= last + reach
    }
}

/// A type and an order in which registers can be read as a number.
#[derive(Clone, Debug)]
pub struct Variant {
    /// The type.
    pub kind: Type,
    /// The order of registers and bytes.
    pub order: Order,
    /// The number of registers.
    pub words: usize,
    conversion: Conversion,
}

/// All types and orders that are tried. One register comes first.
pub fn variants() -> Vec<Variant> {
    let mut all = Vec::new();
    let mut push = |kind: Type, order: Order| {
        let words = usize::from(kind.registers());
        all.push(Variant { kind, order, words, conversion: Conversion::of_type(kind, order) });
    };
    push(Type::U16, Order::Abcd);
    push(Type::S16, Order::Abcd);
    for kind in [Type::U32, Type::S32, Type::F32, Type::U64, Type::S64, Type::F64] {
        for (order, _) in Order::ALL {
            push(kind, order);
        }
    }
    all
}

/// One way to read one place: the block, the offset in it, the type and the order, or a single bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Index of the block.
    pub block: u32,
    /// Offset of the first register in the block.
    pub at: u16,
    /// Index in [`variants`].
    pub variant: u8,
    /// The bit of a register, or `None` for the whole number.
    pub bit: Option<u8>,
}

/// The numbers that a reading had over time.
pub struct Column<'a> {
    /// The block.
    pub block: &'a BlockSeries,
    variant: &'a Variant,
    at: usize,
    bit: Option<u8>,
}

/// Magnitudes that a float may have; anything else is taken for no number.
const FLOATS: std::ops::Range<f64> = 1e-9..1e12;

impl<'a> Column<'a> {
    /// The column of a reading.
    pub fn new(blocks: &'a [BlockSeries], variants: &'a [Variant], reading: Reading) -> Self {
        let block = &blocks[reading.block as usize];
        Self { block, variant: &variants[usize::from(reading.variant)], at: usize::from(reading.at), bit: reading.bit }
    }

    /// The number of a sample; NaN if its bits are no number.
    pub fn get(&self, sample: usize) -> f64 {
        let start = sample * self.block.width + self.at;
        let cells = &self.block.cells[start..start + self.variant.words];
        if let Some(bit) = self.bit {
            return f64::from(cells[0] >> bit & 1);
        }
        let mut bytes = [0; 8];
        for (pair, word) in bytes.chunks_exact_mut(2).zip(cells) {
            pair.copy_from_slice(&word.to_be_bytes());
        }
        let conversion = &self.variant.conversion;
        let bits = conversion.bits(&bytes[..2 * cells.len()]);
        match self.variant.kind {
            Type::F32 => plausible(f64::from(f32::from_bits(bits as u32))),
            Type::F64 => plausible(f64::from_bits(bits)),
            Type::S16 => f64::from(bits as u16 as i16),
            Type::S32 => f64::from(bits as u32 as i32),
            Type::S64 => bits as i64 as f64,
            _ => bits as f64,
        }
    }

    /// Whether the number is a float, which has no smallest step.
    pub fn is_float(&self) -> bool {
        matches!(self.variant.kind, Type::F32 | Type::F64)
    }

    /// The number at a time, on the line between the samples before and after it.
    pub fn interpolated(&self, time: i64) -> f64 {
        let (before, after) = (self.block.at_or_before(time), self.block.after(time));
        let (from, to) = (self.block.times[before], self.block.times[after]);
        if to <= from || time <= from {
            return self.get(before);
        }
        let share = (time - from) as f64 / (to - from) as f64;
        let value = self.get(before);
        value + (self.get(after) - value) * share.min(1.0)
    }

    /// At most `most` samples that are spread evenly over the whole series.
    pub fn spread(&self, most: usize) -> Vec<f64> {
        let len = self.block.len();
        let count = len.min(most);
        (0..count).map(|i| self.get(i * len / count)).collect()
    }
}

fn plausible(number: f64) -> f64 {
    if number == 0.0 || FLOATS.contains(&number.abs()) {
        number
    } else {
        f64::NAN
    }
}
