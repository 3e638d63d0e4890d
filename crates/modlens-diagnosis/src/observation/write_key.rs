//! What a write writes, by which writes are distinguished.

use modlens_protocol::mix::mix;

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct WriteKey {
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub function: u8,
    /// Address of the first register or coil.
    pub address: u16,
}

impl WriteKey {
    /// Returns what an RTU request writes.
    pub(super) fn of_rtu(wire: &[u8]) -> Option<Self> {
        match *wire {
            [unit, function, high, low, ..] => Some(Self { unit, function, address: u16::from_be_bytes([high, low]) }),
            _ => None,
        }
    }

    /// A well-mixed hash.
    pub(crate) fn hash(self) -> u64 {
        mix(u64::from(self.unit) << 24 | u64::from(self.function) << 16 | u64::from(self.address))
    }
}
