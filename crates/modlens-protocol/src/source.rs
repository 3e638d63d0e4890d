//! Where rows come from: what their place numbers count, and what clock the recording had.

/// What a place number in `origin` counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// `file@offset`
    Offset,
    /// `file:line`
    Line,
    /// `file#packet`
    Packet,
}

/// What kind of clock a bus has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// Date, time and zone are known: ns since 1970.
    Utc,
    /// Only differences mean anything.
    Relative,
    /// None.
    #[default]
    None,
}
