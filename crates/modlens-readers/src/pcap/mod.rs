//! Reads captures (pcap and pcapng) of networks and of serial lines, and turns them into byte streams of Modbus.
//!
//! Nearly all packets of a connection are like the one before, go straight to its stream (`classic`, `plain`,
//! `known_connections`) and are handed on many at once (`in_turn`). For the others, in the order in which data passes through:
//! `file` cuts the file into packets, `net` finds the TCP or UDP segment in a packet through all tunnels (`fragments` reassembles
//! IP packets), `connections` finds its connection, `stream` puts the bytes of TCP in order (`delivered`
//! compares them with those that come again), `conversation` reports them and the events of the connection, `classify` decides whether it carries Modbus and in which framing, and `lifecycle` keeps what its
//! packets tell beside their bytes: opened, refused, ended, by whom. `serial` reads the link types of serial lines, and `metadata`
//! the metadata that modlens itself has written. The engine makes frames of the streams; where another thread reads, it takes the
//! events from `kept_events`.

pub mod adu;
mod classic;
mod classify;
mod connections;
mod conversation;
mod delivered;
mod event;
mod file;
mod fragments;
mod frame_parts;
mod in_turn;
mod kept_events;
mod known_connections;
mod lifecycle;
pub mod metadata;
mod net;
mod plain;
mod serial;
mod stream;
#[cfg(test)]
mod tests;

pub use connections::Ports;
pub use delivered::Conflict;
pub use event::{EndedConnection, Event, Repetition, SkipCounts};
pub use file::{signature, Interface};
pub use in_turn::PacketInTurn;
pub use kept_events::KeptEvents;
pub use lifecycle::{Closing, ConnectionHistory, SideFraming};
pub use net::Endpoint;
pub use serial::SerialContent;
pub use stream::StreamChunk;

use classic::ClassicPackets;
use connections::ConnectionTable;
use file::{CaptureFile, CapturedPacket};
use fragments::Fragments;
use frame_parts::FrameParts;
use in_turn::MOST_IN_TURN;
use serial::SerialPacket;

use modlens_protocol::functions::Functions;

/// The serial interfaces of one section that are read. Each becomes a bus, which takes about 150 kB.
const MAX_SERIAL_INTERFACES: usize = 1_000;

/// Reads a capture that arrives in blocks.
#[derive(Debug, Default)]
pub struct Capture {
    file: CaptureFile,
    fragments: Fragments,
    table: ConnectionTable,
    skipped: SkipCounts,
    parts: FrameParts,
    /// The last link type that could not be parsed.
    unknown_link_type: Option<u16>,
    /// How many packets have taken the short way.
    plain: u64,
    /// All packets take the general way; only tests ask for that.
    is_general: bool,
}

impl Capture {
    /// A reader that expects Modbus on these ports.
    pub fn new(ports: Ports) -> Self {
        Self { table: ConnectionTable::new(ports), ..Self::default() }
    }

    /// Takes the next block of the file, cut anywhere; `each` is called with everything that it shows.
    pub fn push(&mut self, functions: &Functions, block: &[u8], each: &mut impl FnMut(Event<'_>)) {
        // What is left of the reader takes packets while this cuts them out of the block.
        let mut file = std::mem::take(&mut self.file);
        let mut rest = block;
        loop {
            if let Some((mut packets, by)) = file.packets_of(rest) {
                self.take_block(functions, &mut packets, &by, each);
                rest = file.pass(&packets, rest.len());
            }
            rest = file.push_record(rest, &mut |packet| self.take_one(functions, &packet, each));
            if rest.is_empty() {
                break;
            }
        }
        self.file = file;
    }

    /// Takes the packets of pcap at the head of a block that are whole in it. Those that come in turn are handed on many at once.
    fn take_block(
        &mut self,
        functions: &Functions,
        packets: &mut ClassicPackets<'_>,
        by: &Interface,
        each: &mut impl FnMut(Event<'_>),
    ) {
        let mut in_turn = Vec::with_capacity(MOST_IN_TURN);
        for packet in packets {
            let segment = plain::segment(by.link, packet.data).filter(|_| !self.is_general);
            let taken = segment.and_then(|it| self.table.take_plain(functions, &it, (packet.number, packet.time)));
            if let Some(taken) = taken {
                in_turn.push(taken);
                if in_turn.len() < MOST_IN_TURN {
                    continue;
                }
            }
            if !in_turn.is_empty() {
                each(Event::InTurn(&in_turn, by));
                self.plain += in_turn.len() as u64;
                in_turn.clear();
            }
            if taken.is_none() {
                each(Event::Time(packet.time, by));
                self.take_packet(functions, &packet.captured(by), each);
            }
        }
        if !in_turn.is_empty() {
            each(Event::InTurn(&in_turn, by));
            self.plain += in_turn.len() as u64;
        }
    }

    /// Takes a packet of which the bytes are not those of a block, or that is not one of pcap.
    fn take_one(&mut self, functions: &Functions, packet: &CapturedPacket<'_>, each: &mut impl FnMut(Event<'_>)) {
        if let Some(time) = packet.time {
            let segment = plain::segment(packet.by.link, packet.data).filter(|_| !self.is_general);
            let taken = segment.and_then(|it| self.table.take_plain(functions, &it, (packet.number, time)));
            if let Some(taken) = taken {
                self.plain += 1;
                return each(Event::InTurn(&[taken], packet.by));
            }
            each(Event::Time(time, packet.by));
        }
        self.take_packet(functions, packet, each);
    }

    /// Takes a packet that is not plain.
    #[cold]
    fn take_packet(&mut self, functions: &Functions, packet: &CapturedPacket<'_>, each: &mut dyn FnMut(Event<'_>)) {
        let Self { fragments, table, skipped, parts, .. } = self;
        if net::is_known_link(packet.by.link) {
            let mut has_segment = false;
            net::segments(packet.by.link, packet.data, fragments, &mut |segment| {
                has_segment = true;
                table.take(functions, segment, (packet.number, packet.time), skipped, each);
            });
            skipped.other += u64::from(!has_segment);
        } else if serial::is_known_link(packet.by.link) {
            read_serial_packet(functions, (table, parts), packet, skipped, each);
        } else {
            skipped.unknown_link += 1;
            self.unknown_link_type = Some(packet.by.link);
        }
    }

