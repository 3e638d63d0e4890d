//! Exchanges whose request and response come in a message each, a packet of a connection or a line of a log with times: they are
//! matched as they come, without the inputs and reads of their lines.
//!
//! A request stays pending until the next message of its bus. If that is its response, the exchange is emitted. Once at the end of
//! the run, the lines are left as if the messages had come and been consumed, and framer and pairing learn what remains. In any
//! other case both messages are fed, in their order, as are all of a bus on which something is undecided. That a message is decided
//! earlier than there changes nothing: a block of the recording may end after any message. Packets that came many at once are
//! matched where they are (`match_pairs`).

use crate::fast_path::rtu_exchange::LastExchange;
use crate::session::bus::{BusState, FROM_CLIENT, FROM_SERVER};
use crate::session::decoder::Decoder;
use crate::session::exchanges::emit::ExchangePlaces;
use crate::session::exchanges::known_pairs::next_with_bytes;
use crate::session::exchanges::matching::{match_rtu, match_tcp, plain_request, RtuContext};
use crate::session::exchanges::message_run::{Message, MessageRun};
use crate::session::exchanges::run::{ExchangeEnd, Form};
use crate::session::line::LineState;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};
use modlens_readers::pcap::PacketInTurn;

impl Decoder {
    /// Takes a chunk that is a packet of a connection or a line of a log, if it is a request to be kept pending, or the response
    /// to the pending one. `false` if it is neither: then it has to be fed, after the pending request (`end_messages`). What a
    /// request finds without a response is decided before it.
    #[inline]
    pub(crate) fn take_message(&mut self, bus: usize, chunk: &Chunk<'_>) -> bool {
        let Times::Read(time) = chunk.times else { return false };
        let may_be_frame = chunk.line != 0 || chunk.proven_framing == Some(Mode::Rtu);
        if chunk.follows_loss || chunk.lacks_checksum || !may_be_frame {
            return false;
        }
        if let Some(ended) = self.message_runs.turn_to(bus) {
            self.end_run_of_messages(*ended);
        }
        let run = self.message_runs.at_hand.as_ref();
        let is_request = chunk.line == FROM_CLIENT || chunk.line == 0 && run.is_none_or(|run| run.request.is_none());
        if is_request && run.is_none_or(|run| run.ends_before_request_at(time)) {
            self.end_messages_of(bus);
            if !self.begin_messages(bus, chunk, time) {
                return false;
            }
        } else if run.is_none() {
            return false;
        }
        let Some(run) = self.message_runs.at_hand.as_deref_mut() else { return false };
        if is_request {
            run.takes_request_at(time) && run.request.take(chunk, time)
        } else {
            self.take_response(chunk, time)
        }
    }

    /// Begins a run on this bus with a request of this time, if nothing on it is undecided and no run is at hand.
    #[cold]
    fn begin_messages(&mut self, bus: usize, chunk: &Chunk<'_>, time: Ns) -> bool {
        let options = &self.buses[bus].options;
        let is_connection = options.bus.network.is_some();
        let may_begin = match chunk.line {
            FROM_CLIENT => is_connection && options.mode == Some(Mode::Tcp),
            _ => !is_connection && options.bus.place == Place::Line && (self.waiting.is_none() || self.message_tries.is_due()),
        };
        if self.live || !may_begin {
            return false;
        }
        if self.waiting.is_some() {
            self.decide_waiting();
        }
        let form = self.form_of_messages(bus);
        let state = &mut self.buses[bus];
        let run = if is_connection {
            MessageRun::on_connection(bus, state, form, (plain_request(&self.functions, chunk.bytes), time))
        } else {
            MessageRun::on_line(bus, state, form)
        };
        if run.is_none() && !is_connection {
            self.message_tries.note_run(0);
        }
        self.message_runs.at_hand = run.map(Box::new);
        self.message_runs.at_hand.is_some()
    }

    /// Returns what exchanges of this bus in a message each become: compact on a connection or in a log, in a recording of which
    /// the rows of frames are not kept, and without profiles.
    pub(super) fn form_of_messages(&self, bus: usize) -> Form {
        let state = &self.buses[bus];
        let place = if state.options.bus.network.is_some() { Place::Packet } else { Place::Line };
        let is_whole = self.live || state.options.bus.place != place || !state.profiles.are_none();
        match (is_whole, self.wanted.frames) {
            (false, false) => Form::Compact,
            (false, true) if self.always_compact => Form::CompactBesideFrames,
            _ => Form::Rows,
        }
    }

    /// Emits the exchange of the pending request and this chunk, if they are one unambiguously.
    fn take_response(&mut self, chunk: &Chunk<'_>, time: Ns) -> bool {
        let Some(mut current) = self.message_runs.at_hand.take() else { return false };
        let asked = std::mem::take(&mut current.request);
        let request = Message { bytes: &asked.bytes, time: asked.time, number: asked.chunk.origin, side: asked.chunk.side };
        let response = Message { bytes: chunk.bytes, time, number: chunk.origin, side: chunk.side };
        let is_taken = !asked.is_none() && self.match_messages(&mut current, [request, response]);
        current.request = asked;
        if is_taken {
            current.request.bytes.clear();
        }
        self.message_runs.at_hand = Some(current);
        is_taken
    }

