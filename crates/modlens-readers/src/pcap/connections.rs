//! Keeps the connections of a capture: finds the connection of each segment, decides what it carries, and reports the
//! bytes of Modbus connections in order.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use crate::pcap::classify::{classify, BufferedChunk, Classification};
use crate::pcap::event::{Event, Repetition, SkipCounts};
use crate::pcap::net::{Endpoint, Segment};
use crate::pcap::stream::{ArrivedSegment, SegmentOutcome, Stream, StreamChunk, MAX_DUPLICATE_DELAY_NS};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// The most connections that are kept. When there are more, the quarter that has been silent for longest is closed.
const MAX_CONNECTIONS: usize = 4096;

/// The ports on which Modbus is expected.
#[derive(Clone, Debug)]
pub enum Ports {
    /// Any port: only the bytes decide.
    Any,
    /// These ports.
    Listed(Vec<u16>),
}

/// The port of Modbus over TLS (MODBUS/TCP Security, 2.1).
const MODBUS_SECURITY_PORT: u16 = 802;

impl Default for Ports {
    fn default() -> Self {
        // The port that IANA has registered for Modbus.
        Self::Listed(vec![502])
    }
}

impl Ports {
    fn listed(&self, port: u16) -> bool {
        matches!(self, Self::Listed(ports) if ports.contains(&port))
    }
}

/// Both ends of a connection, the lower one first, so that both directions have the same key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct ConnectionKey {
    low: Endpoint,
    high: Endpoint,
    is_udp: bool,
}

/// What is known about the content of a connection.
#[derive(Debug)]
enum ConversationState {
    /// Not enough bytes yet, which are kept until the decision.
    Undecided(Vec<BufferedChunk>),
    /// It carries Modbus.
    Modbus,
    /// It carries something else.
    Other,
    /// It was closed; segments that still come are normally duplicates.
    Over,
}

/// A datagram that is remembered to recognise duplicates: the side that sent it, IP identification, payload, time.
type Datagram = (usize, Option<u16>, Vec<u8>, Option<Ns>);

/// Segments and datagrams between two ends. It may hold several TCP connections one after the other.
#[derive(Debug)]
struct Connection {
    stream: Stream,
    datagrams: Vec<Datagram>,
    /// The side that sent the SYN which opened the connection, and its sequence number.
    opened: Option<(usize, u32)>,
    /// Packets so far.
    packets: u64,
    /// Number of the last packet.
    last_packet: u64,
    conversation: Conversation,
}

/// The content of a connection, once its segments are in order.
#[derive(Debug)]
struct Conversation {
    slot: usize,
    key: ConnectionKey,
    /// The side of the client: 0 for the lower end of the key, 1 for the higher one.
    client: usize,
    /// One of the ports is listed as a port of Modbus.
    is_known_port: bool,
    /// The SYN was captured, which shows who the client is.
    has_seen_opening: bool,
    state: ConversationState,
    /// A finding about duplicates has been reported; further ones are only counted.
    has_reported_duplicates: bool,
    /// Whether anything of each side was captured.
    side_recorded: [bool; 2],
}

/// What a conversation reads from and reports to.
struct CaptureContext<'a, 'b> {
    functions: &'a Functions,
    skipped: &'a mut SkipCounts,
    each: &'a mut (dyn FnMut(Event<'_>) + 'b),
}

/// All connections of a capture.
#[derive(Debug, Default)]
pub struct ConnectionTable {
    ports: Ports,
    index: HashMap<ConnectionKey, usize, RandomState>,
    slots: Vec<Option<Connection>>,
    free: Vec<usize>,
    /// The connection of the last packet, which is mostly that of the next one, too.
    latest: Option<(ConnectionKey, usize)>,
}

/// How many datagrams of a connection are remembered to recognise duplicates.
const REMEMBERED_DATAGRAMS: usize = 8;

impl ConnectionTable {
    /// A table of connections that expects Modbus on these ports.
    pub fn new(ports: Ports) -> Self {
        Self { ports, ..Self::default() }
    }

