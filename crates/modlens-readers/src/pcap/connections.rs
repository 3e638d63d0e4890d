//! Keeps the connections of a capture: finds the connection of each segment, and puts its segments in order.

use std::collections::{HashMap, HashSet};

use foldhash::fast::RandomState;

use crate::pcap::conversation::{CaptureContext, ConnectionKey, Conversation, ConversationState};
use crate::pcap::event::{Event, SkipCounts};
use crate::pcap::in_turn::PacketInTurn;
use crate::pcap::known_connections::KnownConnections;
use crate::pcap::lifecycle::Closing;
use crate::pcap::net::{Endpoint, Segment};
use crate::pcap::plain::PlainSegment;
use crate::pcap::stream::{ArrivedSegment, SegmentOutcome, Stream, StreamChunk, MAX_DUPLICATE_DELAY_NS};
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// The most connections that are kept. When there are more, the quarter that has been silent for longest is closed.
const MAX_CONNECTIONS: usize = 4096;

/// The most servers on ports that are not listed of which connections without bytes are reported.
const MAX_SERVERS: usize = 4096;

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
    /// Plain segments that are the next ones of their side can be taken as such (`take_plain`). The general way may change that.
    is_steady: bool,
}

/// All connections of a capture.
#[derive(Debug, Default)]
pub struct ConnectionTable {
    ports: Ports,
    index: HashMap<ConnectionKey, usize, RandomState>,
    slots: Vec<Option<Connection>>,
    free: Vec<usize>,
    /// Servers on ports that are not listed, of which a connection has turned out to carry Modbus.
    servers: HashSet<Endpoint, RandomState>,
    /// The connection of the last packet, which is mostly that of the next one as well.
    latest: Option<(ConnectionKey, usize)>,
    /// The connections of the last packets, which are mostly those of the next ones as well.
    known: KnownConnections,
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
        if it.tcp.is_some() {
            self.known.keep(it.from, it.to, (at, side));
        }
        let connection = self.slots[at].as_mut().expect("indexed");
        if let Some(tcp) = it.tcp.filter(|tcp| tcp.syn && tcp.acknowledged.is_none()) {
            connection.opening(side, tcp.sequence, listed, context);
        }
        connection.is_steady = false;
        connection.last_packet = packet;
        connection.packets += 1;
        connection.conversation.side_recorded[side] = true;
        if it.length == 0 && (it.tcp.is_none() || !connection.conversation.is_expected) {
            context.skipped.without_data += 1;
        }
        match it.tcp {
            Some(tcp) => {
                let (payload, length, ident) = (it.payload, it.length, it.ident);
                connection.segment(&ArrivedSegment { side, tcp, payload, length, ident, packet, time }, context);
                self.note_server(at);
            }
            None if it.length > 0 => connection.datagram(it, side, (packet, time), context),
            None => {}
        }
    }

    /// Takes a plain segment with the number and time of its packet, if it is the next one of a connection of Modbus that is known
    /// by now and at which nothing waits. `None`, with nothing changed, if it is not: then `take` has to take it, which would have
    /// done the same.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The body of a loop; what it takes and gives is large.
    pub fn take_plain<'a>(
        &mut self,
        functions: &Functions,
        it: &PlainSegment<'a>,
        (number, time): (u64, Ns),
    ) -> Option<PacketInTurn<'a>> {
        let (at, side) = self.known.find(it.addresses, it.ports)?;
        let connection = self.slots[at].as_mut()?;
        if !(connection.is_steady || connection.becomes_steady()) || !connection.stream.take_next(side, it, time) {
            return None;
        }
        connection.last_packet = number;
        connection.packets += 1;
        let conversation = &mut connection.conversation;
        conversation.side_recorded[side] = true;
        let from_client = side == conversation.client;
        let server_side_recorded = !from_client || conversation.side_recorded[1 - side];
        let slot = at as u32;
        let packet = PacketInTurn { time, number, bytes: it.payload, slot, side: side as u8, from_client, server_side_recorded };
        conversation.note_in_turn(functions, &packet);
        Some(packet)
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
            let is_listed = listed != [false; 2];
            let is_expected = is_listed || self.servers.contains(&key.low) || self.servers.contains(&key.high);
            self.slots[at] = Some(Connection::new(Conversation::new(at, key, client, is_listed, is_expected)));
            self.index.insert(key, at);
            at
        };
        self.latest = Some((key, at));
        at
    }

    /// Remembers the server of a connection that turned out to carry Modbus, on whatever port: it is expected there from now on.
    fn note_server(&mut self, at: usize) {
        let Some(connection) = self.slots[at].as_mut().filter(|it| !it.conversation.is_expected) else { return };
        let conversation = &mut connection.conversation;
        if matches!(conversation.state, ConversationState::Modbus) {
            conversation.is_expected = true;
            if self.servers.len() < MAX_SERVERS {
                self.servers.insert(conversation.endpoint_of(1 - conversation.client));
            }
        }
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
            self.known.clear();
        }
    }
}