    /// Emits pairs of a request and its response at the head of these packets as compact exchanges of the run at hand, as long as
    /// they are exchanges unambiguously and packets `belong` to the connection; returns the packets after them. What is the same
    /// for all of a run is left to its end.
    pub(crate) fn match_pairs<'a, 'b>(
        &mut self,
        mut packets: &'b [PacketInTurn<'a>],
        belongs: impl Fn(&PacketInTurn<'_>) -> bool,
    ) -> &'b [PacketInTurn<'a>] {
        let Some(mut current) = self.message_runs.at_hand.take() else { return packets };
        let is_recorded = self.buses[current.bus].pairing.response_side_recorded;
        loop {
            if current.run.totals.exchanges > 0 {
                packets = self.match_known_reads(&mut current, packets, &belongs);
            }
            let mut rest = packets.iter();
            let Some(request) = next_with_bytes(&mut rest, &belongs).filter(|packet| packet.from_client) else { break };
            let Some(response) = next_with_bytes(&mut rest, &belongs).filter(|packet| !packet.from_client) else { break };
            let may_be_pair = [request, response].iter().all(|packet| packet.server_side_recorded == is_recorded);
            if !may_be_pair || !current.takes_request_at(request.time) {
                break;
            }
            let message = |packet: &PacketInTurn<'a>, side| Message {
                bytes: packet.bytes,
                time: packet.time,
                number: packet.number,
                side: Some(side),
            };
            if !self.match_messages(&mut current, [message(request, Side::Sent), message(response, Side::Received)]) {
                break;
            }
            packets = rest.as_slice();
        }
        self.message_runs.at_hand = Some(current);
        packets
    }

    /// Emits the exchange of these two messages, if they are one unambiguously.
    fn match_messages(&mut self, current: &mut MessageRun, messages: [Message<'_>; 2]) -> bool {
        let state = &mut self.buses[current.bus];
        if !current.is_connection {
            current.open.request_timeout = current.run.request_timeout(state);
        }
        let (bytes, times) = (messages.map(|message| message.bytes), messages.map(|message| message.time));
        if !current.takes_response_at(times) {
            return false;
        }
        let BusState { memo, profiles, pairing, lines, .. } = state;
        let matched = if current.is_connection {
            let matched =
                match_tcp(&self.functions, (memo, profiles, &current.open), bytes, times, current.run.form == Form::Compact);
            if let Some(matched) = &matched {
                current.rtu.last_exchange = Some(LastExchange { expected: matched.expected, odds: matched.odds });
            }
            matched
        } else {
            let LineState { input, framer, .. } = &mut lines[0].1;
            let Some(framer) = framer.rtu_mut() else { return false };
            let (functions, run, timing) = (&*self.functions, &mut current.rtu, &pairing.timing);
            let known = RtuContext { functions, framer, run, memo, profiles, timing, has_times: true, are_proven: true };
            let after = |lengths: [usize; 2]| (lengths == bytes.map(<[u8]>::len)).then_some(bytes[1]);
            let silence = times[1] - times[0] - bytes[1].len() as Ns * input.char_ns.unwrap_or(0);
            match_rtu(known, bytes[0], after, |_| Some(silence))
        };
        let Some(matched) = matched else { return false };
        let timings = current.pass(&messages);
        let places = ExchangePlaces { wires: bytes.map(|bytes| self.batch.store(bytes)), pdus: None };
        self.emit_exchange(current.bus, &matched, &places, timings, &mut current.run);
        current.end = ExchangeEnd::newest(&self.batch, self.next_txn);
        true
    }

    /// Ends the runs of exchanges that are matched in their messages: their buses are brought up to date, and the pending
    /// request, which has no response here, is fed.
    #[inline]
    pub(crate) fn end_messages(&mut self) {
        while let Some(ended) = self.message_runs.take(None) {
            self.end_run_of_messages(*ended);
        }
    }

    /// Does the same for this bus, which is to be brought up to date, and for a pending request of another one.
    pub(crate) fn end_messages_of(&mut self, bus: usize) {
        while let Some(ended) = self.message_runs.take(Some(bus)) {
            self.end_run_of_messages(*ended);
        }
    }

    #[cold]
    fn end_run_of_messages(&mut self, mut ended: MessageRun) {
        let mode = if ended.is_connection { Mode::Tcp } else { Mode::Rtu };
        if !ended.is_connection {
            self.message_tries.note_run(ended.run.totals.exchanges);
        }
        if ended.run.totals.exchanges > 0 {
            ended.leave(&mut self.buses[ended.bus]);
            self.end_run(ended.bus, mode, &ended.run.totals, (&mut ended.rtu, ended.end));
            self.decide(ended.bus, ended.newest);
        }
        if !ended.request.is_none() {
            self.feed_message(ended.bus, &ended.request.as_chunk());
        }
    }

    /// Feeds a chunk that is no part of such an exchange: of a connection at once, so that the packets after it can be matched as
    /// they come, of a log together with what may follow.
    pub(crate) fn feed_message(&mut self, bus: usize, chunk: &Chunk<'_>) {
        if chunk.line == FROM_CLIENT || chunk.line == FROM_SERVER {
            self.end_messages_of(bus);
            self.feed(bus, chunk);
        } else {
            self.feed_later(bus, chunk);
        }
    }
}
