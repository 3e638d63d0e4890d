//! The fast path on a TCP connection whose requests and responses come one after the other, in a packet each: they are matched
//! as they come, without the inputs and reads of their lines.
//!
//! Where frames are not wanted, packets come many at once, and those that are pairs of a request and its response are matched where
//! they are (`match_pairs`). Any other request is kept in hand until the next packet of its connection. If that is its response,
//! the exchange is emitted as `tcp_batch` emits one at the heads of the lines; where exchanges are compact, a refusal is a
//! response, too. Once at the end of the run, both lines are left as if the packets had come and been consumed, and what is
//! counted is counted. In any other case both packets take the general way, in their order, as does all of a connection on which
//! something is undecided. That a packet is decided earlier than there changes nothing: a block of the capture may end after
//! any packet.

use crate::fast_path::request_memo::RequestMemo;
use crate::findings::{words, REFUSED};
use crate::records::PacketPair;
use crate::session::bus::{learn_sides, BusState};
use crate::session::exchanges::emit::ExchangePlaces;
use crate::session::exchanges::known_pairs::next_with_bytes;
use crate::session::exchanges::packet_run::{PacketRun, RequestInHand};
use crate::session::exchanges::rows::{confidence_by_id, MatchedExchange};
use crate::session::exchanges::tcp_batch::{match_packets, match_refusal, plain_request, ConnectionContext, LENGTH_AT};
use crate::session::held_exchanges::ExchangeStart;
use crate::session::rows::FindingPlace;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;
use modlens_readers::pcap::{PacketInTurn, StreamChunk};

impl Session {
    /// Takes a packet of a connection if it is a request to be kept in hand, or the response to the one in hand. `false` if it is
    /// neither: then it has to be fed, after the request in hand (`end_packet_run`). What a request finds without a response is
    /// decided before it.
    #[inline]
    pub(crate) fn take_packet(&mut self, bus: usize, from_client: bool, packet: &StreamChunk<'_>) -> bool {
        let Some(time) = packet.time.filter(|_| packet.missing == 0) else { return false };
        let run = self.packet_run.as_ref().filter(|run| run.bus == bus);
        if from_client && run.is_none_or(|run| run.ends_before_request_at(time)) {
            self.end_run_before_request(bus, time);
            if !self.begin_packet_run(bus, packet.bytes, time) {
                return false;
            }
        } else if run.is_none() {
            return false;
        }
        let Some(run) = self.packet_run.as_deref_mut() else { return false };
        if from_client {
            run.takes_request_at(time) && run.request.take(packet, time)
        } else if run.request.is_none() || !run.takes_response_at([run.request.time, time]) {
            false
        } else if run.run.is_compact {
            self.take_compact(packet, time)
        } else {
            self.take_rows(packet.bytes, time, packet.packet)
        }
    }

    /// Returns whether packets of this bus may be matched as they come, as soon as nothing on it is undecided: it is a connection
    /// in a recording, whose client speaks Modbus/TCP.
    #[inline]
    pub(crate) fn may_match_packets(&self, bus: usize) -> bool {
        let options = &self.buses[bus].options;
        !self.live && options.bus.network.is_some() && options.mode == Some(Mode::Tcp)
    }

    /// Ends the run of this bus, if there is one, before a request of this time: what is left without a response by then is
    /// decided as the general way decides it.
    #[cold]
    fn end_run_before_request(&mut self, bus: usize, time: Ns) {
        if self.packet_run.as_ref().is_some_and(|run| run.bus == bus) {
            self.decide_waiting();
            self.advance_pairing(bus, time);
        }
    }

    /// Begins a run on this bus with a request of these bytes and this time, if nothing on it is undecided; that of another bus
    /// ends.
    #[cold]
    fn begin_packet_run(&mut self, bus: usize, asked: &[u8], time: Ns) -> bool {
        if !self.may_match_packets(bus) || self.waiting == Some(bus) {
            return false;
        }
        self.decide_waiting();
        let is_compact = self.emits_compact_packets(bus);
        let asked = plain_request(&self.functions, asked);
        self.packet_run = PacketRun::begin(bus, &mut self.buses[bus], is_compact, (asked, time)).map(Box::new);
        self.packet_run.is_some()
    }

    /// Returns the bus whose packets may be matched in pairs (`match_pairs`): exchanges on it are compact, and no request is in
    /// hand.
    #[inline]
    pub(crate) fn bus_of_pairs(&self) -> Option<usize> {
        self.packet_run.as_ref().filter(|run| run.run.is_compact && run.request.is_none()).map(|run| run.bus)
    }

