//! Exchanges of one connection that are matched in their packets (`packet_pairs`), one after the other, and what of them is
//! learned once a run.

use crate::fast_path::OpenRequests;
use crate::framer::Framer;
use crate::records::{InnerPauses, Span};
use crate::session::bus::{BusState, FROM_SERVER};
use crate::session::exchanges::run::Run;
use crate::session::frame_timing::FrameTiming;
use crate::session::line::LineState;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::{MAX_LENGTH_FIELD, PREFIX_BYTES as MBAP_PREFIX_BYTES};
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;
use modlens_readers::pcap::StreamChunk;

/// The longest message (messaging on TCP/IP, 3.1.3).
const MAX_MESSAGE_BYTES: usize = MBAP_PREFIX_BYTES + MAX_LENGTH_FIELD;

/// A run of such exchanges. The lines of the connection are brought up to date at its end (`leave`).
pub(crate) struct PacketRun {
    /// Index of the bus.
    pub bus: usize,
    /// The client and the server.
    pub(super) sides: [PacketSide; 2],
    pub(super) run: Run,
    /// Requests that are outstanding beside them, and the time within which responses have to come.
    pub(super) open: OpenRequests,
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
    /// Stream offset after its last packet.
    offset: u64,
    /// Time of its last packet.
    pub(super) last: Option<Ns>,
    /// So long a silence ends a frame.
    break_ns: Ns,
    /// Bytes of its longest packet.
    longest: usize,
}

impl PacketRun {
    /// Returns a run on this bus, of compact exchanges or of rows, that may begin with a request of this time; `asked` is its unit
    /// and PDU, if it is plain and whole. `None` if it may be a retry, if anything on the bus is undecided, or if that is no
    /// connection with a clock.
    pub(super) fn begin(bus: usize, state: &mut BusState, is_compact: bool, (asked, time): (Option<&[u8]>, Ns)) -> Option<Self> {
        // The times of a run (`PacketSide`) are those of packets, which take none themselves.
        let is_ready = |(_, line): &(u8, LineState)| {
            let takes_packets = line.input.takes_packets() && line.input.char_ns.is_none();
            takes_packets && line.is_settled() && line.framer.mode() == Mode::Tcp
        };
        let [(first, _), _] = &state.lines[..] else { return None };
        let server_first = usize::from(*first == FROM_SERVER);
        let is_ready = state.pairing.is_idle_but_for_requests() && state.lines.iter().all(is_ready);
        if state.clock_jumped || !is_ready || state.latest.is_some_and(|latest| time <= latest) {
            return None;
        }
        let run = Run { is_compact, ..Run::new(state, server_first) };
        if !run.has_clock() || !state.pairing.let_pass(asked, time) {
            return None;
        }
        Some(Self {
            bus,
            sides: [server_first, 1 - server_first].map(|line| PacketSide::of(line, &state.lines[line].1)),
            run,
            open: state.pairing.open_requests()?.passed(),
            request: RequestInHand::default(),
            latest: state.latest,
            first: None,
            last_response: None,
        })
    }

    /// Returns whether it has to end before a request of the client with this time: its request in hand has no response, or an
    /// outstanding one times out. It goes on where the clock goes back: that is for the general way.
    #[inline]
    pub(super) fn ends_before_request_at(&self, time: Ns) -> bool {
        let is_last = Some(time) > self.latest && (self.request.is_none() || time > self.request.time);
        is_last && (!self.request.is_none() || time >= self.open.times_out)
    }

    /// Returns whether a packet of the client with this time is after all bytes of the connection. All of them are framed, so that
    /// a silence before it ends nothing.
    #[inline]
    pub(super) fn takes_request_at(&self, time: Ns) -> bool {
        Some(time) > self.latest
    }

    /// Returns whether the response to a request may have come at the second of these times, if the request came at the first:
    /// after it, within its time-out, and not after a silence that would have ended the request.
    #[inline]
    pub(super) fn takes_response_at(&self, [requested_at, time]: [Ns; 2]) -> bool {
        let waited = time - requested_at;
        waited > 0 && waited < self.open.request_timeout && waited < self.sides[0].break_ns
    }

    /// Returns whether the request in hand may be given up by now.
    pub(crate) fn is_due(&self, now: Ns) -> bool {
        !self.request.is_none() && now - self.request.time >= self.open.request_timeout
    }

    /// Notes exchanges: how many bytes each side has sent, and in its longest packet; the times of the last one, and where its
    /// response is in the arena.
    #[inline]
    pub(super) fn pass(&mut self, (bytes, longest): ([usize; 2], [usize; 2]), times: [Ns; 2], response: Span) {
        for (at, side) in self.sides.iter_mut().enumerate() {
            side.offset += bytes[at] as u64;
            side.last = Some(times[at]);
            side.longest = side.longest.max(longest[at]);
        }
        self.first = self.first.or(Some(times[0]));
        self.latest = Some(times[1]);
        let prefix = MBAP_PREFIX_BYTES as u32;
        self.last_response = Some(Span { start: response.start + prefix, length: response.length - prefix });
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

    /// Returns the silence before the side's next packet, which has this time, if the clock can measure it.
    #[inline]
    pub(super) fn gap(&self, time: Ns, run: &Run) -> Option<Ns> {
        run.measurable_gap(time - self.last?)
    }

    /// When and where the side's next packet is, of this time and number: as `FrameTiming::of_timed_read` has it.
    pub(super) fn timing(&self, time: Ns, packet: u64, side: Side, run: &Run) -> FrameTiming {
        FrameTiming {
            start: Some(time),
            end: Some(time),
            gap: self.gap(time, run),
            pauses: InnerPauses::default(),
            clean_start: true,
            side: Some(side),
            offset: self.offset,
            origin: packet,
            last_origin: packet,
        }
    }
}

/// A request whose response is still to come, if there is one.
#[derive(Default)]
pub(super) struct RequestInHand {
    /// None without a request.
    pub bytes: Vec<u8>,
    pub time: Ns,
    /// Number of its packet.
    pub packet: u64,
}

impl RequestInHand {
    #[inline]
    pub fn is_none(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Takes the packet of a request. `false` if there is one already, or if the packet is longer than a message.
    #[inline]
    pub fn take(&mut self, packet: &StreamChunk<'_>, time: Ns) -> bool {
        let is_possible = self.is_none() && packet.bytes.len() <= MAX_MESSAGE_BYTES;
        if is_possible {
            self.bytes.extend_from_slice(packet.bytes);
            (self.time, self.packet) = (time, packet.packet);
        }
        is_possible
    }
}
