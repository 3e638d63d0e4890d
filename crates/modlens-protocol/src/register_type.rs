//! The four tables of a device: coils, discrete inputs, input registers, holding registers.

/// The highest address of a table.
pub const LAST_ADDRESS: u32 = 0xFFFF;

/// The highest number that the Modicon notation of five digits reaches.
const MAX_FIVE_DIGIT_NUMBER: u32 = 9999;

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

    /// What one item is called in a sentence.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Coil => "coil",
            Self::Discrete => "input",
            Self::Input | Self::Holding => "register",
        }
    }

    /// A wire address in the Modicon notation of six digits, which reaches all addresses: the leading digit, then the
    /// number from 1. The specification says only that numbers count from 1 (4.4), but every manual uses this notation.
    pub fn six_digit(self, address: u32) -> String {
        format!("{}{:05}", self.modicon_digit(), address + 1)
    }

    /// A wire address in the Modicon notation of five digits; `None` where that does not reach.
    pub fn five_digit(self, address: u32) -> Option<String> {
        (address < MAX_FIVE_DIGIT_NUMBER).then(|| format!("{}{:04}", self.modicon_digit(), address + 1))
    }

    /// A wire address in six digits, followed by five digits in brackets where they suffice.
    pub fn both_notations(self, address: u32) -> String {
        let long = self.six_digit(address);
        self.five_digit(address).map_or_else(|| long.clone(), |short| format!("{long} ({short})"))
    }

    /// Whether its items are bits rather than registers.
    pub fn is_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modicon_numbers_are_one_more_than_on_the_wire() {
        for (space, address, short, long) in [
            (Space::Coil, 0, Some("00001"), "000001"),
            (Space::Coil, 19, Some("00020"), "000020"),
            (Space::Discrete, 196, Some("10197"), "100197"),
            (Space::Input, 8, Some("30009"), "300009"),
            (Space::Holding, 107, Some("40108"), "400108"),
            (Space::Holding, 9998, Some("49999"), "409999"),
            (Space::Holding, 9999, None, "410000"),
            (Space::Holding, 65535, None, "465536"),
        ] {
            assert_eq!(space.five_digit(address).as_deref(), short, "{address}");
            assert_eq!(space.six_digit(address), long, "{address}");
            let both = short.map_or(long.to_owned(), |short| format!("{long} ({short})"));
            assert_eq!(space.both_notations(address), both, "{address}");
        }
    }
}