    /// Emits the exchange of the request in hand and this packet of the server as a compact one, if they are unambiguous.
    #[inline(never)]
    fn take_compact(&mut self, answer: &StreamChunk<'_>, answered_at: Ns) -> bool {
        let Some(current) = self.packet_run.as_deref_mut() else { return false };
        let asked = std::mem::take(&mut current.request.bytes);
        let server_side_recorded = self.buses[current.bus].pairing.response_side_recorded;
        let packet = |time, number, bytes, from_client: bool| PacketInTurn {
            time,
            number,
            bytes,
            slot: 0,
            side: u8::from(!from_client),
            from_client,
            server_side_recorded,
        };
        let request = packet(current.request.time, current.request.packet, &asked, true);
        let pair = [request, packet(answered_at, answer.packet, answer.bytes, false)];
        let is_taken = self.match_pairs(&pair, |_| true).is_empty();
        if let Some(current) = &mut self.packet_run {
            current.request.bytes = asked;
            if is_taken {
                current.request.bytes.clear();
            }
        }
        is_taken
    }

    /// Emits pairs of a request and its response at the head of these packets as compact exchanges of `bus_of_pairs`, as long as
    /// they are exchanges unambiguously and packets `belong` to the connection; gives the packets after them. What is the same
    /// for all of a run is left to its end.
    pub(crate) fn match_pairs<'a, 'b>(
        &mut self,
        mut packets: &'b [PacketInTurn<'a>],
        belongs: impl Fn(&PacketInTurn<'_>) -> bool,
    ) -> &'b [PacketInTurn<'a>] {
        let Some(mut current) = self.packet_run.take() else { return packets };
        loop {
            if current.run.totals.exchanges > 0 {
                packets = self.match_known_reads(&mut current, packets, &belongs);
            }
            let mut behind = packets.iter();
            let Some(request) = next_with_bytes(&mut behind, &belongs).filter(|packet| packet.from_client) else { break };
            let Some(response) = next_with_bytes(&mut behind, &belongs).filter(|packet| !packet.from_client) else { break };
            if !self.match_pair(&mut current, request, response) {
                break;
            }
            packets = behind.as_slice();
        }
        self.packet_run = Some(current);
        packets
    }

    /// Emits the exchange of these two packets, if they are unambiguous.
    fn match_pair(&mut self, current: &mut PacketRun, request: &PacketInTurn<'_>, response: &PacketInTurn<'_>) -> bool {
        let times = [request.time, response.time];
        let state = &mut self.buses[current.bus];
        let is_recorded = [request, response].iter().all(|it| it.server_side_recorded == state.pairing.response_side_recorded);
        if !is_recorded || !current.takes_request_at(times[0]) || !current.takes_response_at(times) {
            return false;
        }
        let packets = [request.bytes, response.bytes];
        let Some((matched, exception)) = match_compact(&self.functions, state, current, packets, times) else { return false };
        let MatchedExchange { expected, mbap_id, lengths, counters, .. } = &matched;
        let id = mbap_id.unwrap_or_default();
        let gap = current.sides[0].gap(times[0], &current.run);
        let status = if exception == 0 { Status::Ok } else { Status::Exception };
        state.connection.note_exchange(self.next_txn, status, Some(id), times, &state.pairing);
        let response_time = state.pairing.measurable_interval(Some(times[0]), Some(times[1]), true);
        let poll_pause = gap.filter(|_| expected.echoes_request);
        state.pairing.learn_times(poll_pause, response_time, expected.echoes_request && exception == 0);
        state.note_paired(expected.unit);
        let response_time = response_time.filter(|&ns| ns >= current.run.min_measurable_ns);
        let key = expected.key();
        if exception == 0 {
            let place = counters.or_else(|| self.stats.place_of(state.counts, key));
            let taken = times[1] - times[0];
            self.stats.count_exchange(state.counts, (key, place), (Some(times[0]), Some(taken)), response_time);
            let request = &packets[0][LENGTH_AT..];
            if counters.is_none() && RequestMemo::takes(request, expected) {
                state.memo.add(request, *expected, place);
            }
        } else {
            self.stats.record_refusal(state.counts, (key, exception), Some(times), response_time);
            self.find_refusal(current.bus, (expected.unit, exception), request);
        }
        let wires = packets.map(|bytes| self.batch.store(bytes));
        if self.wanted.transactions {
            let exchange = expected.compact(wires[0].start, *lengths, confidence_by_id(), exception);
            let pair = PacketPair { starts: times, gap, response_time, packet: request.number, mbap_id: id };
            if current.run.totals.exchanges > 0 {
                self.held.exchanges.push_next(exchange, pair);
            } else {
                let (bus, number, frame) = (current.bus as u32, self.next_txn, self.next_frame);
                let start = ExchangeStart { bus, number, frame, recording_start: self.origin, mode: Mode::Tcp };
                self.held.exchanges.push(exchange, pair, &start);
            }
        }
        current.run.totals.exchanges += 1;
        current.run.totals.bytes += lengths[0] + lengths[1];
        current.pass((*lengths, *lengths), times, wires[1]);
        self.next_txn += 1;
        self.next_frame += 2;
        true
    }

    /// Adds the finding that a unit has refused the next transaction, with this exception code, if findings are wanted.
    #[cold]
    fn find_refusal(&mut self, bus: usize, (unit, exception): (u8, u8), request: &PacketInTurn<'_>) {
        if self.wanted.findings {
            let place = FindingPlace {
                frame: Some(self.next_frame + 1),
                txn: Some(self.next_txn),
                bus,
                start: Some(request.time),
                recording_start: self.origin,
                unit: Some(unit),
                origin: request.number,
            };
            self.batch.findings.push(place.row(REFUSED, words::exception(exception)));
        }
    }

    /// Emits the exchange of the request in hand and this packet of the server as rows, if they are unambiguous.
    fn take_rows(&mut self, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let Some(mut current) = self.packet_run.take() else { return false };
        let matched = self.match_rows(&mut current, answered, answered_at, packet);
        self.packet_run = Some(current);
        matched
    }

    fn match_rows(&mut self, current: &mut PacketRun, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let (asked, times) = (current.request.bytes.as_slice(), [current.request.time, answered_at]);
        let state = &mut self.buses[current.bus];
        let [client, server] = &current.sides;
        let lines = [client.line, server.line];
        let Some(matched) = match_packets(&self.functions, known_of(state, current), [asked, answered], times, lines) else {
            return false;
        };
        state.connection.note_exchange(self.next_txn, Status::Ok, matched.mbap_id, times, &state.pairing);
        let wires = [asked, answered].map(|bytes| self.batch.store(bytes));
        let timings = [
            client.timing(times[0], current.request.packet, Side::Sent, &current.run),
            server.timing(times[1], packet, Side::Received, &current.run),
        ];
        self.emit_timed(current.bus, &matched, &ExchangePlaces { wires, pdus: None }, timings, &mut current.run);
        if matched.counters.is_none() {
            let state = &mut self.buses[current.bus];
            state.memo.keep(&mut self.stats, state.counts, &asked[LENGTH_AT..], &matched.expected);
        }
        current.pass((matched.lengths, matched.lengths), times, wires[1]);
        current.request.bytes.clear();
        true
    }

    /// Ends the run of exchanges that are matched in their packets, if there is one: its bus is brought up to date, and the
    /// request in hand, which has no response here, takes the general way.
    #[inline]
    pub(crate) fn end_packet_run(&mut self) {
        if let Some(ended) = self.packet_run.take() {
            self.end_run_of_packets(&ended);
        }
    }

    #[cold]
    fn end_run_of_packets(&mut self, ended: &PacketRun) {
        let state = &mut self.buses[ended.bus];
        if let Some((response, first)) = ended.last_response.zip(ended.first) {
            let response = response.of(&self.batch.arena);
            let exchanges = ended.run.totals.exchanges;
            self.stats.record_batch(state.counts, Mode::Tcp, exchanges, ended.run.totals.bytes as u64);
            if ended.run.is_compact {
                self.stats.record_run_times(state.counts, first, ended.latest.unwrap_or(first));
                learn_sides(&mut state.side_votes, exchanges);
                state.pairing.record_exchanges_by_id(exchanges as u32);
            }
            state.pairing.sync_after_batch(response[0], &response[1..]);
            ended.leave(state);
            self.decide(ended.bus, ended.latest);
        }
        let RequestInHand { bytes, time, packet } = &ended.request;
        if !bytes.is_empty() {
            let chunk = StreamChunk { side: 0, bytes, packet: *packet, time: Some(*time), missing: 0, cut: false };
            self.feed_stream(ended.bus, true, &chunk, false);
        }
    }
}

/// Returns the exchange of these two packets, if it is one unambiguously, or if the request is refused; then with the exception
/// code, else 0.
#[inline]
fn match_compact(
    functions: &Functions,
    state: &mut BusState,
    current: &PacketRun,
    packets: [&[u8]; 2],
    times: [Ns; 2],
) -> Option<(MatchedExchange, u8)> {
    let matched = match_packets(functions, known_of(state, current), packets, times, [0, 1]).map(|matched| (matched, 0));
    matched.or_else(|| match_refusal(functions, known_of(state, current), packets, times))
}

/// What is known of the connection of a run.
#[inline]
fn known_of<'a>(state: &'a mut BusState, current: &'a PacketRun) -> ConnectionContext<'a> {
    let BusState { memo, profiles, .. } = state;
    ConnectionContext { reads: memo, profiles, open: &current.open }
}
