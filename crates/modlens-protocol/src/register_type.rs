//! The four tables of a device: coils, discrete inputs, input registers, holding registers.

/// One of the four tables of a device.
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
    /// All of them with the short word of profiles and filters, the word of columns, and the leading digit of Modicon addresses.
    pub const ALL: [(Self, &'static str, &'static str, u32); 4] = [
        (Self::Coil, "co", "coil", 0),
        (Self::Discrete, "di", "discrete_input", 1),
        (Self::Input, "ir", "input_register", 3),
        (Self::Holding, "hr", "holding_register", 4),
    ];

    /// By its short word or its word in columns.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|row| row.1 == word || row.2 == word).map(|row| row.0)
    }

    /// The short word.
    pub fn short(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// The word of columns.
    pub fn long(self) -> &'static str {
        Self::ALL[self as usize].2
    }

    /// The leading digit of 40001.
    pub fn digit(self) -> u32 {
        Self::ALL[self as usize].3
    }

    /// Whether its items are bits.
    pub fn bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }
}
