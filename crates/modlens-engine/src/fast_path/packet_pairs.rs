//! The fast path on a TCP connection whose requests and responses come one behind the other, in a packet each: they are matched
//! as they come, without the inputs and reads of their lines.
//!
//! A request is kept in hand until the next packet of its connection. If that is its response, the exchange is emitted as
//! `tcp_batch` emits one at the heads of the lines; where exchanges are compact, a refusal is a response, too. Once at the end
//! of the run, both lines are left as if the packets had come and been consumed, and what is counted is counted. In any other
//! case both packets take the general way, in their order, as does all of a connection on which something is undecided. That a
//! packet is decided earlier than there changes nothing: a block of the capture may end behind any packet.

use crate::fast_path::emit::{compact_exchange, ExchangePlaces};
use crate::fast_path::packet_run::PacketRun;
use crate::fast_path::tcp_batch::{match_packets, match_refusal, KnownOfBus, LENGTH_AT};
use crate::findings::{words, REFUSED};
use crate::records::PacketPair;
use crate::session::bus::{learn_sides, BusState};
use crate::session::held_exchanges::ExchangeStart;
use crate::session::rows::FindingPlace;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;
use modlens_readers::pcap::StreamChunk;

impl Session {
    /// Takes a packet of a connection if it is a request to be kept in hand, or the response to the one in hand. `false`, with
    /// nothing changed, if it is neither: then it has to be fed, behind the request in hand (`end_packet_run`).
    #[inline]
    pub(crate) fn take_packet(&mut self, bus: usize, from_client: bool, packet: &StreamChunk<'_>) -> bool {
        let Some(time) = packet.time.filter(|_| packet.missing == 0) else { return false };
        if self.packet_run.as_ref().is_none_or(|run| run.bus != bus) && !(from_client && self.begin_packet_run(bus)) {
            return false;
        }
        let Some(run) = self.packet_run.as_deref_mut().filter(|run| run.is_in_order(time)) else { return false };
        if from_client {
            run.request.take(&mut self.batch, packet.bytes, time, packet.packet)
        } else if run.run.is_compact {
            self.take_compact(packet.bytes, time)
        } else {
            self.take_rows(packet.bytes, time, packet.packet)
        }
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
        let is_compact = self.emits_compact_packets(bus);
        self.packet_run = PacketRun::begin(bus, &mut self.buses[bus], is_compact).map(Box::new);
        self.packet_run.is_some()
    }

