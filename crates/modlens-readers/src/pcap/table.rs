//! The connections of a capture: who talks to whom, what it is, in what order.

use std::collections::HashMap;

use foldhash::fast::RandomState;

use crate::pcap::evidence::{classify, Found, Held};
use crate::pcap::net::{Endpoint, Segment};
use crate::pcap::stream::{Arrival, Outcome, Piece, Stream};
use crate::pcap::{Event, LeftOut};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// Connections that are known at once. When there are more, the quarter that has been silent for longest is closed.
const LIMIT: usize = 4096;

/// Where Modbus is looked for.
#[derive(Clone, Debug)]
pub enum Ports {
    /// Everywhere, by evidence.
    Any,
    /// On these.
    Listed(Vec<u16>),
}

/// Modbus over TLS (MODBUS/TCP Security, 2.1).
const SECURE: u16 = 802;

impl Default for Ports {
    fn default() -> Self {
        // Registered for Modbus with IANA.
        Self::Listed(vec![502])
    }
}

impl Ports {
    fn listed(&self, port: u16) -> bool {
        matches!(self, Self::Listed(ports) if ports.contains(&port))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Key {
    low: Endpoint,
    high: Endpoint,
    udp: bool,
}

#[derive(Debug)]
enum State {
    Undecided(Vec<Held>),
    Modbus,
    Other,
    /// Closed; what still comes are copies.
    Over,
}

/// The last datagrams, to know copies again: identification, bytes, time.
type Datagram = (usize, Option<u16>, Vec<u8>, Option<Ns>);

#[derive(Debug)]
struct Connection {
    stream: Stream,
    datagrams: Vec<Datagram>,
    /// Who sent the first SYN, and its number.
    opened: Option<(usize, u32)>,
    packets: u64,
    last: u64,
    talk: Talk,
}

/// What is said on a connection.
#[derive(Debug)]
struct Talk {
    slot: usize,
    key: Key,
    client: usize,
    is_known_port: bool,
    /// The opening was captured: it says who asks.
    seen_opening: bool,
    state: State,
    told_twice: bool,
    heard: [bool; 2],
}

/// What a talk needs of its surroundings.
struct Around<'a, 'b> {
    functions: &'a Functions,
    left: &'a mut LeftOut,
    each: &'a mut (dyn FnMut(Event<'_>) + 'b),
}

/// All connections.
#[derive(Debug, Default)]
pub struct Table {
    ports: Ports,
    index: HashMap<Key, usize, RandomState>,
    slots: Vec<Option<Connection>>,
    free: Vec<usize>,
    /// Where the last packet belonged: the next one mostly does, too.
    latest: Option<(Key, usize)>,
}

/// Datagrams remembered of a pair of hosts.
const REMEMBERED: usize = 8;

/// A datagram with the same bytes and no identification is a copy if it comes within this time.
const AT_ONCE: Ns = 2_000_000;

impl Table {
    /// A table that looks at these ports.
    pub fn new(ports: Ports) -> Self {
        Self { ports, ..Self::default() }
    }

