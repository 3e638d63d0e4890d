//! The times of a frame, and its place in the recording.

use crate::input::{Input, Read, NO_TIME};
use crate::records::InnerPauses;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// Bytes that arrived so long before the end of the frame in front of them show that the clock has jumped since. Times counted
/// back inside a read differ by far less.
const MIN_JUMP: Ns = 1_000_000_000;

/// The parameters from which the times of a frame are computed, beside the reads that it came in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimingConfig {
    /// The bus has a clock.
    pub has_clock: bool,
    /// The step of the clock; a silence is reported from twice this on.
    pub resolution: Ns,
    /// The unit of `origin`: offsets, lines or packets.
    pub place: Place,
    /// Framing.
    pub mode: Mode,
    /// The clock went back with these reads, so that `last_end` says nothing about them.
    pub clock_jumped: bool,
    /// End of the last frame that was emitted on this line.
    pub last_end: Option<Ns>,
}

/// When a frame was on the line, and its place in the recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameTiming {
    /// Start of the first character.
    pub start: Option<Ns>,
    /// End of the last character.
    pub end: Option<Ns>,
    /// Silence before the frame.
    pub gap: Option<Ns>,
    /// Silences inside the frame.
    pub pauses: InnerPauses,
    /// Whether `start` is as exact as the clock: the frame begins with a read.
    pub clean_start: bool,
    /// The recording's word for who sent it.
    pub side: Option<Side>,
    /// Stream offset of its first byte.
    pub offset: u64,
    /// Line or packet number, or the stream offset.
    pub origin: u64,
    /// Line or packet number of its last byte, or the stream offset of its first.
    pub last_origin: u64,
}

impl FrameTiming {
    /// Start and end, where both are known.
    pub(crate) fn span(&self) -> Option<(Ns, Ns)> {
        self.start.zip(self.end)
    }

    /// Adds to `to`, each with `number`, the packets that hold neither the first nor the last byte of that frame. There are some
    /// where a frame came in more than two packets.
    #[inline]
    pub(crate) fn list_inner_packets(
        &self,
        input: &Input,
        (number, length): (u64, usize),
        place: Place,
        to: &mut Vec<(u64, u64)>,
    ) {
        if place == Place::Packet && self.last_origin != self.origin {
            to.extend(input.inner_read_origins(length).map(|packet| (number, packet)));
        }
    }

    /// The times in ns and the place of the first `length` bytes (at least one) of the input. Nothing is changed.
    ///
    /// Without a clock, `start`, `end` and `gap` are `None`. The start is one character before the time at which the first byte
    /// had arrived, or that time itself where the line settings are not known; but not before `last_end`, unless the clock
    /// jumped. `end` is the time at which the last byte had arrived, and not before the start. `gap` is also
    /// `None` at the first byte of all, where the frame begins inside a read (but not on TCP), below two steps of the clock, and
    /// at 0 or less.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large and mostly empty; inlined, the empty parts are never built.
    pub(crate) fn of(input: &Input, length: usize, setting: &TimingConfig) -> Self {
        if let Some(read) = input.whole_read(length) {
            return Self::of_read(input, read, length, setting);
        }
        let has_clock = setting.has_clock && input.has_times;
        let time_of = |index: usize| if has_clock { input.byte_time(index) } else { None };
        // The start is counted back from the time of the read. It cannot lie before the end of the frame before.
        let counted_back = time_of(0).map(|ns| ns - input.char_ns.unwrap_or(0));
        let arrival = time_of(length - 1);
        let earliest = setting.last_end.filter(|last| !setting.clock_jumped && arrival.is_none_or(|ns| ns + MIN_JUMP >= *last));
        let start = counted_back.map(|ns| earliest.map_or(ns, |last| ns.max(last)));
        // All messages in a TCP segment arrived with it.
        let clean_start = setting.mode == Mode::Tcp || input.starts_read(0);
        let gap = if has_clock && clean_start { input.pause_before(0) } else { None };
        let (read_origin, side) = input.first_read().map_or((0, None), |read| (read.origin, read.side));
        let offset = input.offset();
        let has_offsets = setting.place == Place::Offset;
        Self {
            start,
            // What a read brings back to back may be counted back further than the frame before had ended.
            end: arrival.map(|ns| start.filter(|_| !setting.clock_jumped).map_or(ns, |start| ns.max(start))),
            gap: gap.filter(|&gap| gap >= 2 * setting.resolution && gap > 0),
            pauses: if has_clock { input.pauses_inside(length) } else { InnerPauses::default() },
            clean_start,
            side,
            offset,
            origin: if has_offsets { offset } else { read_origin },
            last_origin: if has_offsets { offset } else { input.read(length - 1).map_or(0, |read| read.origin) },
        }
    }

    /// The same for a frame that is exactly the first read, as nearly all are that come in packets or in lines of a log.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn of_read(input: &Input, read: &Read, length: usize, setting: &TimingConfig) -> Self {
        if setting.has_clock && input.has_times && read.time != NO_TIME {
            return Self::of_timed_read(input, read, length, setting);
        }
        Self::without_times(input, read, setting)
    }

    /// The same for a read that has a time, where the bus has a clock.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub(crate) fn of_timed_read(input: &Input, read: &Read, length: usize, setting: &TimingConfig) -> Self {
        let counted_back = read.time - length as Ns * input.char_ns.unwrap_or(0);
        let earliest = setting.last_end.filter(|last| !setting.clock_jumped && read.time + MIN_JUMP >= *last);
        let gap = input.pause_before_read(read);
        Self {
            start: Some(earliest.map_or(counted_back, |last| counted_back.max(last))),
            end: Some(read.time),
            gap: gap.filter(|&gap| gap >= 2 * setting.resolution && gap > 0),
            ..Self::without_times(input, read, setting)
        }
    }

    /// The place of a frame that is exactly this read, the first one.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn without_times(input: &Input, read: &Read, setting: &TimingConfig) -> Self {
        let origin = if setting.place == Place::Offset { input.offset() } else { read.origin };
        Self {
            start: None,
            end: None,
            gap: None,
            pauses: InnerPauses::default(),
            clean_start: true,
            side: read.side,
            offset: input.offset(),
            origin,
            last_origin: origin,
        }
    }
}
