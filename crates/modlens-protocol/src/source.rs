//! The origin of rows: how positions in the recording are counted, and which clock it has.

/// The unit in which positions in a recording are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// `file@offset`
    Offset,
    /// `file:line`
    Line,
    /// `file#packet`
    Packet,
}

/// The clock of a bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// Date, time and zone are known: times are ns since 1970.
    Utc,
    /// Only differences between times have a meaning.
    Relative,
    /// The recording has no times.
    #[default]
    None,
}

impl Clock {
    /// Its name in the public API.
    pub fn text(self) -> &'static str {
        match self {
            Self::Utc => "utc",
            Self::Relative => "relative",
            Self::None => "none",
        }
    }
}
