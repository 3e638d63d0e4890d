//! What happened to a frame that did not arrive whole.

use modlens_protocol::finding::Finding;

/// What happened, and where in the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Harm {
    /// Bytes are missing in the recording: so many, in front of this byte of what is left.
    Lost {
        /// Index of the first byte behind the loss; the length of what is left where its end is missing.
        at: usize,
        /// How many bytes; 0 where nobody knows.
        count: usize,
    },
    /// The sender stopped: so many bytes were announced and never came.
    Truncated {
        /// How many bytes.
        count: usize,
    },
    /// Another sender talked into it from this byte on: more bits are 0 than were sent.
    Collided {
        /// Index of the first wrong byte.
        at: usize,
    },
    /// This byte came twice.
    Doubled {
        /// Index of the copy.
        at: usize,
    },
    /// No frame: what a driver puts on the line when it is switched on or off.
    Glitch,
}

impl Harm {
    /// The finding that says so, where there is one beside the verdict.
    pub fn finding(self) -> Option<Finding> {
        match self {
            Self::Lost { .. } => Some(Finding::LostBytes),
            Self::Collided { .. } => Some(Finding::Collision),
            Self::Doubled { .. } => Some(Finding::DoubledByte),
            Self::Glitch => Some(Finding::Glitch),
            Self::Truncated { .. } => None,
        }
    }

    /// What was seen, in words.
    pub fn text(self) -> String {
        let bytes = |count: usize| match count {
            0 => String::from("bytes"),
            1 => String::from("1 byte"),
            _ => format!("{count} bytes"),
        };
        match self {
            Self::Lost { at: 0, count } => format!("{} missing at the start", bytes(count)),
            Self::Lost { at, count } => format!("{} missing behind byte {}", bytes(count), at - 1),
            Self::Truncated { count } => format!("{} never came", bytes(count)),
            Self::Collided { at } => format!("wrong from byte {at} on, where more bits are 0 than were sent"),
            Self::Doubled { at } => format!("byte {at} repeats the one before it"),
            Self::Glitch => String::from("one value next to a frame, as drivers give when they are switched"),
        }
    }
}
