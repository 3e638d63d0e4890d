//! When a frame was on the line, and where it stands in its recording.

use crate::input::Input;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// What the times of a frame depend on beside its reads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    /// The bus has a clock.
    pub clocked: bool,
    /// What it can tell apart.
    pub resolution: Ns,
    /// What `origin` counts.
    pub place: Place,
    /// Framing.
    pub mode: Mode,
    /// The clock went back with these reads.
    pub jumped: bool,
    /// End of what was told last on this line.
    pub last_end: Option<Ns>,
}

/// When a frame was on the line, and where it stands in its recording.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
    /// Silence before it.
    pub gap: Option<Ns>,
    /// Whether its start is as exact as the clock.
    pub clean_start: bool,
    /// Who sent it, where the recording says so.
    pub side: Option<Side>,
    /// Stream offset of its first byte.
    pub offset: u64,
    /// Line or packet number, or the stream offset.
    pub origin: u64,
    /// That of its last byte.
    pub last_origin: u64,
}

impl Moment {
    /// Start and end.
    pub(super) fn span(&self) -> Option<(Ns, Ns)> {
        self.start.zip(self.end)
    }

    /// Notes the packets that hold neither the first nor the last byte of frame `number`, where it came in more than two.
    #[inline]
    pub(super) fn between(&self, input: &Input, (number, length): (u64, usize), place: Place, to: &mut Vec<(u64, u64)>) {
        if place == Place::Packet && self.last_origin != self.origin {
            to.extend(input.between(length).map(|packet| (number, packet)));
        }
    }

    /// Of the first `length` bytes of the input.
    #[inline(always)]
    #[allow(clippy::inline_always)] // What it gives is large, and mostly empty: without a clock nothing of it is made.
    pub(super) fn of(input: &Input, length: usize, setting: &Setting) -> Self {
        let clocked = setting.clocked && input.timed;
        let time_of = |index: usize| if clocked { input.byte_time(index) } else { None };
        let first = time_of(0).map(|ns| ns - input.char_ns.unwrap_or(0));
        // The estimate goes back from the read's time; it cannot lie before what was already on the line.
        let start = first.map(|ns| if setting.jumped { ns } else { setting.last_end.map_or(ns, |last| ns.max(last)) });
        // All messages of a packet came when it came.
        let clean_start = setting.mode == Mode::Tcp || input.starts_read(0);
        let gap = if clocked && clean_start { input.pause_before(0) } else { None };
        let (read_origin, side) = input.first_read().map_or((0, None), |read| (read.origin, read.side));
        let offset = input.offset();
        let by_offset = setting.place == Place::Offset;
        Self {
            start,
            end: time_of(length - 1),
            gap: gap.filter(|&gap| gap >= 2 * setting.resolution && gap > 0),
            clean_start,
            side,
            offset,
            origin: if by_offset { offset } else { read_origin },
            last_origin: if by_offset { offset } else { input.read(length - 1).map_or(0, |read| read.origin) },
        }
    }
}