    /// Ends all connections, because the file has ended.
    pub fn finish(&mut self, functions: &Functions, each: &mut dyn FnMut(Event<'_>)) {
        self.table.finish(functions, &mut self.skipped, each);
    }

    /// The number of packets so far.
    pub fn packets(&self) -> u64 {
        self.file.packets
    }

    /// What was skipped or is missing, in the words shown to users, with the number of packets or bytes.
    pub fn left_out(&self) -> Vec<(String, u64)> {
        let skipped = &self.skipped;
        let link = self.unknown_link_type.map_or(String::new(), |link| format!(" ({link})"));
        let mut all = vec![
            (String::from("packets of other protocols or ports (try --port)"), skipped.other),
            (String::from("packets without payload"), skipped.without_data),
            (
                format!("packets on Modbus ports that are not Modbus, in {} connections", skipped.other_connections),
                skipped.not_modbus,
            ),
            (String::from("encrypted packets (Modbus over TLS, port 802)"), skipped.encrypted),
            (String::from("packets captured twice"), skipped.duplicates),
            (String::from("packets that TCP retransmitted"), skipped.retransmissions),
            (String::from("packets with other bytes than TCP had transmitted before"), skipped.conflicts),
            (format!("packets of an unsupported link type{link}"), skipped.unknown_link),
            (String::from("headers of the capturing program"), skipped.headers),
            (String::from("bytes of connections that are missing from the capture"), skipped.missing),
            (String::from("packets truncated by the capture"), skipped.cut),
            (String::from("packets with missing IP fragments"), self.fragments.lost + self.fragments.incomplete()),
            (String::from("IP fragments truncated by the capture"), self.fragments.cut),
            (
                format!("packets of serial interfaces beyond the {MAX_SERIAL_INTERFACES} that are read"),
                skipped.surplus_interfaces,
            ),
            (String::from("damaged blocks of pcapng"), self.file.damaged_blocks),
        ];
        if let Some((at, what)) = self.file.damage {
            all.push((format!("the rest of the file: {what} at byte {at}"), 1));
        }
        all.push((String::from("bytes of an incomplete last packet"), self.file.incomplete_bytes() as u64));
        all.retain(|(_, count)| *count > 0);
        all
    }
}

/// Reads a packet of a serial line: an exported frame with its metadata, bytes of the line, or an exported Modbus/TCP frame.
fn read_serial_packet(
    functions: &Functions,
    (table, parts): (&mut ConnectionTable, &mut FrameParts),
    packet: &CapturedPacket<'_>,
    skipped: &mut SkipCounts,
    each: &mut dyn FnMut(Event<'_>),
) {
    let decoded = packet.by.written_by_modlens.as_ref().is_some_and(|port| port.recording.is_none());
    if let Some(metadata) = decoded.then(|| serial::exported_metadata(packet)).flatten() {
        let (interface, by) = (packet.interface, packet.by);
        each(Event::Reimported { interface, by, metadata, packet: packet.number, time: packet.time });
        return;
    }
    match serial::read(packet) {
        SerialPacket::Line(_) if packet.interface - packet.section >= MAX_SERIAL_INTERFACES => skipped.surplus_interfaces += 1,
        SerialPacket::Line(mut content) => {
            if packet.by.link == serial::USER0 {
                content.is_whole_frame = parts.begins_frame(packet.interface, content.bytes, packet.time);
            }
            skipped.headers += u64::from(content.had_header);
            skipped.cut += u64::from(packet.length > packet.data.len());
            let (interface, section, by) = (packet.interface, packet.section, packet.by);
            let errors = if by.written_by_modlens.is_some() { metadata::errors(packet.options) } else { Vec::new() };
            each(Event::Line { interface, section, by, content, errors, packet: packet.number, time: packet.time });
        }
        SerialPacket::Network(segment) => table.take(functions, &segment, (packet.number, packet.time), skipped, each),
        SerialPacket::Nothing => skipped.other += 1,
    }
}