    /// Emits the exchange of the request in hand and this packet of the server as a compact one, if they are one without a doubt.
    /// What is the same for all of a run is left to its end.
    #[inline(never)] // So that a request does not save what only a response needs.
    fn take_compact(&mut self, answered: &[u8], answered_at: Ns) -> bool {
        let Some(current) = self.packet_run.as_deref_mut() else { return false };
        let (asked, times) = (current.request.place(), [current.request.time, answered_at]);
        let packets = [asked.of(&self.batch.arena), answered];
        let state = &mut self.buses[current.bus];
        let known = known_of(state, current);
        let (matched, exception) = match match_packets(&self.functions, known, packets, times, [0, 1]) {
            Some(matched) => (matched, 0),
            None => match match_refusal(&self.functions, known_of(state, current), packets, times) {
                Some(refused) => refused,
                None => return false,
            },
        };
        let (expected, is_mirrored) = (&matched.expected, matched.expected.echoes_request && exception == 0);
        let gap = current.sides[0].gap(times[0], current.run.config.resolution);
        let status = if exception == 0 { Status::Ok } else { Status::Exception };
        state.connection.note_exchange(self.next_txn, status, matched.mbap_id, times, &state.pairing);
        let response_time = state.pairing.measurable_interval(Some(times[0]), Some(times[1]), true);
        let poll_pause = gap.filter(|_| expected.echoes_request);
        state.pairing.learn_times(poll_pause, response_time, is_mirrored);
        state.note_paired(expected.unit);
        let response_time = response_time.filter(|&ns| ns >= current.run.min_measurable_ns);
        let key = expected.key();
        if exception == 0 {
            let taken = times[1] - times[0];
            self.stats.count_exchange(state.counts, (key, matched.counters), (Some(times[0]), Some(taken)), response_time);
        } else {
            self.stats.record_refusal(state.counts, (key, exception), Some(times), response_time);
            if self.wanted.findings {
                let place = FindingPlace {
                    frame: Some(self.next_frame + 1),
                    txn: Some(self.next_txn),
                    bus: current.bus,
                    start: Some(times[0]),
                    recording_start: self.origin,
                    unit: Some(expected.unit),
                    origin: current.request.packet,
                };
                self.batch.findings.push(place.row(REFUSED, words::exception(exception)));
            }
        }
        if matched.counters.is_none() && exception == 0 {
            state.known_reads.keep(&mut self.stats, state.counts, &packets[0][LENGTH_AT..], &matched.expected);
        }
        let response = self.batch.store(answered);
        if self.wanted.transactions {
            let exchange = compact_exchange(&matched, asked.start, exception);
            let (packet, mbap_id) = (current.request.packet, matched.mbap_id.unwrap_or_default());
            let pair = PacketPair { starts: times, gap, response_time, packet, mbap_id };
            let (bus, number, frame) = (current.bus as u32, self.next_txn, self.next_frame);
            if current.run.totals.exchanges > 0 {
                self.held.exchanges.push_next(exchange, pair);
            } else {
                let start = ExchangeStart { bus, number, frame, recording_start: self.origin, mode: Mode::Tcp };
                self.held.exchanges.push(exchange, pair, &start);
            }
        }
        current.run.totals.exchanges += 1;
        current.run.totals.bytes += matched.lengths[0] + matched.lengths[1];
        current.pass(matched.lengths, times, response.start);
        self.next_txn += 1;
        self.next_frame += 2;
        true
    }

    /// Emits the exchange of the request in hand and this packet of the server as rows, if they are one without a doubt.
    fn take_rows(&mut self, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let Some(mut current) = self.packet_run.take() else { return false };
        let matched = self.match_rows(&mut current, answered, answered_at, packet);
        self.packet_run = Some(current);
        matched
    }

    fn match_rows(&mut self, current: &mut PacketRun, answered: &[u8], answered_at: Ns, packet: u64) -> bool {
        let (asked, times) = (current.request.place(), [current.request.time, answered_at]);
        let packets = [asked.of(&self.batch.arena), answered];
        let state = &mut self.buses[current.bus];
        let [client, server] = &current.sides;
        let lines = [client.line, server.line];
        let Some(matched) = match_packets(&self.functions, known_of(state, current), packets, times, lines) else { return false };
        state.connection.note_exchange(self.next_txn, Status::Ok, matched.mbap_id, times, &state.pairing);
        let wires = [asked, self.batch.store(answered)];
        let timings = [
            client.timing(times[0], current.request.packet, Side::Sent, &current.run),
            server.timing(times[1], packet, Side::Received, &current.run),
        ];
        self.emit_timed(current.bus, &matched, &ExchangePlaces { wires, pdus: None }, timings, &mut current.run);
        if matched.counters.is_none() {
            let state = &mut self.buses[current.bus];
            state.known_reads.keep(&mut self.stats, state.counts, &asked.of(&self.batch.arena)[LENGTH_AT..], &matched.expected);
        }
        current.pass(matched.lengths, times, wires[1].start);
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
        let asked = ended.request.take_back(&mut self.batch);
        if !asked.is_empty() {
            let (packet, time) = (ended.request.packet, Some(ended.request.time));
            let chunk = StreamChunk { side: 0, bytes: &asked, packet, time, missing: 0, cut: false };
            self.feed_stream(ended.bus, true, &chunk, false);
        }
    }
}

/// What is known of the connection of a run.
#[inline]
fn known_of<'a>(state: &'a mut BusState, current: &'a PacketRun) -> KnownOfBus<'a> {
    let BusState { known_reads, profiles, .. } = state;
    KnownOfBus { reads: known_reads, profiles, open: &current.open, request_timeout: current.request_timeout }
}