impl Connection {
    fn new(conversation: Conversation) -> Self {
        let (stream, datagrams) = (Stream::default(), Vec::new());
        Self { stream, datagrams, opened: None, packets: 0, last_packet: 0, conversation, is_steady: false }
    }

    /// Whether nothing waits or is missing, and nothing but bytes is to be reported of the connection as long as its packets are
    /// plain. It stays so until one is not.
    #[cold]
    fn becomes_steady(&mut self) -> bool {
        self.is_steady = self.conversation.is_settled() && self.stream.is_steady();
        self.is_steady
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

    /// Takes a TCP segment. A FIN is noted after all bytes before it; a RST ends both directions at once.
    fn segment(&mut self, arrival: &ArrivedSegment<'_>, context: &mut CaptureContext<'_, '_>) {
        let conflict = self.stream.conflict(arrival);
        let mut outcome = self.pass_on(arrival, context);
        if outcome == SegmentOutcome::OtherConnection {
            self.restart(context);
            outcome = self.pass_on(arrival, context);
        }
        let conversation = &mut self.conversation;
        if conflict.is_some() && outcome != SegmentOutcome::New {
            outcome = SegmentOutcome::Conflicting;
        }
        conversation.note_segment(arrival, outcome);
        match conflict {
            Some(conflict) => conversation.note_conflict(conflict, (arrival.packet, arrival.time), context),
            None => conversation.note_repetition(outcome, arrival.packet, arrival.time, context),
        }
        conversation.note_finished(&self.stream, false, context);
        if arrival.tcp.rst {
            self.stream.finish(&mut |chunk| conversation.take_bytes(chunk, context));
            conversation.note_closing(arrival.side, Closing::Reset, arrival.time, context);
        }
        if arrival.tcp.rst || self.stream.ended() {
            self.end(context);
        }
    }

    /// Passes a segment to the stream, and what is in order now to the conversation.
    fn pass_on(&mut self, arrival: &ArrivedSegment<'_>, context: &mut CaptureContext<'_, '_>) -> SegmentOutcome {
        let conversation = &mut self.conversation;
        conversation.begin(arrival.packet, arrival.time, context);
        self.stream.take(arrival, &mut |chunk| conversation.take_bytes(chunk, context))
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
        let conversation = Conversation::new(old.slot, old.key, old.client, old.is_known_port, old.is_expected);
        *self = Self { packets: self.packets, last_packet: self.last_packet, ..Self::new(conversation) };
    }

    /// Delivers what waits and ends the conversation. The connection stays in the table, so that duplicates of its last
    /// segments are recognised.
    fn end(&mut self, context: &mut CaptureContext<'_, '_>) {
        let conversation = &mut self.conversation;
        self.stream.finish(&mut |chunk| conversation.take_bytes(chunk, context));
        conversation.note_finished(&self.stream, true, context);
        conversation.end(context);
    }
}
