//! Captures: pcap and pcapng of networks and of serial lines, in blocks of bytes, to streams of Modbus.
//!
//! In the order of the way: `file` (records and blocks to packets), `net` (a packet to its segment, through tunnels;
//! `fragments` puts IP together), `table` (connections), `stream` (TCP's bytes in order and once), `evidence` (is it
//! Modbus, and in what framing), `serial` (link types of serial lines), `own` (what modlens has written there itself). Frames are made of the streams by the framers,
//! like those of any other source: `session/capture.rs` stands between.

pub mod adu;
mod evidence;
mod file;
mod fragments;
mod net;
pub mod own;
mod serial;
mod stream;
mod table;

pub use file::{signature, Interface};
pub use net::Endpoint;
pub use serial::Content;
pub use stream::Piece;
pub use table::Ports;

use file::{CaptureFile, CapturedPacket};
use fragments::Fragments;
use serial::Serial;
use table::Table;

use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

use own::Told;

/// What a capture shows, in its order. Slots are numbers that are used again when their connection is closed.
#[derive(Debug)]
pub enum Event<'a> {
    /// A packet: the clock has come to here.
    Time(Ns, &'a Interface),
    /// A connection carries Modbus.
    Opened {
        /// Its slot.
        slot: usize,
        /// Who asks.
        client: Endpoint,
        /// Who answers.
        server: Endpoint,
        /// The framing.
        mode: Mode,
    },
    /// Its bytes, in order.
    Bytes {
        /// Its slot.
        slot: usize,
        /// Who sent them.
        from_client: bool,
        /// The bytes and where they stand.
        piece: Piece<'a>,
        /// They are a message of their own.
        record: bool,
        /// Anything was captured of the server.
        heard: bool,
    },
    /// Something is odd about it.
    Found {
        /// Its slot.
        slot: usize,
        /// What.
        finding: Finding,
        /// In words.
        detail: String,
        /// In which packet.
        packet: u64,
        /// When.
        time: Option<Ns>,
    },
    /// It is over; its slot will be used again.
    Closed {
        /// Its slot.
        slot: usize,
    },
    /// A frame that modlens has decoded before, and what it said of it.
    Told {
        /// Which of the file's interfaces.
        interface: usize,
        /// What captured it.
        by: &'a Interface,
        /// The words.
        told: Told<'a>,
        /// Packet number.
        packet: u64,
        /// When.
        time: Option<Ns>,
    },
    /// Bytes of a serial line.
    Line {
        /// Which of the file's interfaces.
        interface: usize,
        /// What captured them.
        by: &'a Interface,
        /// The bytes and what is known of them.
        content: Content<'a>,
        /// Which of them the receiver marked, where that is told.
        errors: Vec<u32>,
        /// Packet number.
        packet: u64,
        /// When.
        time: Option<Ns>,
    },
}

/// What was not decoded, in packets, by reason; and what is missing.
#[derive(Clone, Debug, Default)]
pub struct LeftOut {
    /// Of other ports, or no TCP or UDP at all.
    pub other: u64,
    /// On Modbus ports, but not Modbus.
    pub not_modbus: u64,
    /// The connections of these.
    pub other_connections: u64,
    /// Port 802: Modbus over TLS.
    pub encrypted: u64,
    /// Acknowledgements and the like.
    pub without_data: u64,
    /// Captured twice.
    pub twice: u64,
    /// Sent again by TCP.
    pub again: u64,
    /// Of link types that are not read.
    pub unknown_link: u64,
    /// Cut short by the capture.
    pub cut: u64,
    /// Bytes of streams that are not in the capture.
    pub missing: u64,
    /// Headers of capturing programs in front of serial frames.
    pub headers: u64,
}

/// Reads a capture.
#[derive(Debug, Default)]
pub struct Capture {
    file: CaptureFile,
    fragments: Fragments,
    table: Table,
    left: LeftOut,
    /// Packets seen by link type that nothing reads.
    strange_link: Option<u16>,
}

