//! Exchanges whose request and response came in a message each (`messages`): what is kept of a run of them until its end.

use crate::fast_path::OpenRequests;
use crate::framer::Framer;
use crate::records::InnerPauses;
use crate::session::bus::{BusState, FROM_SERVER};
use crate::session::exchanges::matching::RtuRun;
use crate::session::exchanges::run::{ExchangeEnd, Form, Run};
use crate::session::frame_timing::FrameTiming;
use crate::session::line::LineState;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::{MAX_LENGTH_FIELD, PREFIX_BYTES as MBAP_PREFIX_BYTES};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};

/// The longest message (messaging on TCP/IP, 3.1.3), which is longer than any frame of a serial line.
const MAX_MESSAGE_BYTES: usize = MBAP_PREFIX_BYTES + MAX_LENGTH_FIELD;

/// A packet of a connection or a line of a log.
#[derive(Clone, Copy)]
pub(super) struct Message<'a> {
    pub bytes: &'a [u8],
    pub time: Ns,
    /// Number of the packet or line.
    pub number: u64,
    pub side: Option<Side>,
}

/// A run of exchanges in a message each. The lines of the bus are brought up to date at its end (`leave`).
pub(crate) struct MessageRun {
    /// Index of the bus.
    pub(super) bus: usize,
    /// Client and server of a connection, whose messages have an MBAP header; else both are the only line, and the second is unused.
    pub(super) sides: [MessageSide; 2],
    pub(super) is_connection: bool,
    pub(super) run: Run,
    pub(super) rtu: RtuRun,
    /// Requests that are outstanding beside them, and the time within which responses have to come.
    pub(super) open: OpenRequests,
    pub(super) request: PendingRequest,
    /// Time of the newest bytes, those of the pending request left out.
    pub(super) newest: Option<Ns>,
    /// Where its last exchange ends.
    pub(super) end: ExchangeEnd,
}

/// A sender, whose messages are taken without its line.
pub(super) struct MessageSide {
    /// Index of its line.
    line: usize,
    /// Stream offset after its last message.
    offset: u64,
    /// Time of its last message.
    pub(super) last: Option<Ns>,
    /// End of the last frame that was emitted.
    last_end: Option<Ns>,
    char_ns: Ns,
    /// So long a silence ends a frame.
    break_ns: Ns,
    /// Bytes of its longest message.
    longest: usize,
}

impl MessageRun {
    /// Returns a run on a connection, of compact exchanges or of rows, that may begin with a request of this time; `asked` is its
    /// unit and PDU, if it is plain and whole. `None` if it may be a retry, if anything on the bus is undecided, or if that is no
    /// connection with a clock.
    pub(super) fn on_connection(
        bus: usize,
        state: &mut BusState,
        form: Form,
        (asked, time): (Option<&[u8]>, Ns),
    ) -> Option<Self> {
        let [(first, _), _] = &state.lines[..] else { return None };
        let server_first = usize::from(*first == FROM_SERVER);
        // The times of a side are those of packets, which take none themselves.
        let is_ready = |line: &LineState| line.input.char_ns.is_none() && takes_messages(line, Mode::Tcp);
        let is_ready = state.lines.iter().all(|(_, line)| is_ready(line)) && state.pairing.is_idle_but_for_requests();
        if state.clock_jumped || !is_ready || state.latest.is_some_and(|latest| time <= latest) {
            return None;
        }
        let run = Run { form, ..Run::new(state, server_first) };
        if !run.has_clock() || !state.pairing.let_pass(asked, time) {
            return None;
        }
        let sides = [server_first, 1 - server_first].map(|line| MessageSide::of(line, &state.lines[line].1));
        let (open, newest) = (state.pairing.open_requests()?.passed(), state.latest);
        let (rtu, request) = (RtuRun::default(), PendingRequest::default());
        Some(Self { bus, sides, is_connection: true, run, rtu, open, request, newest, end: ExchangeEnd::default() })
    }

    /// Returns a run on the only line of a log, on which nothing is undecided; `None` if something is, or without a clock.
    pub(super) fn on_line(bus: usize, state: &mut BusState, form: Form) -> Option<Self> {
        let is_only_line = matches!(&state.lines[..], [(0, line)] if takes_messages(line, Mode::Rtu));
        if !is_only_line || state.clock_jumped || !state.pairing.is_idle() || state.options.silence_rule().is_some() {
            return None;
        }
        let run = Some(Run { form, ..Run::new(state, 0) }).filter(Run::has_clock)?;
        let (open, newest) = (state.pairing.open_requests()?, state.newest);
        let line = &mut state.lines[0].1;
        let rtu = RtuRun::after(line.framer.rtu_mut());
        let sides = [0; 2].map(|_| MessageSide { break_ns: Ns::MAX, ..MessageSide::of(0, line) });
        let (request, end) = (PendingRequest::default(), ExchangeEnd::default());
        Some(Self { bus, sides, is_connection: false, run, rtu, open, request, newest, end })
    }

    /// Returns whether it has to end before a request of the client with this time: its pending request has no response, or an
    /// outstanding one times out. It goes on where the clock goes back: that is for the slow path.
    #[inline]
    pub(super) fn ends_before_request_at(&self, time: Ns) -> bool {
        let is_last = Some(time) > self.newest && (self.request.is_none() || time > self.request.time);
        is_last && (!self.request.is_none() || time >= self.open.times_out)
    }

