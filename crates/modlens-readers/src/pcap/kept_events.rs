//! Events of a capture that are handled later than they are read, as by another thread.

use std::borrow::Cow;

use crate::pcap::event::{EndedConnection, Event, Repetition};
use crate::pcap::file::Interface;
use crate::pcap::lifecycle::{Closing, ConnectionHistory};
use crate::pcap::metadata::{FrameMetadata, PacketMetadata};
use crate::pcap::net::Endpoint;
use crate::pcap::serial::SerialContent;
use crate::pcap::stream::StreamChunk;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// What one call of `Capture::push` has reported, in order. The bytes of a packet and its time need no memory of their own.
#[derive(Debug, Default)]
pub struct KeptEvents {
    events: Vec<KeptEvent>,
    /// The bytes of connections and serial lines; each event takes the next ones.
    bytes: Vec<u8>,
    /// The interfaces that events name by their place here, each with its address while it was read.
    interfaces: Vec<(usize, Interface)>,
}

/// An event whose bytes and interface are kept beside it: it has their number and place.
#[derive(Debug)]
enum KeptEvent {
    Time(Ns, u32),
    Bytes(KeptBytes),
    Line(Box<KeptLine>),
    Rare(Box<RareEvent>),
}

/// Bytes of a connection, and nearly always the time of their packet, which came right before them: small, because there is
/// one of these for each packet.
#[derive(Clone, Copy, Debug)]
struct KeptBytes {
    time: Ns,
    packet: u64,
    slot: u32,
    length: u32,
    missing: u32,
    /// Where `follows_time`, the interface that the time came from.
    interface: u32,
    side: u8,
    cut: bool,
    has_time: bool,
    follows_time: bool,
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
    /// Nothing yet, with room for so many events and bytes (`size`).
    pub fn with_room_of((events, bytes): (usize, usize)) -> Self {
        Self { events: Vec::with_capacity(events), bytes: Vec::with_capacity(bytes), interfaces: Vec::new() }
    }

    /// How many events and bytes there are.
    pub fn size(&self) -> (usize, usize) {
        (self.events.len(), self.bytes.len())
    }

    /// Keeps an event.
    #[inline]
    pub fn push(&mut self, event: Event<'_>) {
        let kept = match event {
            Event::Time(time, by) => KeptEvent::Time(time, self.interface(by)),
            Event::Bytes { slot, from_client, chunk, is_whole_message, server_side_recorded } => {
                let interface = self.take_time(chunk.time);
                self.bytes.extend_from_slice(chunk.bytes);
                KeptEvent::Bytes(KeptBytes {
                    time: chunk.time.unwrap_or_default(),
                    packet: chunk.packet,
                    slot: slot as u32,
                    length: chunk.bytes.len() as u32,
                    missing: chunk.missing,
                    interface: interface.unwrap_or_default(),
                    side: chunk.side as u8,
                    cut: chunk.cut,
                    has_time: chunk.time.is_some(),
                    follows_time: interface.is_some(),
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

    /// Takes back the event before if it is this time, which the event at hand has, too; gives its interface.
    #[inline]
    fn take_time(&mut self, time: Option<Ns>) -> Option<u32> {
        match self.events.last() {
            Some(KeptEvent::Time(before, interface)) if Some(*before) == time => {
                let interface = *interface;
                self.events.pop();
                Some(interface)
            }
            _ => None,
        }
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
        for kept in &self.events {
            match kept {
                KeptEvent::Time(time, interface) => each(Event::Time(*time, by(*interface))),
                KeptEvent::Bytes(kept) => {
                    if kept.follows_time {
                        each(Event::Time(kept.time, by(kept.interface)));
                    }
                    each(kept.event(next(kept.length as usize)));
                }
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

impl KeptBytes {
    #[inline]
    fn event<'a>(&self, bytes: &'a [u8]) -> Event<'a> {
        Event::Bytes {
            slot: self.slot as usize,
            from_client: self.from_client,
            chunk: StreamChunk {
                side: usize::from(self.side),
                bytes,
                packet: self.packet,
                time: self.has_time.then_some(self.time),
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
