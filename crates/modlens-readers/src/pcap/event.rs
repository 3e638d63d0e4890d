//! What a capture yields: the events of its connections and serial lines, and counts of what was skipped.

use crate::pcap::delivered::Conflict;
use crate::pcap::file::Interface;
use crate::pcap::in_turn::PacketInTurn;
use crate::pcap::lifecycle::{Closing, ConnectionHistory};
use crate::pcap::metadata::PacketMetadata;
use crate::pcap::net::Endpoint;
use crate::pcap::serial::SerialContent;
use crate::pcap::stream::StreamChunk;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Why a packet repeats bytes that came before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repetition {
    /// The capture holds the same packet twice. Only the first one of a connection is reported.
    Duplicate,
    /// TCP has transmitted the bytes again.
    Retransmission,
}

/// A TCP connection that is over, or whose capture is.
#[derive(Clone, Copy, Debug)]
pub struct EndedConnection<'a> {
    /// The end that sends requests.
    pub client: Endpoint,
    /// The end that sends responses.
    pub server: Endpoint,
    /// The side of the client: 0 or 1.
    pub client_side: usize,
    /// What its packets have told.
    pub history: &'a ConnectionHistory,
}

/// What is found in a capture, in order. A slot is the number of a connection; it is reused once the connection is closed.
#[derive(Debug)]
pub enum Event<'a> {
    /// The time of a packet of any kind, which moves the clock of the capture on.
    Time(Ns, &'a Interface),
    /// Packets of connections that came in turn, one after the other, all captured by this interface. They mean what the events
    /// of each of them mean (`PacketInTurn::events`).
    InTurn(&'a [PacketInTurn<'a>], &'a Interface),
    /// The first packet of a TCP connection on a port of Modbus, or, on any other port, of one that turned out to carry it.
    Begun {
        /// Slot of the connection.
        slot: usize,
    },
    /// A connection turned out to carry Modbus.
    Opened {
        /// Slot of the connection.
        slot: usize,
        /// The end that sends requests.
        client: Endpoint,
        /// The end that sends responses.
        server: Endpoint,
        /// The framing.
        mode: Mode,
    },
    /// Bytes of a Modbus connection, in order.
    Bytes {
        /// Slot of the connection.
        slot: usize,
        /// The client has sent them.
        from_client: bool,
        /// The bytes, with their packet and what is missing before them.
        chunk: StreamChunk<'a>,
        /// They are a whole message, because they came in a datagram of their own.
        is_whole_message: bool,
        /// Anything that the server has sent was captured, so that a missing response means something.
        server_side_recorded: bool,
    },
    /// A packet of a Modbus connection repeats what was captured before.
    Repetition {
        /// Slot of the connection.
        slot: usize,
        /// Why it repeats them.
        kind: Repetition,
        /// Number of the packet.
        packet: u64,
        /// Time of the packet.
        time: Option<Ns>,
    },
    /// A packet of a Modbus connection contradicts bytes that were captured before: what it says there is in no `Bytes`.
    Conflict {
        /// Slot of the connection.
        slot: usize,
        /// Both versions.
        conflict: &'a Conflict,
        /// Number of the packet.
        packet: u64,
        /// Time of the packet.
        time: Option<Ns>,
    },
    /// One side of a TCP connection has ended it, after all bytes that it has sent.
    Closing {
        /// Slot of the connection.
        slot: usize,
        /// The client has ended it.
        from_client: bool,
        /// How.
        closing: Closing,
        /// Time of the packet.
        time: Option<Ns>,
    },
    /// A connection that has begun or carried Modbus is over, or the capture is; its slot will be reused.
    Closed {
        /// Slot of the connection.
        slot: usize,
        /// What is known of the TCP connection; `None` for datagrams.
        connection: Option<EndedConnection<'a>>,
    },
    /// A frame that modlens has decoded and exported before, which is imported again as it was decoded then.
    Reimported {
        /// Index of the interface in the file.
        interface: usize,
        /// The interface.
        by: &'a Interface,
        /// The frame with its metadata.
        metadata: PacketMetadata<'a>,
        /// Number of the packet.
        packet: u64,
        /// Time of the packet.
        time: Option<Ns>,
    },
    /// Bytes of a serial line.
    Line {
        /// Index of the interface in the file.
        interface: usize,
        /// Index of the first interface of the same section; no packet names an earlier one any more.
        section: usize,
        /// The interface.
        by: &'a Interface,
        /// The bytes and what the packet says about them.
        content: SerialContent<'a>,
        /// Positions of the bytes for which the receiver reported an error, where they are known.
        errors: Vec<u32>,
        /// Number of the packet.
        packet: u64,
        /// Time of the packet.
        time: Option<Ns>,
    },
}

impl<'a> PacketInTurn<'a> {
    /// What it means: its time, and its bytes, if it has brought any.
    pub fn events<'b>(&self, by: &'b Interface) -> impl Iterator<Item = Event<'b>>
    where
        'a: 'b,
    {
        let bytes = (!self.bytes.is_empty()).then(|| Event::Bytes {
            slot: self.slot as usize,
            from_client: self.from_client,
            chunk: self.chunk(),
            is_whole_message: false,
            server_side_recorded: self.server_side_recorded,
        });
        [Some(Event::Time(self.time, by)), bytes].into_iter().flatten()
    }
}

/// The number of packets that were not decoded, by reason, and of bytes that are missing.
#[derive(Clone, Debug, Default)]
pub struct SkipCounts {
    /// Packets of ports that are not listed, or without TCP and UDP.
    pub other: u64,
    /// Packets on Modbus ports that do not carry Modbus.
    pub not_modbus: u64,
    /// The number of connections of these packets.
    pub other_connections: u64,
    /// Packets on port 802, Modbus over TLS.
    pub encrypted: u64,
    /// Packets without payload, such as acknowledgements, that belong to no connection of Modbus.
    pub without_data: u64,
    /// Packets that were captured twice.
    pub duplicates: u64,
    /// Packets with bytes that TCP transmitted again.
    pub retransmissions: u64,
    /// Packets with other bytes than those that TCP had transmitted before in the same place.
    pub conflicts: u64,
    /// Packets of link types that cannot be parsed.
    pub unknown_link: u64,
    /// Packets of which the capture kept only a part.
    pub cut: u64,
    /// Bytes of streams that are not in the capture.
    pub missing: u64,
    /// Headers of capturing programs that were removed in front of serial frames.
    pub headers: u64,
    /// Packets of serial interfaces for which there is no room.
    pub surplus_interfaces: u64,
}
