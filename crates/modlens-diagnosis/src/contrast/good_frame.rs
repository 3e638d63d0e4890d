//! The last good frame, and what it shows about the frame after it.

use modlens_engine::records::Side;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::EXCEPTION_BIT;

use crate::observation::{is_write, FrameObservation, WriteKey};

/// Noise that a write brings forth comes before so many further good frames: the next request and its answer.
const WRITE_FRAMES: u8 = 2;

/// The last good frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GoodFrame {
    pub number: u64,
    pub direction: Direction,
    pub unit: Option<u8>,
    pub function: Option<u8>,
    pub mode: Mode,
    /// Good frames since that of a write; as many as fit in it without one.
    pub since_write: u8,
    /// What that one writes, where it is known.
    write: Option<WriteKey>,
    /// It has a checksum, or stands where none is due.
    pub has_checksum: bool,
    /// Line or packet of its last byte, on Modbus/TCP and where the recording says who sent it; else 0.
    pub origin: u64,
    /// The same of each request, and who sent it, where the recording says so.
    pub line: u64,
    pub side: Option<Side>,
}

impl GoodFrame {
    /// The frame after `before`.
    #[inline]
    pub fn after(
        before: Option<Self>,
        number: u64,
        sender: (Direction, Option<u8>),
        mode: Mode,
        code: Option<u8>,
        write: Option<WriteKey>,
    ) -> Self {
        let function = code.map(|code| code & !EXCEPTION_BIT);
        let since_write = match function {
            Some(function) if is_write(function) => 0,
            _ => before.map_or(u8::MAX, |before| before.since_write.saturating_add(1)),
        };
        let write = write.or(before.filter(|_| since_write <= WRITE_FRAMES).and_then(|before| before.write));
        Self {
            number,
            direction: sender.0,
            unit: sender.1,
            function,
            mode,
            since_write,
            write,
            has_checksum: true,
            origin: 0,
            line: 0,
            side: None,
        }
    }

    /// The same with its verdict.
    #[inline]
    pub fn judged(self, verdict: Verdict) -> Self {
        Self { has_checksum: verdict != Verdict::NoChecksum, ..self }
    }

    /// Whether a frame is a whole answer without a checksum to this request, which has one.
    #[inline]
    pub fn is_answered_bare(&self, verdict: Verdict, mode: Mode, (direction, unit): (Direction, Option<u8>)) -> bool {
        let is_bare = verdict == Verdict::NoChecksum && mode == Mode::Rtu && direction == Direction::Response;
        is_bare && self.has_checksum && self.direction == Direction::Request && self.unit == unit
    }

    /// The same, with the line or packet of its last byte, where that counts.
    #[inline]
    pub fn at(self, origin: u64, side: Option<Side>) -> Self {
        let counts = self.mode == Mode::Tcp || side.is_some();
        Self { origin: if counts { origin } else { 0 }, ..self.in_line(origin, side) }
    }

    /// The same with the line of a request, and who sent it.
    #[inline]
    fn in_line(self, line: u64, side: Option<Side>) -> Self {
        if self.direction == Direction::Request {
            Self { line, side, ..self }
        } else {
            self
        }
    }

    /// Whether this frame in another framing is the answer to it, or asks something else. The log of a gateway has both framings,
    /// too, and prints each message in the one and then in the other.
    pub fn is_followed_in_another_framing(&self, next: &FrameObservation) -> bool {
        let is_same = (self.unit, self.function) == (next.unit, next.code.map(|code| code & !EXCEPTION_BIT));
        let is_answer = self.direction == Direction::Request && next.direction == Direction::Response && is_same;
        self.mode != next.mode && (is_answer || (next.direction == Direction::Request && !is_same))
    }

    /// Whether it belongs to a write, or follows one.
    #[inline]
    pub fn is_behind_write(&self) -> bool {
        self.since_write <= WRITE_FRAMES
    }

    /// The write that it belongs to, or follows, where it is known which.
    #[inline]
    pub fn write(&self) -> Option<WriteKey> {
        self.write.filter(|_| self.is_behind_write())
    }
}
