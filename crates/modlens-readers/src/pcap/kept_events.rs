//! Events of a capture that are handled later than they are read, as by another thread.

use std::borrow::Cow;

use crate::pcap::delivered::Conflict;
use crate::pcap::event::{EndedConnection, Event, Repetition};
use crate::pcap::file::Interface;
use crate::pcap::in_turn::{PacketInTurn, MOST_IN_TURN};
use crate::pcap::lifecycle::{Closing, ConnectionHistory};
use crate::pcap::metadata::{FrameMetadata, PacketMetadata};
use crate::pcap::net::Endpoint;
use crate::pcap::serial::SerialContent;
use crate::pcap::stream::StreamChunk;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// What one call of `Capture::push` has reported, in order. Packets that came in turn need no memory of their own.
#[derive(Debug, Default)]
pub struct KeptEvents {
    events: Vec<KeptEvent>,
    /// Packets that came in turn, without their bytes; each event takes the next ones.
    in_turn: Vec<KeptPacket>,
    /// The bytes of connections and serial lines; each event takes the next ones.
    bytes: Vec<u8>,
    /// The interfaces that events name by their place here, each with its address while it was read.
    interfaces: Vec<(usize, Interface)>,
}

/// An event whose bytes and interface are kept beside it: it has their number and place.
#[derive(Debug)]
enum KeptEvent {
    Time(Ns, u32),
    /// So many packets in turn, of this interface.
    InTurn(usize, u32),
    Bytes(KeptBytes),
    Line(Box<KeptLine>),
    Rare(Box<RareEvent>),
}

/// A packet that came in turn: small, because nearly all do.
#[derive(Clone, Copy, Debug)]
struct KeptPacket {
    time: Ns,
    number: u64,
    length: u32,
    slot: u32,
    side: u8,
    from_client: bool,
    server_side_recorded: bool,
}

/// Bytes of a connection whose packet did not come in turn.
#[derive(Clone, Copy, Debug)]
struct KeptBytes {
    time: Option<Ns>,
    packet: u64,
    slot: u32,
    length: u32,
    missing: u32,
    side: u8,
    cut: bool,
    from_client: bool,
    is_whole_message: bool,
    server_side_recorded: bool,
}

#[derive(Debug)]
struct KeptLine {
    interface: usize,
    section: usize,
    by: u32,
    length: usize,
    content: SerialContent<'static>,
    errors: Vec<u32>,
    packet: u64,
    time: Option<Ns>,
}

#[derive(Debug)]
enum RareEvent {
    Begun(usize),
    Opened(usize, Endpoint, Endpoint, Mode),
    Repetition(usize, Repetition, u64, Option<Ns>),
    Conflict(usize, Conflict, u64, Option<Ns>),
    Closing(usize, bool, Closing, Option<Ns>),
    Closed(usize, Option<(Endpoint, Endpoint, usize, ConnectionHistory)>),
    Reimported { interface: usize, by: u32, metadata: KeptMetadata, packet: u64, time: Option<Ns> },
}

#[derive(Debug)]
struct KeptMetadata {
    frame: String,
    fields: FrameMetadata,
    transactions: Vec<String>,
    comments: Vec<String>,
    bytes: Vec<u8>,
}

impl KeptEvents {
    /// Nothing yet, with room for so many packets in turn and bytes (`size`).
    pub fn with_room_of((in_turn, bytes): (usize, usize)) -> Self {
        Self { in_turn: Vec::with_capacity(in_turn), bytes: Vec::with_capacity(bytes), ..Self::default() }
    }

    /// How many packets in turn and bytes there are.
    pub fn size(&self) -> (usize, usize) {
        (self.in_turn.len(), self.bytes.len())
    }

    /// Keeps an event.
    #[inline]
    pub fn push(&mut self, event: Event<'_>) {
        let kept = match event {
            Event::InTurn(packets, by) => {
                for packet in packets {
                    self.bytes.extend_from_slice(packet.bytes);
                    let PacketInTurn { time, number, bytes, slot, side, from_client, server_side_recorded } = *packet;
                    let length = bytes.len() as u32;
                    self.in_turn.push(KeptPacket { time, number, length, slot, side, from_client, server_side_recorded });
                }
                KeptEvent::InTurn(packets.len(), self.interface(by))
            }
            Event::Time(time, by) => KeptEvent::Time(time, self.interface(by)),
            Event::Bytes { slot, from_client, chunk, is_whole_message, server_side_recorded } => {
                self.bytes.extend_from_slice(chunk.bytes);
                KeptEvent::Bytes(KeptBytes {
                    time: chunk.time,
                    packet: chunk.packet,
                    slot: slot as u32,
                    length: chunk.bytes.len() as u32,
                    missing: chunk.missing,
                    side: chunk.side as u8,
                    cut: chunk.cut,
                    from_client,
                    is_whole_message,
                    server_side_recorded,
                })
            }
            Event::Line { interface, section, by, content, errors, packet, time } => {
                self.bytes.extend_from_slice(content.bytes);
                let (by, length) = (self.interface(by), content.bytes.len());
                let content = SerialContent { bytes: &[], ..content };
                KeptEvent::Line(Box::new(KeptLine { interface, section, by, length, content, errors, packet, time }))
            }
            Event::Begun { slot } => RareEvent::Begun(slot).kept(),
            Event::Opened { slot, client, server, mode } => RareEvent::Opened(slot, client, server, mode).kept(),
            Event::Repetition { slot, kind, packet, time } => RareEvent::Repetition(slot, kind, packet, time).kept(),
            Event::Conflict { slot, conflict, packet, time } => RareEvent::Conflict(slot, conflict.clone(), packet, time).kept(),
            Event::Closing { slot, from_client, closing, time } => RareEvent::Closing(slot, from_client, closing, time).kept(),
            Event::Closed { slot, connection } => {
                let connection = connection.map(|it| (it.client, it.server, it.client_side, it.history.clone()));
                RareEvent::Closed(slot, connection).kept()
            }
            Event::Reimported { interface, by, metadata, packet, time } => {
                let (by, metadata) = (self.interface(by), KeptMetadata::of(&metadata));
                RareEvent::Reimported { interface, by, metadata, packet, time }.kept()
            }
        };
        self.events.push(kept);
    }

