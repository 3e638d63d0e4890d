//! A value of one or several registers, with the evidence for its layout.

use crate::profile::{Order, Type};

/// Consecutive registers that form one value, with the evidence for it.
#[derive(Clone, Debug)]
pub struct LayoutPoint {
    /// Address of the first register.
    pub address: u16,
    /// The number of registers.
    pub count: u16,
    /// The type.
    pub kind: Type,
    /// The order of registers and bytes.
    pub order: Order,
    /// The evidence against separate registers, in bits.
    pub bits: f64,
    /// Whether nothing else comes close.
    pub is_certain: bool,
    /// Whether its numbers only rise.
    pub is_rising: bool,
    /// The evidence as text.
    pub reason: String,
    /// The next best types and orders of the same registers.
    pub rivals: Vec<(Type, Order)>,
}

impl LayoutPoint {
    /// The address after its last register.
    pub fn end(&self) -> u32 {
        u32::from(self.address) + u32::from(self.count)
    }

    /// Whether both take some of the same registers. Other interpretations of exactly the same registers do not count.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        let same = (self.address, self.count) == (other.address, other.count);
        !same && u32::from(self.address) < other.end() && u32::from(other.address) < self.end()
    }

    /// The weight in the choice between overlapping points. A point without a close rival counts more than a guess.
    pub(super) fn weight(&self) -> f64 {
        if self.is_certain {
            self.bits
        } else {
            self.bits / 4.0
        }
    }
}
