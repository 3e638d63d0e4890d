//! The fast path on a TCP connection whose requests and responses come one behind the other, in a packet each: they are matched as
//! they come, without the inputs and reads of their lines.
//!
//! A request is kept in hand until the next packet of its connection. If that is its response, the exchange is emitted as
//! `tcp_batch` emits one at the heads of the lines, and both lines are left as if the packets had come and been consumed. In
//! any other case both take the general way, in their order, as does all of a connection on which something is undecided. That
//! a packet is decided earlier than there changes nothing: a block of the capture may end behind any packet.

use crate::fast_path::emit::{pass, ExchangePlaces};
use crate::fast_path::packet_run::{PacketRun, RequestInHand};
use crate::fast_path::run::Run;
use crate::fast_path::tcp_batch::{match_packets, KnownOfBus, LENGTH_AT};
use crate::framer::Framer;
use crate::input::{Input, Read};
use crate::records::Span;
use crate::session::bus::{BusState, FROM_SERVER};
use crate::session::line::LineState;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;
use modlens_readers::pcap::StreamChunk;

/// The lines of the client and of the server, if nothing on this bus is undecided and its next packets may be matched in pairs.
fn lines_of_pairs(state: &BusState) -> Option<[usize; 2]> {
    let is_ready =
        |(_, line): &(u8, LineState)| line.input.takes_packets() && line.is_settled() && line.framer.mode() == Mode::Tcp;
    let [(first, _), _] = &state.lines[..] else { return None };
    let is_open = !state.clock_jumped && state.pairing.is_idle_but_for_open();
    let server_first = usize::from(*first == FROM_SERVER);
    (is_open && state.lines.iter().all(is_ready)).then_some([server_first, 1 - server_first])
}

/// A packet, or a line of a log, as the read of its line that it would become.
#[inline]
pub(super) fn read_of(input: &Input, length: usize, time: Ns, origin: u64, side: Option<Side>) -> Read {
    Read {
        end: input.offset() + length as u64,
        time,
        origin,
        side,
        starts_record: false,
        has_line_error: false,
        lacks_checksum: false,
        proven_framing: None,
    }
}

impl Session {
    /// Takes a packet of a connection if it is a request to be kept in hand, or the response to the one in hand. `false`, with
    /// nothing changed, if it is neither: then it has to be fed, behind the request in hand (`end_packet_run`).
    #[inline]
    pub(crate) fn take_packet(&mut self, bus: usize, from_client: bool, packet: &StreamChunk<'_>) -> bool {
        let Some(time) = packet.time.filter(|_| packet.missing == 0) else { return false };
        if self.packet_run.as_ref().is_none_or(|run| run.bus != bus) && !(from_client && self.begin_packet_run(bus)) {
            return false;
        }
        if !self.buses[bus].is_in_order(time) {
            return false;
        }
        if !from_client {
            return self.take_response(packet.bytes, time, packet.packet);
        }
        self.packet_run.as_mut().is_some_and(|run| run.request.take(packet.bytes, time, packet.packet))
    }

    /// Whether packets of this bus may be matched as they come, as soon as nothing on it is undecided: it is a connection in a
    /// recording, whose client speaks Modbus/TCP.
    #[inline]
    pub(crate) fn may_match_packets(&self, bus: usize) -> bool {
        let options = &self.buses[bus].options;
        !self.live && options.bus.network.is_some() && options.mode == Some(Mode::Tcp)
    }

    /// Begins a run on this bus, if nothing on it is undecided; that of another bus ends.
    #[cold]
    fn begin_packet_run(&mut self, bus: usize) -> bool {
        if !self.may_match_packets(bus) || self.waiting == Some(bus) {
            return false;
        }
        self.decide_waiting();
        let state = &mut self.buses[bus];
        let Some(lines) = lines_of_pairs(state) else { return false };
        let mut run = Run::new(state, lines[0]);
        let Some(open) = state.pairing.open_requests().filter(|_| run.has_clock()) else { return false };
        let request_timeout = state.pairing.request_timeout(true);
        run.is_compact = self.emits_compact_packets(bus);
        let request = RequestInHand::default();
        self.packet_run = Some(Box::new(PacketRun { bus, lines, run, open, request_timeout, request, last_response: None }));
        true
    }

    /// Emits the exchange of the request in hand and this packet of the server, if they are one without a doubt.
    #[inline]
    fn take_response(&mut self, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let Some(mut current) = self.packet_run.take() else { return false };
        let is_taken = self.match_pair(&mut current, answered, answered_at, packet);
        self.packet_run = Some(current);
        is_taken
    }

    #[inline(always)]
    #[allow(clippy::inline_always)] // Called once.
    fn match_pair(&mut self, current: &mut PacketRun, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let PacketRun { bus, lines, run, open, request_timeout, request, last_response } = current;
        let (asked, times) = (request.bytes(), [request.time, answered_at]);
        let state = &mut self.buses[*bus];
        let known =
            KnownOfBus { reads: &state.known_reads, profiles: &mut state.profiles, open, request_timeout: *request_timeout };
        let Some(matched) = match_packets(&self.functions, known, [asked, answered], times, *lines) else { return false };
        state.connection.note_exchange(self.next_txn, matched.mbap_id, times, &state.pairing);
        let wires = [self.batch.store(asked), self.batch.store(answered)];
        let mut passed = |line: usize, length: usize, time: Ns, packet: u64, side: Side| {
            let line = &mut state.lines[line].1;
            let read = read_of(&line.input, length, time, packet, Some(side));
            pass(line, &read, length, run)
        };
        let timings = [
            passed(lines[0], asked.len(), times[0], request.packet, Side::Sent),
            passed(lines[1], answered.len(), times[1], packet, Side::Received),
        ];
        (state.newest, state.latest) = (Some(answered_at), Some(answered_at));
        self.emit_timed(*bus, &matched, &ExchangePlaces { wires, pdus: None }, timings, run);
        if matched.counters.is_none() {
            let state = &mut self.buses[*bus];
            state.known_reads.keep(&mut self.stats, state.counts, &asked[LENGTH_AT..], &matched.expected);
        }
        let prefix = MBAP_PREFIX_BYTES as u32;
        *last_response = Some(Span { start: wires[1].start + prefix, length: wires[1].length - prefix });
        request.clear();
        true
    }

    /// Ends the run of exchanges that are matched in their packets, if there is one: its bus is brought up to date, and the
    /// request in hand, which has no response here, takes the general way.
    pub(crate) fn end_packet_run(&mut self) {
        let Some(ended) = self.packet_run.take() else { return };
        let state = &mut self.buses[ended.bus];
        if let Some(response) = ended.last_response.map(|place| place.of(&self.batch.arena)) {
            self.stats.record_batch(state.counts, Mode::Tcp, ended.run.totals.exchanges, ended.run.totals.bytes as u64);
            state.pairing.sync_after_batch(response[0], &response[1..]);
            self.decide(ended.bus, self.buses[ended.bus].newest);
        }
        if !ended.request.bytes().is_empty() {
            let RequestInHand { time, packet, .. } = ended.request;
            let bytes = ended.request.bytes();
            self.feed_stream(
                ended.bus,
                true,
                &StreamChunk { side: 0, bytes, packet, time: Some(time), missing: 0, cut: false },
                false,
            );
        }
    }
}
