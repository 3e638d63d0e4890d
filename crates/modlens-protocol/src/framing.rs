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
    /// The value of the `mode` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Rtu => "rtu",
            Self::Ascii => "ascii",
            Self::Tcp => "tcp",
        }
    }

    /// The mode with this name.
    pub fn from_text(text: &str) -> Option<Self> {
        [Self::Rtu, Self::Ascii, Self::Tcp].into_iter().find(|mode| mode.text() == text)
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

    /// The direction with this name.
    pub fn from_text(text: &str) -> Option<Self> {
        [Self::Request, Self::Response, Self::Unknown].into_iter().find(|direction| direction.text() == text)
    }
}

/// Whether bytes are a frame, and a sound one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// Complete, checksum valid.
    Ok,
    /// Checksum invalid.
    BadChecksum,
    /// It ends too early.
    Incomplete,
    /// The bytes belong to no frame.
    Noise,
    /// The recording prints no checksum.
    NoChecksum,
}

impl Verdict {
    /// All verdicts.
    pub const ALL: [Self; 5] = [Self::Ok, Self::BadChecksum, Self::Incomplete, Self::Noise, Self::NoChecksum];

    /// What the verdict means, as `modlens explain` says it.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Ok => "the frame is complete and its checksum matches",
            Self::BadChecksum => "the frame is complete, but its checksum does not match",
            Self::Incomplete => "the frame is shorter than its own fields say",
            Self::Noise => "bytes that are not part of any frame",
            Self::NoChecksum => "the frame is complete, but the recording does not include checksums",
        }
    }

    /// The value of the `verdict` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::BadChecksum => "bad_checksum",
            Self::Incomplete => "incomplete",
            Self::Noise => "noise",
            Self::NoChecksum => "no_checksum",
        }
    }

    /// Whether the content of the frame can be trusted.
    pub fn is_good(self) -> bool {
        matches!(self, Self::Ok | Self::NoChecksum)
    }
}

/// The evidence for the end of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DelimitedBy {
    /// A silence.
    Silence,
    /// The length that the header announces.
    Length,
    /// A valid checksum where the layout fixes no length.
    Checksum,
    /// CR LF.
    Delimiter,
    /// The end of a record of the recording.
    Record,
    /// A colon starts the next frame.
    Restart,
    /// The most bytes that a frame or a noise row has.
    Limit,
    /// The next frame begins.
    Frame,
    /// The end of the recording.
    End,
}

impl DelimitedBy {
    /// All kinds of evidence.
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

    /// The value of the `delimited_by` column.
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

/// The longest RTU frame, in bytes (serial line specification, 2.5.1).
pub const MAX_RTU_FRAME_BYTES: usize = 256;

/// The address of a broadcast, which all units listen to (serial line specification, 2.2).
pub const BROADCAST_UNIT: u8 = 0;
