//! What a request asks for, by which requests are distinguished.

use modlens_protocol::mix::mix;

/// Which request: unit, function, address and quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RequestKey {
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub function: u8,
    /// Address.
    pub address: u16,
    /// Quantity.
    pub quantity: u16,
}

/// The first number of the registers that a function reads, as manuals count them.
const REFERENCES: [(u8, u16); 3] = [(2, 10_001), (4, 30_001), (3, 40_001)];

impl RequestKey {
    /// Its addresses in words.
    pub(crate) fn block(self) -> String {
        match self.quantity {
            0 | 1 => format!("address {}", self.address),
            quantity => format!("addresses {} to {}", self.address, u32::from(self.address) + u32::from(quantity) - 1),
        }
    }

    /// The address on the wire that manuals mean by its address, if that is one of their numbers.
    pub(crate) fn meant_by_manuals(self) -> Option<u16> {
        let (_, first) = REFERENCES.into_iter().find(|(function, _)| *function == self.function)?;
        (first..first + 9999).contains(&self.address).then(|| self.address - first)
    }

    /// All of it as one number.
    #[inline]
    pub(crate) fn number(self) -> u64 {
        u64::from(u16::from_be_bytes([self.unit, self.function])) << 32 | u64::from(self.address) << 16 | u64::from(self.quantity)
    }

    /// The request with this number.
    pub(crate) fn of_number(number: u64) -> Self {
        let [_, _, unit, function, address @ .., _, _] = number.to_be_bytes();
        Self { unit, function, address: u16::from_be_bytes(address), quantity: number as u16 }
    }

    /// A well-mixed hash.
    #[inline]
    pub(crate) fn hash(self) -> u64 {
        mix(self.number())
    }
}
