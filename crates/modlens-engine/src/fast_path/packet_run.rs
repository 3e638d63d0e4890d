//! Exchanges of one connection that are matched in their packets (`packet_pairs`), one behind the other, and what of them is
//! learned once a run.

use crate::fast_path::pairing::OpenRequests;
use crate::fast_path::run::Run;
use crate::framer::Framer;
use crate::records::{Batch, InnerPauses, Span};
use crate::session::bus::{BusState, FROM_SERVER};
use crate::session::frame_timing::FrameTiming;
use crate::session::line::LineState;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::{MAX_LENGTH_FIELD, PREFIX_BYTES as MBAP_PREFIX_BYTES};
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// The longest message (messaging on TCP/IP, 3.1.3).
const MAX_MESSAGE_BYTES: usize = MBAP_PREFIX_BYTES + MAX_LENGTH_FIELD;

/// A run of such exchanges. The lines of the connection are brought up to date at its end (`leave`).
pub(crate) struct PacketRun {
    /// Index of the bus.
    pub bus: usize,
    /// The client and the server.
    pub(super) sides: [PacketSide; 2],
    pub(super) run: Run,
    /// Requests that are outstanding beside them.
    pub(super) open: OpenRequests,
    /// Responses have to come within this time.
    pub(super) request_timeout: Ns,
    pub(super) request: RequestInHand,
    /// Time of the newest bytes, those of the request in hand left out.
    pub(super) latest: Option<Ns>,
    /// Time of the first request.
    pub(super) first: Option<Ns>,
    /// Where the last response is in the arena, without its MBAP header.
    pub(super) last_response: Option<Span>,
}

/// A side of the connection, whose packets are taken without its line.
pub(super) struct PacketSide {
    /// Index of its line.
    pub line: usize,
    /// Stream offset behind its last packet.
    offset: u64,
    /// Time of its last packet.
    last: Option<Ns>,
    /// So long a silence ends a frame.
    break_ns: Ns,
    /// Bytes of its longest packet.
    longest: usize,
}

impl PacketRun {
    /// A run on this bus, of compact exchanges or of rows; `None` if anything on it is undecided, or if it is no connection with
    /// a clock.
    pub(super) fn begin(bus: usize, state: &mut BusState, is_compact: bool) -> Option<Self> {
        // The times of a run (`PacketSide`) are those of packets, which take none themselves.
        let is_ready = |(_, line): &(u8, LineState)| {
            let takes_packets = line.input.takes_packets() && line.input.char_ns.is_none();
            takes_packets && line.is_settled() && line.framer.mode() == Mode::Tcp
        };
        let [(first, _), _] = &state.lines[..] else { return None };
        let server_first = usize::from(*first == FROM_SERVER);
        if state.clock_jumped || !state.pairing.is_idle_but_for_open() || !state.lines.iter().all(is_ready) {
            return None;
        }
        let run = Run { is_compact, ..Run::new(state, server_first) };
        let open = state.pairing.open_requests().filter(|_| run.has_clock())?;
        Some(Self {
            bus,
            sides: [server_first, 1 - server_first].map(|line| PacketSide::of(line, &state.lines[line].1)),
            run,
            open,
            request_timeout: state.pairing.request_timeout(true),
            request: RequestInHand::default(),
            latest: state.latest,
            first: None,
            last_response: None,
        })
    }

    /// Whether a time is behind that of all bytes of the connection, and not behind a silence that would end a frame of either
    /// side (`BusState::is_in_order`).
    #[inline]
    pub(super) fn is_in_order(&self, time: Ns) -> bool {
        let is_silent = |side: &PacketSide| side.last.is_some_and(|last| time - last >= side.break_ns);
        Some(time) > self.latest && !self.sides.iter().any(is_silent)
    }

    /// Whether the request in hand may be given up by now.
    pub(crate) fn is_due(&self, now: Ns) -> bool {
        self.request.length > 0 && now - self.request.time >= self.request_timeout
    }

    /// Notes an exchange of packets with these lengths and times, of which the response is at this place in the arena.
    #[inline]
    pub(super) fn pass(&mut self, lengths: [usize; 2], times: [Ns; 2], response: u32) {
        for (side, (length, time)) in self.sides.iter_mut().zip(lengths.into_iter().zip(times)) {
            side.offset += length as u64;
            side.last = Some(time);
            side.longest = side.longest.max(length);
        }
        self.first = self.first.or(Some(times[0]));
        self.latest = Some(times[1]);
        let prefix = MBAP_PREFIX_BYTES as u32;
        self.last_response = Some(Span { start: response + prefix, length: lengths[1] as u32 - prefix });
        self.request.clear();
    }

    /// Leaves the lines of the bus as if the packets of all exchanges had come and been consumed.
    pub(super) fn leave(&self, state: &mut BusState) {
        for side in &self.sides {
            let line = &mut state.lines[side.line].1;
            let Some(time) = side.last.filter(|_| side.offset > line.input.offset()) else { continue };
            line.input.pass(side.offset, time, side.longest);
            line.last_end = Some(time);
        }
        (state.newest, state.latest) = (self.latest, self.latest);
    }
}

impl PacketSide {
    fn of(line: usize, state: &LineState) -> Self {
        let input = &state.input;
        let (offset, last, break_ns) = (input.offset(), input.last_byte_time(), input.break_ns);
        Self { line, offset, last, break_ns, longest: 0 }
    }

    /// The silence before the side's next packet, which has this time, if the clock can measure it.
    #[inline]
    pub(super) fn gap(&self, time: Ns, resolution: Ns) -> Option<Ns> {
        let gap = time - self.last?;
        (gap >= 2 * resolution && gap > 0).then_some(gap)
    }

    /// When and where the side's next packet is, of this time and number: as `FrameTiming::of_timed_read` has it.
    pub(super) fn timing(&self, time: Ns, packet: u64, side: Side, run: &Run) -> FrameTiming {
        FrameTiming {
            start: Some(time),
            end: Some(time),
            gap: self.gap(time, run.config.resolution),
            pauses: InnerPauses::default(),
            clean_start: true,
            side: Some(side),
            offset: self.offset,
            origin: packet,
            last_origin: packet,
        }
    }
}

/// A request whose response is still to come, if there is one. Its bytes are the last ones in the arena, where they stay if it
/// is answered.
#[derive(Default)]
pub(super) struct RequestInHand {
    start: u32,
    /// 0 without a request.
    length: u32,
    pub time: Ns,
    /// Number of its packet.
    pub packet: u64,
}

impl RequestInHand {
    /// Takes the packet of a request. `false` if there is one already, or if the packet is longer than a message.
    #[inline]
    pub fn take(&mut self, batch: &mut Batch, bytes: &[u8], time: Ns, packet: u64) -> bool {
        let is_possible = self.length == 0 && bytes.len() <= MAX_MESSAGE_BYTES;
        if is_possible {
            let Span { start, length } = batch.store(bytes);
            *self = Self { start, length, time, packet };
        }
        is_possible
    }

    /// Where its bytes are; none without a request.
    #[inline]
    pub fn place(&self) -> Span {
        Span { start: self.start, length: self.length }
    }

    /// Takes its bytes back from the arena, where nothing stands behind them.
    pub fn take_back(&self, batch: &mut Batch) -> Vec<u8> {
        if self.length == 0 {
            return Vec::new();
        }
        batch.arena.split_off(self.start as usize)
    }

    /// Leaves none.
    #[inline]
    fn clear(&mut self) {
        self.length = 0;
    }
}
