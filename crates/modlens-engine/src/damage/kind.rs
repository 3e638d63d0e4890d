//! What happened to a frame that did not arrive as it was sent.

use modlens_protocol::finding::Finding;

/// What happened to a frame, and where in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamageKind {
    /// The tap has lost bytes of the frame.
    LostBytes {
        /// Index of the first byte behind the loss; the number of bytes that are left where the end is missing.
        at: usize,
        /// Number of lost bytes; 0 where it is unknown.
        count: usize,
    },
    /// The sender stopped before the announced length.
    Truncated {
        /// Number of bytes that were announced and never sent; 0 where it is unknown.
        count: usize,
    },
    /// A second transmitter was active at the same time: more bits are 0 than were sent.
    Collision {
        /// Index of the first wrong byte.
        at: usize,
    },
    /// A byte was received twice.
    DoubledByte {
        /// Index of the second copy.
        at: usize,
    },
    /// Not a frame at all: stray bytes that a line driver leaves when it is switched on or off.
    Glitch,
}

impl DamageKind {
    /// The finding on such a frame; `None` where the verdict says it all.
    pub fn finding(self) -> Option<Finding> {
        match self {
            Self::LostBytes { .. } => Some(Finding::LostBytes),
            Self::Collision { .. } => Some(Finding::Collision),
            Self::DoubledByte { .. } => Some(Finding::DoubledByte),
            Self::Glitch => Some(Finding::Glitch),
            Self::Truncated { .. } => None,
        }
    }

    /// The detail of the finding, in words for the user.
    pub fn detail(self) -> String {
        let bytes = |count: usize| match count {
            0 => String::from("bytes"),
            1 => String::from("1 byte"),
            _ => format!("{count} bytes"),
        };
        match self {
            Self::LostBytes { at: 0, count } => format!("{} missing at the start", bytes(count)),
            Self::LostBytes { at, count } => format!("{} missing behind byte {}", bytes(count), at - 1),
            Self::Truncated { count } => format!("{} never came", bytes(count)),
            Self::Collision { at } => format!("wrong from byte {at} on, where more bits are 0 than were sent"),
            Self::DoubledByte { at } => format!("byte {at} repeats the one before it"),
            Self::Glitch => String::from("one value next to a frame, as drivers give when they are switched"),
        }
    }
}
