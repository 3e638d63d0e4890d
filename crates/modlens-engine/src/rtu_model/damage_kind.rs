//! What happened to a frame that did not arrive as it was sent.

/// What happened to a frame, and where in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamageKind {
    /// The tap has lost bytes of the frame.
    LostBytes {
        /// Index of the first byte after the loss; the number of bytes that are left where the end is missing.
        at: usize,
        /// Number of lost bytes; 0 where it is unknown.
        count: usize,
    },
    /// The driver of the tap's port has taken a byte out as software flow control.
    FlowControl {
        /// Index of the byte in the frame as it was sent.
        at: usize,
        /// Its value, XON or XOFF.
        value: u8,
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