    /// Returns whether a request with this time is after all bytes before it: on a connection later, in a log not earlier. All of
    /// them are framed, so that a silence before it ends nothing.
    #[inline]
    pub(super) fn takes_request_at(&self, time: Ns) -> bool {
        self.newest.is_none_or(|newest| time - newest >= Ns::from(self.is_connection))
    }

    /// Returns whether the response to a request may have come at the second of these times, if the request came at the first:
    /// after it, within its timeout, and not after a silence that would have ended the request.
    #[inline]
    pub(super) fn takes_response_at(&self, [requested_at, time]: [Ns; 2]) -> bool {
        let waited = time - requested_at;
        waited >= Ns::from(self.is_connection) && waited < self.open.request_timeout && waited < self.sides[0].break_ns
    }

    /// Returns whether the pending request may be given up by now.
    pub(crate) fn is_due(&self, now: Ns) -> bool {
        !self.request.is_none() && now - self.request.time >= self.open.request_timeout
    }

    /// Takes the two messages of an exchange; returns when and where they were, as `FrameTiming::of_timed_read` has it.
    #[inline]
    pub(super) fn pass(&mut self, messages: &[Message<'_>; 2]) -> [FrameTiming; 2] {
        self.newest = Some(messages[1].time);
        let request = self.sides[0].pass(&messages[0], &self.run);
        [request, self.sides[usize::from(self.is_connection)].pass(&messages[1], &self.run)]
    }

    /// Leaves the lines of the bus as if the messages of all exchanges had come and been consumed.
    pub(super) fn leave(&self, state: &mut BusState) {
        for side in &self.sides {
            let line = &mut state.lines[side.line].1;
            let Some(time) = side.last.filter(|_| side.offset > line.input.offset()) else { continue };
            line.input.pass(side.offset, time, side.longest);
            line.last_end = Some(time);
        }
        (state.newest, state.latest) = (self.newest, state.latest.max(self.newest));
    }
}

/// Returns whether the framer of a line, of this framing, holds nothing back, and messages may be taken without it.
fn takes_messages(line: &LineState, mode: Mode) -> bool {
    line.input.takes_messages() && line.is_settled() && line.framer.mode() == mode
}

impl MessageSide {
    fn of(line: usize, state: &LineState) -> Self {
        let input = &state.input;
        let (offset, last, break_ns) = (input.offset(), input.last_byte_time(), input.break_ns);
        Self { line, offset, last, last_end: state.last_end, char_ns: input.char_ns.unwrap_or(0), break_ns, longest: 0 }
    }

    /// Takes messages of so many bytes in all and in the longest of them, of which the last has this time.
    #[inline]
    pub(super) fn add(&mut self, bytes: usize, longest: usize, time: Ns) {
        self.offset += bytes as u64;
        (self.last, self.last_end) = (Some(time), Some(time));
        self.longest = self.longest.max(longest);
    }

    /// Takes the side's next message; returns when and where it was.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
    fn pass(&mut self, message: &Message<'_>, run: &Run) -> FrameTiming {
        let started_at = message.time - message.bytes.len() as Ns * self.char_ns;
        let timing = FrameTiming {
            start: Some(self.last_end.map_or(started_at, |last| started_at.max(last))),
            end: Some(message.time),
            gap: self.last.and_then(|last| run.measurable_gap(started_at - last)),
            pauses: InnerPauses::default(),
            clean_start: true,
            side: message.side,
            offset: self.offset,
            origin: message.number,
            last_origin: message.number,
        };
        self.add(message.bytes.len(), message.bytes.len(), message.time);
        timing
    }
}

/// A request whose response is still to come, if there is one.
#[derive(Default)]
pub(super) struct PendingRequest {
    /// None without a request.
    pub bytes: Vec<u8>,
    pub time: Ns,
    /// Its chunk, but for the bytes and the time.
    pub chunk: Chunk<'static>,
}

impl PendingRequest {
    #[inline]
    pub fn is_none(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Takes the chunk of a request. `false` if there is one already, or if it is longer than a message.
    #[inline]
    pub fn take(&mut self, chunk: &Chunk<'_>, time: Ns) -> bool {
        let is_possible = self.is_none() && chunk.bytes.len() <= MAX_MESSAGE_BYTES;
        if is_possible {
            self.bytes.extend_from_slice(chunk.bytes);
            self.time = time;
            let Chunk { line, side, starts_record, proven_framing, origin, .. } = *chunk;
            self.chunk = Chunk { line, side, starts_record, proven_framing, origin, ..Chunk::default() };
        }
        is_possible
    }

    /// Returns it as it came.
    pub fn as_chunk(&self) -> Chunk<'_> {
        Chunk { bytes: &self.bytes, times: Times::Read(self.time), ..self.chunk }
    }
}

/// How long lines of a log take the slow path before a run is tried again: to begin one, what waits has to be decided, which is
/// cheaper for many lines at once where none can begin.
#[derive(Default)]
pub(crate) struct MessageTries {
    /// Runs since the last exchange that could not begin, or had none.
    failures: u32,
    /// Lines that came since the last try while others were undecided.
    lines: u32,
}

impl MessageTries {
    /// Counts a line in front of which others are undecided; whether a run should be tried with it. After two failures it is
    /// tried after an odd number of lines, which is a request next time if it was a response.
    pub(super) fn is_due(&mut self) -> bool {
        self.lines += 1;
        let least = if self.failures < 2 { 1 } else { (1 << (self.failures - 2).min(6)) + 1 };
        self.lines >= least
    }

    pub(super) fn note_run(&mut self, exchanges: u64) {
        (self.failures, self.lines) = (if exchanges > 0 { 0 } else { self.failures + 1 }, 0);
    }
}
