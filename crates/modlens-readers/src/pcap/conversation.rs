//! The content of a connection, once its segments are in order: undecided, Modbus in one framing, or something else; and the
//! events of its life.

use crate::pcap::classify::{classify, BufferedChunk, Classification};
use crate::pcap::delivered::Conflict;
use crate::pcap::event::{EndedConnection, Event, Repetition, SkipCounts};
use crate::pcap::in_turn::PacketInTurn;
use crate::pcap::lifecycle::{Closing, ConnectionHistory};
use crate::pcap::net::Endpoint;
use crate::pcap::stream::{ArrivedSegment, SegmentOutcome, Stream, StreamChunk};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// Both ends of a connection, the lower one first, so that both directions have the same key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct ConnectionKey {
    pub(super) low: Endpoint,
    pub(super) high: Endpoint,
    pub(super) is_udp: bool,
}

/// Contradictions that are held until it is known what a connection carries; further ones are only counted.
const MAX_HELD_CONFLICTS: usize = 16;

/// What is known about the content of a connection.
#[derive(Debug)]
pub(super) enum ConversationState {
    /// Not enough bytes yet, which are kept until the decision.
    Undecided(Vec<BufferedChunk>),
    /// It carries Modbus.
    Modbus,
    /// It carries something else.
    Other,
    /// It was closed; segments that still come are normally duplicates.
    Over,
}

/// The content of a connection, once its segments are in order.
#[derive(Debug)]
pub(super) struct Conversation {
    pub(super) slot: usize,
    pub(super) key: ConnectionKey,
    /// The side of the client: 0 for the lower end of the key, 1 for the higher one.
    pub(super) client: usize,
    /// One of the ports is listed as a port of Modbus.
    pub(super) is_known_port: bool,
    /// Modbus is expected before any byte shows it: the port is known, or the server has carried Modbus before.
    pub(super) is_expected: bool,
    /// The SYN was captured, which shows who the client is.
    pub(super) has_seen_opening: bool,
    pub(super) state: ConversationState,
    /// What the packets of the TCP connection at hand have told; `None` before its first one and after its end.
    history: Option<Box<ConnectionHistory>>,
    /// The connection at hand has been reported.
    has_begun: bool,
    /// The connection at hand is over.
    has_ended: bool,
    /// Ends that are reported once the bytes before them are.
    closings: Vec<(usize, Closing, Option<Ns>)>,
    /// Contradictions that came before it was known what the connection carries, with their packets.
    held_conflicts: Vec<(Conflict, u64, Option<Ns>)>,
    /// A finding about duplicates has been reported; further ones are only counted.
    has_reported_duplicates: bool,
    /// Whether anything of each side was captured.
    pub(super) side_recorded: [bool; 2],
}

/// What a conversation reads from and reports to.
pub(super) struct CaptureContext<'a, 'b> {
    pub(super) functions: &'a Functions,
    pub(super) skipped: &'a mut SkipCounts,
    pub(super) each: &'a mut (dyn FnMut(Event<'_>) + 'b),
}

impl Conversation {
    pub(super) fn new(slot: usize, key: ConnectionKey, client: usize, is_known_port: bool, is_expected: bool) -> Self {
        Self {
            slot,
            key,
            client,
            is_known_port,
            is_expected,
            has_seen_opening: false,
            state: ConversationState::Undecided(Vec::new()),
            history: None,
            has_begun: false,
            has_ended: false,
            closings: Vec::new(),
            held_conflicts: Vec::new(),
            has_reported_duplicates: false,
            side_recorded: [false; 2],
        }
    }

    /// Begins the history of a TCP connection with its first packet.
    pub(super) fn begin(&mut self, packet: u64, time: Option<Ns>, context: &mut CaptureContext<'_, '_>) {
        if self.history.is_some() || self.has_ended {
            return;
        }
        self.history = Some(Box::new(ConnectionHistory::new(packet, time)));
        if self.is_expected {
            self.report_begin(context);
        }
    }

    fn report_begin(&mut self, context: &mut CaptureContext<'_, '_>) {
        if self.history.is_some() && !std::mem::replace(&mut self.has_begun, true) {
            (context.each)(Event::Begun { slot: self.slot });
        }
    }