impl Capture {
    /// A reader that looks for Modbus on these ports.
    pub fn new(ports: Ports) -> Self {
        Self { table: Table::new(ports), ..Self::default() }
    }

    /// Takes the next block of the file, cut anywhere.
    pub fn push(&mut self, functions: &Functions, block: &[u8], each: &mut dyn FnMut(Event<'_>)) {
        let Self { file, fragments, table, left, strange_link } = self;
        file.push(block, &mut |packet| {
            if let Some(time) = packet.time {
                each(Event::Time(time, packet.by));
            }
            let at = (packet.number, packet.time);
            if net::knows(packet.by.link) {
                let mut seen = false;
                net::segments(packet.by.link, packet.data, fragments, &mut |segment| {
                    seen = true;
                    table.take(functions, segment, at, left, each);
                });
                left.other += u64::from(!seen);
            } else if serial::knows(packet.by.link) {
                line(functions, table, &packet, left, each);
            } else {
                left.unknown_link += 1;
                *strange_link = Some(packet.by.link);
            }
        });
    }

    /// The file has ended.
    pub fn finish(&mut self, functions: &Functions, each: &mut dyn FnMut(Event<'_>)) {
        self.table.finish(functions, &mut self.left, each);
    }

    /// Packets so far.
    pub fn packets(&self) -> u64 {
        self.file.packets
    }

    /// What was left out or is missing, in words, with how often.
    pub fn left_out(&self) -> Vec<(String, u64)> {
        let left = &self.left;
        let link = self.strange_link.map_or(String::new(), |link| format!(" ({link})"));
        let mut all = vec![
            (String::from("packets of other traffic"), left.other),
            (String::from("packets without data"), left.without_data),
            (format!("packets on Modbus ports that are not Modbus, of {} connections", left.other_connections), left.not_modbus),
            (String::from("encrypted packets (Modbus over TLS, port 802)"), left.encrypted),
            (String::from("packets captured twice"), left.twice),
            (String::from("packets that TCP sent again"), left.again),
            (format!("packets of a link type that is not read{link}"), left.unknown_link),
            (String::from("headers of the capturing program"), left.headers),
            (String::from("bytes of streams that are not in the capture"), left.missing),
            (String::from("packets cut short by the capture"), left.cut),
            (String::from("packets of which IP fragments are missing"), self.fragments.lost + self.fragments.open()),
            (String::from("IP fragments cut short by the capture"), self.fragments.cut),
            (String::from("damaged blocks of pcapng"), self.file.damaged_blocks),
        ];
        if let Some((at, what)) = self.file.damage {
            all.push((format!("the rest of the file: at byte {at} stands {what}"), 1));
        }
        all.push((String::from("bytes of a last packet that is not whole"), self.file.incomplete_bytes() as u64));
        all.retain(|(_, count)| *count > 0);
        all
    }
}

fn line(
    functions: &Functions,
    table: &mut Table,
    packet: &CapturedPacket<'_>,
    left: &mut LeftOut,
    each: &mut dyn FnMut(Event<'_>),
) {
    let decoded = packet.by.own.as_ref().is_some_and(|port| port.recording.is_none());
    if let Some(told) = decoded.then(|| serial::told(packet)).flatten() {
        let (interface, by) = (packet.interface, packet.by);
        each(Event::Told { interface, by, told, packet: packet.number, time: packet.time });
        return;
    }
    match serial::read(packet) {
        Serial::Line(content) => {
            left.headers += u64::from(content.header);
            left.cut += u64::from(packet.length > packet.data.len());
            let (interface, by) = (packet.interface, packet.by);
            let errors = if by.own.is_some() { own::errors(packet.options) } else { Vec::new() };
            each(Event::Line { interface, by, content, errors, packet: packet.number, time: packet.time });
        }
        Serial::Network(segment) => table.take(functions, &segment, (packet.number, packet.time), left, each),
        Serial::Nothing => left.other += 1,
    }
}
