//! The properties of a frame: its transmission mode, direction, verdict, and what delimited it.

/// How frames are put on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// Binary, CRC-16 (serial line specification, 2.5.1).
    Rtu,
    /// Hex characters between colon and CR LF (2.5.2).
    Ascii,
    /// MBAP header (messaging on TCP/IP, 3.1).
    Tcp,
}

impl Mode {
    /// As the `mode` column spells it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Rtu => "rtu",
            Self::Ascii => "ascii",
            Self::Tcp => "tcp",
        }
    }
}

/// Who sent a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// The master (client).
    Request,
    /// A unit (server).
    Response,
    /// It cannot be decided.
    Unknown,
}

impl Direction {
    /// The value of the `direction` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Request => "request",
            Self::Response => "response",
            Self::Unknown => "unknown",
        }
    }
}

/// What a frame is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// Whole, checksum right.
    Ok,
    /// Checksum wrong.
    BadChecksum,
    /// Ends too early.
    Incomplete,
    /// No frame.
    Noise,
    /// The recording prints no checksum.
    NoChecksum,
}

impl Verdict {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Ok, Self::BadChecksum, Self::Incomplete, Self::Noise, Self::NoChecksum];

    /// As the `verdict` column spells it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::BadChecksum => "bad_checksum",
            Self::Incomplete => "incomplete",
            Self::Noise => "noise",
            Self::NoChecksum => "no_checksum",
        }
    }

    /// Whether the content can be believed.
    pub fn good(self) -> bool {
        matches!(self, Self::Ok | Self::NoChecksum)
    }
}

/// The evidence that ended a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CutBy {
    /// A silence.
    Silence,
    /// The length that the header announces.
    Length,
    /// A right checksum where the layout fixes no length.
    Checksum,
    /// CR LF.
    Delimiter,
    /// The end of a record of the recording.
    Record,
    /// A colon starts the next frame.
    Restart,
    /// The longest frame, or the longest noise row.
    Limit,
    /// The next frame begins.
    Frame,
    /// The end of the recording.
    End,
}

impl CutBy {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Silence,
        Self::Length,
        Self::Checksum,
        Self::Delimiter,
        Self::Record,
        Self::Restart,
        Self::Limit,
        Self::Frame,
        Self::End,
    ];

    /// As the `cut_by` column spells it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Silence => "silence",
            Self::Length => "length",
            Self::Checksum => "checksum",
            Self::Delimiter => "delimiter",
            Self::Record => "record",
            Self::Restart => "restart",
            Self::Limit => "limit",
            Self::Frame => "frame",
            Self::End => "end",
        }
    }
}

/// The longest RTU frame (serial line specification, 2.5.1).
pub const RTU_LIMIT: usize = 256;

/// The unit that all units listen to (serial line specification, 2.2).
pub const BROADCAST: u8 = 0;