    /// Notes a segment, after the stream has said what it brought.
    pub(super) fn note_segment(&mut self, it: &ArrivedSegment<'_>, outcome: SegmentOutcome) {
        if let Some(history) = &mut self.history {
            history.note_segment(it, outcome, self.client);
        }
    }

    /// Whether nothing but bytes is to be reported of it, as long as its packets are plain: it carries Modbus, as was expected,
    /// and has begun.
    #[inline]
    pub(super) fn is_settled(&self) -> bool {
        matches!(self.state, ConversationState::Modbus) && self.is_expected && self.history.is_some()
    }

    /// Notes the next packet of a settled conversation.
    #[inline]
    pub(super) fn note_in_turn(&mut self, functions: &Functions, packet: &PacketInTurn<'_>) {
        let Some(history) = &mut self.history else { return };
        if packet.bytes.is_empty() {
            history.note_plain_segment(packet.from_client, None);
        } else {
            history.note_bytes(functions, usize::from(packet.side), packet.bytes);
            history.note_plain_segment(packet.from_client, Some(packet.time));
        }
    }

    /// Notes the sides that have finished by now, as far as `stream` has delivered everything before their FIN; where the
    /// connection is over, also those of which bytes are missing.
    pub(super) fn note_finished(&mut self, stream: &Stream, is_over: bool, context: &mut CaptureContext<'_, '_>) {
        for side in 0..2 {
            let fin = self.history.as_ref().and_then(|history| history.fin(side));
            if let Some(fin) = fin.filter(|_| is_over || stream.has_finished(side)) {
                self.note_closing(side, Closing::Finished, fin.time, context);
            }
        }
    }

    /// Notes that a side has ended the connection.
    pub(super) fn note_closing(&mut self, side: usize, how: Closing, time: Option<Ns>, context: &mut CaptureContext<'_, '_>) {
        let Some(history) = &mut self.history else { return };
        if history.note_closing(side, how, time, self.client) {
            self.closings.push((side, how, time));
            self.report_closings(context);
        }
    }

    /// Reports the ends that are known, unless bytes before them still wait for the decision what they are.
    fn report_closings(&mut self, context: &mut CaptureContext<'_, '_>) {
        if !self.has_begun || matches!(&self.state, ConversationState::Undecided(held) if !held.is_empty()) {
            return;
        }
        for (side, closing, time) in self.closings.drain(..) {
            (context.each)(Event::Closing { slot: self.slot, from_client: side == self.client, closing, time });
        }
    }

    /// Counts a duplicate or a retransmission, and reports it: of the duplicates of a connection only the first.
    pub(super) fn note_repetition(
        &mut self,
        outcome: SegmentOutcome,
        packet: u64,
        time: Option<Ns>,
        context: &mut CaptureContext<'_, '_>,
    ) {
        let kind = match outcome {
            SegmentOutcome::Duplicate => {
                context.skipped.duplicates += 1;
                if std::mem::replace(&mut self.has_reported_duplicates, true) {
                    return;
                }
                Repetition::Duplicate
            }
            SegmentOutcome::Retransmission => {
                context.skipped.retransmissions += 1;
                Repetition::Retransmission
            }
            _ => return,
        };
        if matches!(self.state, ConversationState::Modbus) {
            (context.each)(Event::Repetition { slot: self.slot, kind, packet, time });
        }
    }

    /// Counts bytes that contradict those before them, and reports both versions, once it is known that the connection carries
    /// Modbus. Until then only the first few are held.
    pub(super) fn note_conflict(
        &mut self,
        conflict: Conflict,
        (packet, time): (u64, Option<Ns>),
        context: &mut CaptureContext<'_, '_>,
    ) {
        context.skipped.conflicts += 1;
        if let Some(history) = &mut self.history {
            history.has_conflicts = true;
        }
        match self.state {
            ConversationState::Modbus => {
                (context.each)(Event::Conflict { slot: self.slot, conflict: &conflict, packet, time });
            }
            ConversationState::Undecided(_) if self.held_conflicts.len() < MAX_HELD_CONFLICTS => {
                self.held_conflicts.push((conflict, packet, time));
            }
            _ => {}
        }
    }