    /// Takes a segment or datagram with the number and time of its packet; `each` is called with what becomes known.
    pub fn take(
        &mut self,
        functions: &Functions,
        it: &Segment<'_>,
        (packet, time): (u64, Option<Ns>),
        skipped: &mut SkipCounts,
        each: &mut dyn FnMut(Event<'_>),
    ) {
        let listed = [self.ports.listed(it.from.port), self.ports.listed(it.to.port)];
        if listed == [false; 2] && !matches!(self.ports, Ports::Any) {
            let secure = it.tcp.is_some() && (it.from.port == MODBUS_SECURITY_PORT || it.to.port == MODBUS_SECURITY_PORT);
            *(if secure { &mut skipped.encrypted } else { &mut skipped.other }) += 1;
            return;
        }
        let context = &mut CaptureContext { functions, skipped, each };
        let side = usize::from(it.from > it.to);
        let ends = if side == 0 { [it.from, it.to] } else { [it.to, it.from] };
        let key = ConnectionKey { low: ends[0], high: ends[1], is_udp: it.tcp.is_none() };
        let at = self.connection(key, side, listed, context);
        let connection = self.slots[at].as_mut().expect("indexed");
        if let Some(tcp) = it.tcp.filter(|tcp| tcp.syn && tcp.acknowledged.is_none()) {
            connection.opening(side, tcp.sequence, listed, context);
        }
        connection.last_packet = packet;
        connection.packets += 1;
        connection.conversation.side_recorded[side] = true;
        if it.length == 0 {
            context.skipped.without_data += 1;
        }
        match it.tcp {
            Some(tcp) => {
                let (payload, length, ident) = (it.payload, it.length, it.ident);
                connection.segment(&ArrivedSegment { side, tcp, payload, length, ident, packet, time }, context);
            }
            None if it.length > 0 => connection.datagram(it, side, (packet, time), context),
            None => {}
        }
    }

    /// Ends all connections, because the capture has ended.
    pub fn finish(&mut self, functions: &Functions, skipped: &mut SkipCounts, each: &mut dyn FnMut(Event<'_>)) {
        let context = &mut CaptureContext { functions, skipped, each };
        let mut open: Vec<usize> = self.index.values().copied().collect();
        open.sort_unstable();
        for at in open {
            self.close(at, context);
        }
    }

    /// The slot of a connection; a new connection gets a free one.
    fn connection(&mut self, key: ConnectionKey, side: usize, listed: [bool; 2], context: &mut CaptureContext<'_, '_>) -> usize {
        if let Some((_, at)) = self.latest.filter(|(latest, _)| *latest == key) {
            return at;
        }
        let at = if let Some(&at) = self.index.get(&key) {
            at
        } else {
            if self.index.len() >= MAX_CONNECTIONS {
                self.make_room(context);
            }
            let at = self.free.pop().unwrap_or_else(|| {
                self.slots.push(None);
                self.slots.len() - 1
            });
            // The listed port is that of the server. If both or none are listed, the sender of the first packet counts as
            // the client.
            let client = if listed == [true, false] { 1 - side } else { side };
            self.slots[at] = Some(Connection::new(Conversation::new(at, key, client, listed != [false; 2])));
            self.index.insert(key, at);
            at
        };
        self.latest = Some((key, at));
        at
    }

    /// Closes the quarter of the connections that have been silent for longest.
    fn make_room(&mut self, context: &mut CaptureContext<'_, '_>) {
        let mut ages: Vec<(u64, usize)> =
            self.index.values().filter_map(|&at| Some((self.slots[at].as_ref()?.last_packet, at))).collect();
        ages.sort_unstable();
        for (_, at) in ages.into_iter().take(MAX_CONNECTIONS / 4) {
            self.close(at, context);
        }
    }

    /// Ends a connection and frees its slot.
    fn close(&mut self, at: usize, context: &mut CaptureContext<'_, '_>) {
        if let Some(mut connection) = self.slots[at].take() {
            connection.end(context);
            self.index.remove(&connection.conversation.key);
            self.free.push(at);
            self.latest = None;
        }
    }
}

impl Connection {
    fn new(conversation: Conversation) -> Self {
        Self { stream: Stream::default(), datagrams: Vec::new(), opened: None, packets: 0, last_packet: 0, conversation }
    }

    /// Handles a SYN, which opens the connection, or a new one between the same ports. Its sender is the client, unless
    /// only the other side has a listed port.
    fn opening(&mut self, side: usize, sequence: u32, listed: [bool; 2], context: &mut CaptureContext<'_, '_>) {
        let is_repeated = self.opened == Some((side, sequence));
        if !is_repeated && self.packets > 0 {
            self.restart(context);
        }
        self.opened = Some((side, sequence));
        self.conversation.has_seen_opening = true;
        if !self.conversation.is_known_port || listed == [true; 2] {
            self.conversation.client = side;
        }
    }

    /// Takes a TCP segment.
    fn segment(&mut self, arrival: &ArrivedSegment<'_>, context: &mut CaptureContext<'_, '_>) {
        let conversation = &mut self.conversation;
        let mut outcome = self.stream.take(arrival, &mut |chunk| conversation.take_bytes(chunk, context));
        if outcome == SegmentOutcome::OtherConnection {
            self.restart(context);
            let conversation = &mut self.conversation;
            outcome = self.stream.take(arrival, &mut |chunk| conversation.take_bytes(chunk, context));
        }
        self.conversation.note_repetition(outcome, arrival.packet, arrival.time, context);
        if arrival.tcp.rst || self.stream.ended() {
            self.end(context);
        }
    }

    /// Takes a UDP datagram, unless it was captured twice.
    fn datagram(
        &mut self,
        it: &Segment<'_>,
        side: usize,
        (packet, time): (u64, Option<Ns>),
        context: &mut CaptureContext<'_, '_>,
    ) {
        let ident = it.ident.filter(|&ident| ident != 0);
        let is_duplicate = self.datagrams.iter().any(|(other, id, bytes, then)| {
            let soon = || then.zip(time).is_some_and(|(then, now)| (now - then).abs() < MAX_DUPLICATE_DELAY_NS);
            *other == side && *id == ident && (ident.is_some() || soon()) && bytes == it.payload
        });
        if is_duplicate {
            return self.conversation.note_repetition(SegmentOutcome::Duplicate, packet, time, context);
        }
        if self.datagrams.len() == REMEMBERED_DATAGRAMS {
            self.datagrams.remove(0);
        }
        self.datagrams.push((side, ident, it.payload.to_vec(), time));
        let cut = it.payload.len() < it.length;
        self.conversation.take_bytes(StreamChunk { side, bytes: it.payload, packet, time, missing: 0, cut }, context);
    }

    /// Ends the current connection, because another one begins between the same ports.
    fn restart(&mut self, context: &mut CaptureContext<'_, '_>) {
        self.end(context);
        let old = &self.conversation;
        let conversation = Conversation::new(old.slot, old.key, old.client, old.is_known_port);
        *self = Self { packets: self.packets, last_packet: self.last_packet, ..Self::new(conversation) };
    }

    /// Delivers what waits and ends the conversation. The connection stays in the table, so that duplicates of its last
    /// segments are recognised.
    fn end(&mut self, context: &mut CaptureContext<'_, '_>) {
        let conversation = &mut self.conversation;
        self.stream.finish(&mut |chunk| conversation.take_bytes(chunk, context));
        self.conversation.end(context);
    }
}

impl Conversation {
    fn new(slot: usize, key: ConnectionKey, client: usize, is_known_port: bool) -> Self {
        Self {
            slot,
            key,
            client,
            is_known_port,
            has_seen_opening: false,
            state: ConversationState::Undecided(Vec::new()),
            has_reported_duplicates: false,
            side_recorded: [false; 2],
        }
    }

    /// Counts a duplicate or a retransmission, and reports it: of the duplicates of a connection only the first.
    fn note_repetition(&mut self, outcome: SegmentOutcome, packet: u64, time: Option<Ns>, context: &mut CaptureContext<'_, '_>) {
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

    /// Takes bytes in order: they are delivered, counted as other traffic, or kept until the decision.
    fn take_bytes(&mut self, chunk: StreamChunk<'_>, context: &mut CaptureContext<'_, '_>) {
        match self.state {
            ConversationState::Modbus => self.deliver(chunk, context),
            ConversationState::Other => context.skipped.not_modbus += 1,
            ConversationState::Undecided(_) | ConversationState::Over => {
                // Bytes behind a RST or FIN mean that the ports are used again, or that the RST was for another connection.
                if matches!(self.state, ConversationState::Over) {
                    self.state = ConversationState::Undecided(Vec::new());
                }
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
            self.state = ConversationState::Other;
            return;
        };
        // A serial device behind TCP may connect to its master, so there only the frames show which side sends requests.
        let is_client_doubtful = mode != Mode::Tcp || !(self.has_seen_opening || self.is_known_port);
        if let Some(side) = client_side.filter(|_| is_client_doubtful) {
            self.client = side;
        }
        self.state = ConversationState::Modbus;
        let (client, server) = (self.endpoint_of(self.client), self.endpoint_of(1 - self.client));
        (context.each)(Event::Opened { slot: self.slot, client, server, mode });
        for it in held {
            let BufferedChunk { side, packet, time, missing, cut, .. } = it;
            self.deliver(StreamChunk { side, bytes: &it.bytes, packet, time, missing, cut }, context);
        }
    }

    /// Address and port of a side.
    fn endpoint_of(&self, side: usize) -> Endpoint {
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
        let from_client = chunk.side == self.client;
        let server_side_recorded = self.side_recorded[1 - self.client];
        (context.each)(Event::Bytes {
            slot: self.slot,
            from_client,
            chunk,
            is_whole_message: self.key.is_udp,
            server_side_recorded,
        });
    }

    /// Decides with what there is, and closes a Modbus connection.
    fn end(&mut self, context: &mut CaptureContext<'_, '_>) {
        self.decide(true, context);
        if matches!(self.state, ConversationState::Modbus) {
            (context.each)(Event::Closed { slot: self.slot });
            self.state = ConversationState::Over;
        }
    }
}