    /// The place of an interface among those that are kept. While one block is read, interfaces stay where they are.
    #[inline]
    fn interface(&mut self, by: &Interface) -> u32 {
        let address = std::ptr::from_ref(by).addr();
        let known = self.interfaces.iter().rposition(|(known, _)| *known == address);
        known.unwrap_or_else(|| {
            self.interfaces.push((address, by.clone()));
            self.interfaces.len() - 1
        }) as u32
    }

    /// Calls `each` with every event that was kept, in their order.
    pub fn replay(&self, mut each: impl FnMut(Event<'_>)) {
        let mut bytes = self.bytes.as_slice();
        let mut next = |length: usize| {
            let (these, rest) = bytes.split_at(length);
            bytes = rest;
            these
        };
        let by = |index: u32| &self.interfaces[index as usize].1;
        let (mut in_turn, mut these) = (self.in_turn.iter(), Vec::with_capacity(MOST_IN_TURN));
        for kept in &self.events {
            match kept {
                KeptEvent::InTurn(count, interface) => {
                    these.clear();
                    these.extend(in_turn.by_ref().take(*count).map(|kept| kept.packet(next(kept.length as usize))));
                    each(Event::InTurn(&these, by(*interface)));
                }
                KeptEvent::Time(time, interface) => each(Event::Time(*time, by(*interface))),
                KeptEvent::Bytes(kept) => each(kept.event(next(kept.length as usize))),
                KeptEvent::Line(line) => each(Event::Line {
                    interface: line.interface,
                    section: line.section,
                    by: by(line.by),
                    content: SerialContent { bytes: next(line.length), ..line.content },
                    errors: line.errors.clone(),
                    packet: line.packet,
                    time: line.time,
                }),
                KeptEvent::Rare(rare) => rare.replay(by, &mut each),
            }
        }
    }
}

impl KeptPacket {
    #[inline]
    fn packet<'a>(&self, bytes: &'a [u8]) -> PacketInTurn<'a> {
        let Self { time, number, slot, side, from_client, server_side_recorded, .. } = *self;
        PacketInTurn { time, number, bytes, slot, side, from_client, server_side_recorded }
    }
}

impl KeptBytes {
    fn event<'a>(&self, bytes: &'a [u8]) -> Event<'a> {
        Event::Bytes {
            slot: self.slot as usize,
            from_client: self.from_client,
            chunk: StreamChunk {
                side: usize::from(self.side),
                bytes,
                packet: self.packet,
                time: self.time,
                missing: self.missing,
                cut: self.cut,
            },
            is_whole_message: self.is_whole_message,
            server_side_recorded: self.server_side_recorded,
        }
    }
}

impl RareEvent {
    fn kept(self) -> KeptEvent {
        KeptEvent::Rare(Box::new(self))
    }

    fn replay<'a>(&'a self, by: impl Fn(u32) -> &'a Interface, each: &mut impl FnMut(Event<'_>)) {
        each(match self {
            Self::Begun(slot) => Event::Begun { slot: *slot },
            Self::Opened(slot, client, server, mode) => {
                Event::Opened { slot: *slot, client: *client, server: *server, mode: *mode }
            }
            Self::Repetition(slot, kind, packet, time) => {
                Event::Repetition { slot: *slot, kind: *kind, packet: *packet, time: *time }
            }
            Self::Conflict(slot, conflict, packet, time) => {
                Event::Conflict { slot: *slot, conflict, packet: *packet, time: *time }
            }
            Self::Closing(slot, from_client, closing, time) => {
                Event::Closing { slot: *slot, from_client: *from_client, closing: *closing, time: *time }
            }
            Self::Closed(slot, connection) => {
                let connection = connection.as_ref().map(|(client, server, client_side, history)| EndedConnection {
                    client: *client,
                    server: *server,
                    client_side: *client_side,
                    history,
                });
                Event::Closed { slot: *slot, connection }
            }
            Self::Reimported { interface, by: index, metadata, packet, time } => {
                let (by, metadata) = (by(*index), metadata.borrowed());
                Event::Reimported { interface: *interface, by, metadata, packet: *packet, time: *time }
            }
        });
    }
}

impl KeptMetadata {
    fn of(metadata: &PacketMetadata<'_>) -> Self {
        let owned = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
        Self {
            frame: metadata.frame.to_owned(),
            fields: metadata.fields,
            transactions: owned(&metadata.transactions),
            comments: owned(&metadata.comments),
            bytes: metadata.bytes.to_vec(),
        }
    }

    fn borrowed(&self) -> PacketMetadata<'_> {
        PacketMetadata {
            frame: &self.frame,
            fields: self.fields,
            transactions: self.transactions.iter().map(String::as_str).collect(),
            comments: self.comments.iter().map(String::as_str).collect(),
            bytes: Cow::Borrowed(&self.bytes),
        }
    }
}