    /// Takes the segment or datagram of a packet.
    pub fn take(
        &mut self,
        functions: &Functions,
        it: &Segment<'_>,
        (packet, time): (u64, Option<Ns>),
        left: &mut LeftOut,
        each: &mut dyn FnMut(Event<'_>),
    ) {
        let listed = [self.ports.listed(it.from.port), self.ports.listed(it.to.port)];
        if listed == [false; 2] && !matches!(self.ports, Ports::Any) {
            let secure = it.tcp.is_some() && (it.from.port == SECURE || it.to.port == SECURE);
            *(if secure { &mut left.encrypted } else { &mut left.other }) += 1;
            return;
        }
        let around = &mut Around { functions, left, each };
        let side = usize::from(it.from > it.to);
        let ends = if side == 0 { [it.from, it.to] } else { [it.to, it.from] };
        let key = Key { low: ends[0], high: ends[1], udp: it.tcp.is_none() };
        let at = self.connection(key, side, listed, around);
        let connection = self.slots[at].as_mut().expect("indexed");
        if let Some(tcp) = it.tcp.filter(|tcp| tcp.opens && tcp.acknowledged.is_none()) {
            connection.opening(side, tcp.sequence, listed, around);
        }
        connection.last = packet;
        connection.packets += 1;
        connection.talk.heard[side] = true;
        if it.length == 0 {
            around.left.without_data += 1;
        }
        match it.tcp {
            Some(tcp) => {
                let (payload, length, ident) = (it.payload, it.length, it.ident);
                connection.segment(&Arrival { side, tcp, payload, length, ident, packet, time }, around);
            }
            None if it.length > 0 => connection.datagram(it, side, (packet, time), around),
            None => {}
        }
    }

    /// The capture is over.
    pub fn finish(&mut self, functions: &Functions, left: &mut LeftOut, each: &mut dyn FnMut(Event<'_>)) {
        let around = &mut Around { functions, left, each };
        let mut open: Vec<usize> = self.index.values().copied().collect();
        open.sort_unstable();
        for at in open {
            self.close(at, around);
        }
    }

    /// The slot of a connection, made where it is new.
    fn connection(&mut self, key: Key, side: usize, listed: [bool; 2], around: &mut Around<'_, '_>) -> usize {
        if let Some((_, at)) = self.latest.filter(|(latest, _)| *latest == key) {
            return at;
        }
        let at = if let Some(&at) = self.index.get(&key) {
            at
        } else {
            if self.index.len() >= LIMIT {
                self.make_room(around);
            }
            let at = self.free.pop().unwrap_or_else(|| {
                self.slots.push(None);
                self.slots.len() - 1
            });
            // The port says who serves; where both or none are listed, the first packet's sender asks.
            let client = if listed == [true, false] { 1 - side } else { side };
            self.slots[at] = Some(Connection::new(Talk::new(at, key, client, listed != [false; 2])));
            self.index.insert(key, at);
            at
        };
        self.latest = Some((key, at));
        at
    }

    fn make_room(&mut self, around: &mut Around<'_, '_>) {
        let mut ages: Vec<(u64, usize)> =
            self.index.values().filter_map(|&at| Some((self.slots[at].as_ref()?.last, at))).collect();
        ages.sort_unstable();
        for (_, at) in ages.into_iter().take(LIMIT / 4) {
            self.close(at, around);
        }
    }

    fn close(&mut self, at: usize, around: &mut Around<'_, '_>) {
        if let Some(mut connection) = self.slots[at].take() {
            connection.end(around);
            self.index.remove(&connection.talk.key);
            self.free.push(at);
            self.latest = None;
        }
    }
}

impl Connection {
    fn new(talk: Talk) -> Self {
        Self { stream: Stream::default(), datagrams: Vec::new(), opened: None, packets: 0, last: 0, talk }
    }

    /// A SYN: the beginning, or that of another connection between the same ports.
    fn opening(&mut self, side: usize, sequence: u32, listed: [bool; 2], around: &mut Around<'_, '_>) {
        let again = self.opened == Some((side, sequence));
        if !again && self.packets > 0 {
            self.restart(around);
        }
        self.opened = Some((side, sequence));
        self.talk.seen_opening = true;
        if !self.talk.is_known_port || listed == [true; 2] {
            self.talk.client = side;
        }
    }

    fn segment(&mut self, arrival: &Arrival<'_>, around: &mut Around<'_, '_>) {
        let talk = &mut self.talk;
        let mut outcome = self.stream.take(arrival, &mut |piece| talk.piece(piece, around));
        if outcome == Outcome::Foreign {
            self.restart(around);
            let talk = &mut self.talk;
            outcome = self.stream.take(arrival, &mut |piece| talk.piece(piece, around));
        }
        self.talk.copies(outcome, arrival.packet, arrival.time, around);
        if arrival.tcp.resets || self.stream.ended() {
            self.end(around);
        }
    }

    fn datagram(&mut self, it: &Segment<'_>, side: usize, (packet, time): (u64, Option<Ns>), around: &mut Around<'_, '_>) {
        let ident = it.ident.filter(|&ident| ident != 0);
        let copy = self.datagrams.iter().any(|(other, id, bytes, then)| {
            let soon = || then.zip(time).is_some_and(|(then, now)| (now - then).abs() < AT_ONCE);
            *other == side && *id == ident && (ident.is_some() || soon()) && bytes == it.payload
        });
        if copy {
            return self.talk.copies(Outcome::Twice, packet, time, around);
        }
        if self.datagrams.len() == REMEMBERED {
            self.datagrams.remove(0);
        }
        self.datagrams.push((side, ident, it.payload.to_vec(), time));
        let cut = it.payload.len() < it.length;
        self.talk.piece(Piece { side, bytes: it.payload, packet, time, missing: 0, cut }, around);
    }

    /// Another connection begins between the same ports.
    fn restart(&mut self, around: &mut Around<'_, '_>) {
        self.end(around);
        let old = &self.talk;
        let talk = Talk::new(old.slot, old.key, old.client, old.is_known_port);
        *self = Self { packets: self.packets, last: self.last, ..Self::new(talk) };
    }

    /// It is over. It stays, to know what comes again.
    fn end(&mut self, around: &mut Around<'_, '_>) {
        let talk = &mut self.talk;
        self.stream.finish(&mut |piece| talk.piece(piece, around));
        self.talk.end(around);
    }
}

impl Talk {
    fn new(slot: usize, key: Key, client: usize, is_known_port: bool) -> Self {
        Self {
            slot,
            key,
            client,
            is_known_port,
            seen_opening: false,
            state: State::Undecided(Vec::new()),
            told_twice: false,
            heard: [false; 2],
        }
    }

    fn copies(&mut self, outcome: Outcome, packet: u64, time: Option<Ns>, around: &mut Around<'_, '_>) {
        let (finding, detail) = match outcome {
            Outcome::Twice => {
                around.left.twice += 1;
                if std::mem::replace(&mut self.told_twice, true) {
                    return;
                }
                let detail = format!("packet {packet} is one of those before, captured again; further ones are counted");
                (Finding::PacketTwice, detail)
            }
            Outcome::Again => {
                around.left.again += 1;
                (Finding::Retransmission, format!("packet {packet} repeats bytes that had come"))
            }
            _ => return,
        };
        if matches!(self.state, State::Modbus) {
            (around.each)(Event::Found { slot: self.slot, finding, detail, packet, time });
        }
    }

    fn piece(&mut self, piece: Piece<'_>, around: &mut Around<'_, '_>) {
        match self.state {
            State::Modbus => self.deliver(piece, around),
            State::Other => around.left.not_modbus += 1,
            State::Undecided(_) | State::Over => {
                // Bytes behind a reset or an end: the ports are used again, or the reset was meant for another.
                if matches!(self.state, State::Over) {
                    self.state = State::Undecided(Vec::new());
                }
                let State::Undecided(held) = &mut self.state else { return };
                held.push(Held {
                    side: piece.side,
                    bytes: piece.bytes.to_vec(),
                    packet: piece.packet,
                    time: piece.time,
                    missing: piece.missing,
                    cut: piece.cut,
                });
                self.decide(false, around);
            }
        }
    }

    fn decide(&mut self, ended: bool, around: &mut Around<'_, '_>) {
        let State::Undecided(held) = &mut self.state else { return };
        let Some(found) = classify(around.functions, held, self.is_known_port, ended) else { return };
        let held = std::mem::take(held);
        let Found::Modbus(mode, asking) = found else {
            around.left.not_modbus += held.len() as u64;
            around.left.other_connections += u64::from(!held.is_empty());
            self.state = State::Other;
            return;
        };
        // Serial devices behind TCP may dial in to their master: there the frames say who asks.
        let doubtful = mode != Mode::Tcp || !(self.seen_opening || self.is_known_port);
        if let Some(asking) = asking.filter(|_| doubtful) {
            self.client = asking;
        }
        self.state = State::Modbus;
        let (client, server) = (self.end_of(self.client), self.end_of(1 - self.client));
        (around.each)(Event::Opened { slot: self.slot, client, server, mode });
        for it in held {
            let Held { side, packet, time, missing, cut, .. } = it;
            self.deliver(Piece { side, bytes: &it.bytes, packet, time, missing, cut }, around);
        }
    }

    fn end_of(&self, side: usize) -> Endpoint {
        if side == 0 {
            self.key.low
        } else {
            self.key.high
        }
    }

    fn deliver(&mut self, piece: Piece<'_>, around: &mut Around<'_, '_>) {
        around.left.missing += u64::from(piece.missing);
        around.left.cut += u64::from(piece.cut);
        let from_client = piece.side == self.client;
        let heard = self.heard[1 - self.client];
        (around.each)(Event::Bytes { slot: self.slot, from_client, piece, record: self.key.udp, heard });
    }

    fn end(&mut self, around: &mut Around<'_, '_>) {
        self.decide(true, around);
        if matches!(self.state, State::Modbus) {
            (around.each)(Event::Closed { slot: self.slot });
            self.state = State::Over;
        }
    }
}
