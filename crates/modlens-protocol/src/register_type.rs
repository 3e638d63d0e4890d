//! The four tables of a device: coils, discrete inputs, input registers, holding registers.

/// One of the four tables of a device, in which coils, inputs and registers are addressed (Modbus Application Protocol
/// V1.1b3, section 4.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Space {
    /// Coils.
    Coil,
    /// Discrete inputs.
    Discrete,
    /// Input registers.
    Input,
    /// Holding registers.
    Holding,
}

impl Space {
    /// All tables with their short name in profiles and filters, their name in columns, and the leading digit of
    /// Modicon addresses.
    pub const ALL: [(Self, &'static str, &'static str, u32); 4] = [
        (Self::Coil, "co", "coil", 0),
        (Self::Discrete, "di", "discrete_input", 1),
        (Self::Input, "ir", "input_register", 3),
        (Self::Holding, "hr", "holding_register", 4),
    ];

    /// The table with this short or long name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|row| row.1 == word || row.2 == word).map(|row| row.0)
    }

    /// The short name: `hr`, `ir`, `co` or `di`.
    pub fn short_name(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// The name in columns: `holding_register`, for example.
    pub fn long_name(self) -> &'static str {
        Self::ALL[self as usize].2
    }

    /// The leading digit of Modicon addresses: the 4 of 40001.
    pub fn modicon_digit(self) -> u32 {
        Self::ALL[self as usize].3
    }

    /// Whether its items are bits rather than registers.
    pub fn is_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }
}
