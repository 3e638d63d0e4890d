//! The notations of addresses and times.

use modlens_protocol::register_type::Space;
use modlens_protocol::Ns;

/// The notation of addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AddressNotation {
    /// As on the wire, from 0, in decimal.
    Wire,
    /// As on the wire, from 0, in hexadecimal.
    Hex,
    /// Modicon notation with five digits: 40001 is wire address 0 of the holding registers.
    Five,
    /// Modicon notation with six digits: 400001 is wire address 0 of the holding registers.
    Six,
}

impl AddressNotation {
    /// The notation with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "wire" => Self::Wire,
            "hex" => Self::Hex,
            "5digit" => Self::Five,
            "6digit" => Self::Six,
            _ => return None,
        })
    }

    /// The title of an address column in this notation.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Wire => "addr from 0",
            Self::Hex => "hex from 0",
            Self::Five => "40001-based",
            Self::Six => "400001-based",
        }
    }

    /// The title of an address column in a narrow terminal.
    pub(super) fn short_title(self) -> &'static str {
        match self {
            Self::Wire => "from 0",
            Self::Hex => "hex",
            Self::Five => "40001",
            Self::Six => "400001",
        }
    }

    /// A wire address in this notation; in wire notation if the table is unknown. Five digits suffice up to 9999;
    /// higher addresses are shown with six.
    pub fn address(self, wire: u32, space: Option<Space>) -> String {
        match (self, space) {
            (Self::Hex, _) => format!("0x{wire:04X}"),
            (Self::Wire, _) | (_, None) => wire.to_string(),
            (Self::Five, Some(space)) => space.five_digit(wire).unwrap_or_else(|| space.six_digit(wire)),
            (Self::Six, Some(space)) => space.six_digit(wire),
        }
    }
}

/// The offset of local time from UTC at a time, both in ns. It does not change within a minute.
pub type Zone = Box<dyn Fn(Ns) -> Ns + Send + Sync>;

/// The times that a table shows. If they are unknown, the position in the file is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeDisplay {
    /// Time of day.
    Clock,
    /// Time since the start.
    Elapsed,
    /// Time since the previous row.
    Delta,
}
