//! The file around the packets: pcap and pcapng, in blocks cut anywhere.
//!
//! `pcap-parser` reads records and blocks. What stands here is the place of the cut: a record that reaches into the
//! next block is kept until it is whole, all others are read where they lie.

use std::sync::Arc;

use pcap_parser::{
    parse_block_be, parse_block_le, parse_pcap_frame, parse_pcap_frame_be, parse_pcap_frame_modified, parse_pcap_header, Block,
    InterfaceDescriptionBlock, LegacyPcapBlock, OptionCode, PcapNGOption,
};

use crate::pcap::own::{self, Port};
use modlens_protocol::Ns;

/// No capture has longer records; what announces one is damaged. (Wireshark's own limit is 256 KiB a packet.)
const LONGEST: usize = 1 << 26;

/// A block of pcapng is type, length, content, length.
const NG_FRAME: usize = 12;

const SECTION: u32 = 0x0A0D_0D0A;
const OLD_PACKET: u32 = 2;

/// What captured packets, as the file describes it.
#[derive(Clone, Debug, Default)]
pub struct Interface {
    /// LINKTYPE of tcpdump.org.
    pub link: u16,
    /// Name, as `eth0` or `/dev/ttyUSB0`.
    pub name: Option<String>,
    /// What people call it.
    pub description: Option<String>,
    /// What modlens itself has written of it.
    pub own: Option<Port>,
    /// The smallest difference of its times.
    pub resolution: Ns,
    /// Ticks a second.
    units: u64,
    offset_s: i64,
}

/// One captured packet.
#[derive(Debug)]
pub struct Packet<'a> {
    /// Number in the file, from 1, as other tools count.
    pub number: u64,
    /// Which of the file's interfaces; a section's count on.
    pub interface: usize,
    /// What captured it.
    pub by: &'a Interface,
    /// When; ns since 1970.
    pub time: Option<Ns>,
    /// The bytes that were kept.
    pub data: &'a [u8],
    /// The bytes that there were.
    pub length: usize,
    /// Options of a pcapng packet.
    pub options: &'a [PcapNGOption<'a>],
    /// The byte order of their numbers.
    pub big_endian: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Unknown,
    /// pcap: big-endian, header of Kuznetzov's variant.
    Classic {
        big: bool,
        modified: bool,
    },
    Ng {
        big: bool,
    },
}

/// Reads the file.
#[derive(Debug)]
pub struct File {
    kind: Kind,
    /// The beginning of a record whose end is in the next block.
    carry: Vec<u8>,
    interfaces: Vec<Arc<Interface>>,
    /// Interfaces of earlier sections.
    before: usize,
    /// Our own words on this section.
    section: String,
    /// Packets read so far.
    pub packets: u64,
    /// Blocks of pcapng that could not be read.
    pub damaged_blocks: u64,
    /// What is wrong with the file, and at which byte: nothing behind it can be read.
    pub damage: Option<(u64, &'static str)>,
    position: u64,
}

impl Default for File {
    fn default() -> Self {
        Self {
            kind: Kind::Unknown,
            carry: Vec::new(),
            interfaces: Vec::new(),
            before: 0,
            section: String::new(),
            packets: 0,
            damaged_blocks: 0,
            damage: None,
            position: 0,
        }
    }
}

/// Whether a file that begins so is a capture: `pcap` or `pcapng`.
pub fn signature(bytes: &[u8]) -> Option<&'static str> {
    let magic = u32::from_le_bytes(*bytes.first_chunk()?);
    match magic {
        0xA1B2_C3D4 | 0xA1B2_3C4D | 0xA1B2_CD34 | 0xD4C3_B2A1 | 0x4D3C_B2A1 => Some("pcap"),
        SECTION => matches!(bytes.get(8..12)?, [0x4D, 0x3C, 0x2B, 0x1A] | [0x1A, 0x2B, 0x3C, 0x4D]).then_some("pcapng"),
        _ => None,
    }
}