    /// Takes bytes in order: they are delivered, counted as other traffic, or kept until the decision.
    pub(super) fn take_bytes(&mut self, chunk: StreamChunk<'_>, context: &mut CaptureContext<'_, '_>) {
        if matches!(self.state, ConversationState::Over) {
            // Bytes after a RST or FIN mean that the ports are used again, or that the RST was for another connection.
            self.state = ConversationState::Undecided(Vec::new());
            (self.has_begun, self.has_ended) = (false, false);
            self.begin(chunk.packet, chunk.time, context);
        }
        if let Some(history) = &mut self.history {
            history.lost_bytes += u64::from(chunk.missing);
            history.note_bytes(context.functions, chunk.side, chunk.bytes);
        }
        match self.state {
            ConversationState::Modbus => self.deliver(chunk, context),
            ConversationState::Other => context.skipped.not_modbus += 1,
            ConversationState::Undecided(_) | ConversationState::Over => {
                let ConversationState::Undecided(held) = &mut self.state else { return };
                held.push(BufferedChunk {
                    side: chunk.side,
                    bytes: chunk.bytes.to_vec(),
                    packet: chunk.packet,
                    time: chunk.time,
                    missing: chunk.missing,
                    cut: chunk.cut,
                });
                self.decide(false, context);
            }
        }
    }

    /// Decides what the connection carries, once its bytes show it, and delivers those that were kept for that.
    fn decide(&mut self, ended: bool, context: &mut CaptureContext<'_, '_>) {
        let ConversationState::Undecided(held) = &mut self.state else { return };
        let Some(found) = classify(context.functions, held, self.is_known_port, ended) else { return };
        let held = std::mem::take(held);
        let Classification::Modbus(mode, client_side) = found else {
            context.skipped.not_modbus += held.len() as u64;
            context.skipped.other_connections += u64::from(!held.is_empty());
            self.held_conflicts = Vec::new();
            self.state = ConversationState::Other;
            return;
        };
        // A serial device after TCP may connect to its master, so there only the frames show which side sends requests.
        let is_client_doubtful = mode != Mode::Tcp || !(self.has_seen_opening || self.is_known_port);
        if let Some(side) = client_side.filter(|_| is_client_doubtful) {
            self.client = side;
        }
        self.state = ConversationState::Modbus;
        let (client, server) = (self.endpoint_of(self.client), self.endpoint_of(1 - self.client));
        self.report_begin(context);
        (context.each)(Event::Opened { slot: self.slot, client, server, mode });
        for it in held {
            let BufferedChunk { side, packet, time, missing, cut, .. } = it;
            self.deliver(StreamChunk { side, bytes: &it.bytes, packet, time, missing, cut }, context);
        }
        for (conflict, packet, time) in std::mem::take(&mut self.held_conflicts) {
            (context.each)(Event::Conflict { slot: self.slot, conflict: &conflict, packet, time });
        }
    }

    /// Address and port of a side.
    pub(super) fn endpoint_of(&self, side: usize) -> Endpoint {
        if side == 0 {
            self.key.low
        } else {
            self.key.high
        }
    }

    /// Reports bytes of a Modbus connection.
    fn deliver(&mut self, chunk: StreamChunk<'_>, context: &mut CaptureContext<'_, '_>) {
        context.skipped.missing += u64::from(chunk.missing);
        context.skipped.cut += u64::from(chunk.cut);
        (context.each)(Event::Bytes {
            slot: self.slot,
            from_client: chunk.side == self.client,
            chunk,
            is_whole_message: self.key.is_udp,
            server_side_recorded: self.side_recorded[1 - self.client],
        });
    }

    /// Decides with what there is, and closes a connection that has been reported.
    pub(super) fn end(&mut self, context: &mut CaptureContext<'_, '_>) {
        self.decide(true, context);
        self.report_closings(context);
        let is_modbus = matches!(self.state, ConversationState::Modbus);
        let history = self.history.take().filter(|_| self.has_begun);
        if is_modbus || history.is_some() {
            let connection = history.as_deref().map(|history| EndedConnection {
                client: self.endpoint_of(self.client),
                server: self.endpoint_of(1 - self.client),
                client_side: self.client,
                history,
            });
            (context.each)(Event::Closed { slot: self.slot, connection });
        }
        if is_modbus {
            self.state = ConversationState::Over;
        }
        (self.has_begun, self.has_ended) = (false, true);
    }
}
