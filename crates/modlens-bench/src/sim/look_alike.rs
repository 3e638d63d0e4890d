//! What a line may carry besides its own frames: the kinds that `look_alikes` puts into clean traffic.

/// What is put between the transactions of clean traffic, or in front of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LookAlike {
    /// One write of a file record (function 21) again and again, whose data hold a valid frame. The response equals it.
    FileWrite,
    /// One write of registers (function 16) again and again, whose data hold a valid frame.
    RegisterWrite,
    /// One loopback (function 8) again and again, whose data hold a valid frame. The response equals it.
    Loopback,
    /// One request of a vendor's function again and again, whose data hold a valid frame, and its response.
    Vendor,
    /// Registers read again and again that hold a valid frame.
    Read,
    /// Runs of one byte.
    Runs,
    /// Spells of a square wave that drifts slowly, and of a line that nobody drives.
    Squares,
    /// Spells of a poll at another baud rate.
    WrongBaud,
    /// A telegram of another protocol again and again, of which a part has a valid CRC by chance.
    Foreign,
    /// Three lines of Modbus ASCII in front.
    AsciiInFront,
    /// Five look-alikes of Modbus/TCP frames in front.
    MbapInFront,
    /// Nothing: only the framing has to be found.
    Nothing,
}

impl LookAlike {
    /// Whether the analyzer has to find the framing.
    pub fn hides_framing(self) -> bool {
        matches!(self, Self::AsciiInFront | Self::MbapInFront | Self::Nothing)
    }

    /// The probability of one of these in front of a transaction.
    pub(super) fn share(self) -> f64 {
        match self {
            Self::AsciiInFront | Self::MbapInFront | Self::Nothing => 0.0,
            Self::Squares | Self::WrongBaud => 0.02,
            Self::Runs => 0.08,
            Self::Foreign => 0.15,
            _ => 0.25,
        }
    }
}