impl File {
    /// Takes the next block; `each` gets the packets that it completes.
    pub fn push(&mut self, mut block: &[u8], each: &mut impl FnMut(Packet<'_>)) {
        while !self.carry.is_empty() && self.damage.is_none() {
            let wanted = match self.wanted(&self.carry) {
                Ok(wanted) => wanted,
                Err(what) => return self.damaged(what),
            };
            let missing = wanted.saturating_sub(self.carry.len());
            if missing == 0 {
                let record = std::mem::take(&mut self.carry);
                self.record(&record, each);
                self.carry = record;
                self.carry.clear();
                break;
            }
            if block.is_empty() {
                return;
            }
            let (more, rest) = block.split_at(missing.min(block.len()));
            self.carry.extend_from_slice(more);
            block = rest;
        }
        while !block.is_empty() && self.damage.is_none() {
            match self.wanted(block) {
                Err(what) => return self.damaged(what),
                Ok(wanted) if wanted > block.len() => {
                    self.carry.extend_from_slice(block);
                    return;
                }
                Ok(wanted) => {
                    let (record, rest) = block.split_at(wanted);
                    self.record(record, each);
                    block = rest;
                }
            }
        }
    }

    /// Bytes of a record that the file ends in.
    pub fn cut(&self) -> usize {
        self.carry.len()
    }

    fn damaged(&mut self, what: &'static str) {
        self.damage = Some((self.position, what));
        self.carry = Vec::new();
    }

    /// The length of the record that begins here, or of so much of it that tells the length.
    fn wanted(&self, bytes: &[u8]) -> Result<usize, &'static str> {
        let word = |at: usize, big: bool| -> Option<usize> {
            let four = *bytes.get(at..)?.first_chunk()?;
            Some(if big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) } as usize)
        };
        match self.kind {
            Kind::Unknown if bytes.len() < NG_FRAME => Ok(NG_FRAME),
            Kind::Unknown => match signature(bytes) {
                Some("pcap") => Ok(24),
                Some(_) => block_length(word(4, bytes[8] == 0x1A)),
                None => Err("not a capture file"),
            },
            Kind::Classic { big, modified } => {
                let header = if modified { 24 } else { 16 };
                let Some(kept) = word(8, big).filter(|_| bytes.len() >= header) else { return Ok(header) };
                if kept > LONGEST {
                    return Err("a packet longer than any");
                }
                Ok(header + kept)
            }
            Kind::Ng { .. } if word(0, false) == Some(SECTION as usize) && bytes.len() < NG_FRAME => Ok(NG_FRAME),
            // A section says its own byte order.
            Kind::Ng { .. } if word(0, false) == Some(SECTION as usize) => block_length(word(4, bytes[8] == 0x1A)),
            Kind::Ng { big } => match word(4, big) {
                None => Ok(8),
                length => block_length(length),
            },
        }
    }

    /// Reads one whole record.
    fn record(&mut self, record: &[u8], each: &mut impl FnMut(Packet<'_>)) {
        match self.kind {
            Kind::Unknown if signature(record) == Some("pcap") => self.header(record),
            Kind::Unknown | Kind::Ng { .. } => self.block(record, each),
            Kind::Classic { big, modified } => {
                let parse = match (big, modified) {
                    (_, true) => parse_pcap_frame_modified,
                    (true, _) => parse_pcap_frame_be,
                    (false, _) => parse_pcap_frame,
                };
                if let Ok((_, frame)) = parse(record) {
                    self.classic(&frame, each);
                }
            }
        }
        self.position += record.len() as u64;
    }

    fn header(&mut self, record: &[u8]) {
        let Ok((_, header)) = parse_pcap_header(record) else { return };
        self.kind = Kind::Classic { big: header.is_bigendian(), modified: header.is_modified_format() };
        let nanoseconds = header.is_nanosecond_precision();
        let units = if nanoseconds { 1_000_000_000 } else { 1_000_000 };
        // The upper bits say how many FCS bytes stand behind each frame.
        let link = header.network.0 as u16;
        let resolution = 1_000_000_000 / units as Ns;
        self.interfaces.push(Arc::new(Interface { link, resolution, units, ..Interface::default() }));
    }

    fn classic(&mut self, frame: &LegacyPcapBlock<'_>, each: &mut impl FnMut(Packet<'_>)) {
        self.packets += 1;
        let by = &*self.interfaces[0];
        let time = Ns::from(frame.ts_sec) * 1_000_000_000 + Ns::from(frame.ts_usec) * by.resolution;
        each(Packet {
            number: self.packets,
            interface: 0,
            by,
            time: Some(time),
            data: frame.data,
            length: frame.origlen as usize,
            options: &[],
            big_endian: false,
        });
    }

    fn block(&mut self, record: &[u8], each: &mut impl FnMut(Packet<'_>)) {
        let section = record.first_chunk().is_some_and(|four| u32::from_le_bytes(*four) == SECTION);
        if section {
            self.kind = Kind::Ng { big: record.get(8) == Some(&0x1A) };
            self.before = self.interfaces.len();
        }
        let big = self.kind == Kind::Ng { big: true };
        let parse = if big { parse_block_be } else { parse_block_le };
        let Ok((_, block)) = parse(record) else {
            self.damaged_blocks += 1;
            return;
        };
        match block {
            Block::SectionHeader(header) => {
                own::words(&header.options).next().unwrap_or_default().clone_into(&mut self.section);
            }
            Block::InterfaceDescription(described) => {
                self.interfaces.push(Arc::new(interface(&described, &self.section)));
            }
            Block::EnhancedPacket(packet) => {
                let kept = packet.data.len().min(packet.caplen as usize);
                let ticks = u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low);
                let length = packet.origlen as usize;
                self.packet(packet.if_id as usize, Some(ticks), &packet.data[..kept], length, &packet.options, each);
            }
            Block::SimplePacket(packet) => {
                let length = packet.origlen as usize;
                let kept = packet.data.len().min(length);
                self.packet(0, None, &packet.data[..kept], length, &[], each);
            }
            Block::Unknown(other) if other.block_type == if big { OLD_PACKET.swap_bytes() } else { OLD_PACKET } => {
                self.old_packet(other.data, big, each);
            }
            _ => {}
        }
    }

    /// The Packet Block, which Enhanced Packet Blocks have replaced.
    fn old_packet(&mut self, data: &[u8], big: bool, each: &mut impl FnMut(Packet<'_>)) {
        let word = |at: usize| -> Option<u32> {
            let four = *data.get(at..)?.first_chunk()?;
            Some(if big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) })
        };
        let (Some(ids), Some(high), Some(low), Some(kept), Some(length)) = (word(0), word(4), word(8), word(12), word(16)) else {
            self.damaged_blocks += 1;
            return;
        };
        let interface = if big { ids >> 16 } else { ids & 0xFFFF };
        let kept = data.len().min(20 + kept as usize);
        let ticks = u64::from(high) << 32 | u64::from(low);
        self.packet(interface as usize, Some(ticks), &data[20..kept], length as usize, &[], each);
    }

    fn packet(
        &mut self,
        interface: usize,
        ticks: Option<u64>,
        data: &[u8],
        length: usize,
        options: &[PcapNGOption<'_>],
        each: &mut impl FnMut(Packet<'_>),
    ) {
        self.packets += 1;
        let interface = self.before + interface;
        let Some(by) = self.interfaces.get(interface) else {
            self.damaged_blocks += 1;
            return;
        };
        let time = ticks.map(|ticks| by.time(ticks));
        let big_endian = self.kind == Kind::Ng { big: true };
        each(Packet { number: self.packets, interface, by, time, data, length, options, big_endian });
    }
}

impl Interface {
    fn time(&self, ticks: u64) -> Ns {
        let units = u128::from(self.units.max(1));
        (u128::from(ticks) * 1_000_000_000 / units) as Ns + self.offset_s * 1_000_000_000
    }
}

fn block_length(length: Option<usize>) -> Result<usize, &'static str> {
    match length {
        Some(length) if length % 4 == 0 && (NG_FRAME..=LONGEST).contains(&length) => Ok(length),
        _ => Err("a block of impossible length"),
    }
}

fn interface(block: &InterfaceDescriptionBlock<'_>, section: &str) -> Interface {
    let text = |code: OptionCode| {
        let option = block.options.iter().find(|option| option.code == code)?;
        Some(String::from_utf8_lossy(option.as_bytes().ok()?).trim_end_matches('\0').to_owned())
    };
    let units = block.ts_resolution().unwrap_or(1_000_000);
    Interface {
        link: block.linktype.0 as u16,
        name: text(OptionCode::IfName),
        description: text(OptionCode::IfDescription),
        own: own::words(&block.options).find_map(|words| Port::read(section, words)),
        resolution: (1_000_000_000 / units.max(1)).max(1) as Ns,
        units,
        offset_s: block.ts_offset(),
    }
}
