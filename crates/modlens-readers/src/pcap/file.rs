//! Reads the packets of pcap and pcapng files that arrive in blocks cut anywhere.
//!
//! `pcap-parser` parses the records. This file cuts the input into records: one that reaches into the next block of input
//! is copied until it is whole, all others are parsed where they are.

use std::sync::Arc;

use pcap_parser::{
    parse_block_be, parse_block_le, parse_pcap_frame_modified, parse_pcap_header, Block, InterfaceDescriptionBlock, OptionCode,
    PcapNGOption,
};

use crate::pcap::classic::{numbers_of_header, time_of, ClassicPacket, ClassicPackets, MAX_RECORD_BYTES};
use crate::pcap::metadata::{self, PortMetadata};
use modlens_protocol::Ns;

/// The bytes of a pcapng block beside its content: type, length, and length again.
const NG_BLOCK_OVERHEAD: usize = 12;

/// Block type of pcapng's Section Header Block, the same in both byte orders.
const SECTION_HEADER: u32 = 0x0A0D_0D0A;
/// Block type of pcapng's obsolete Packet Block.
const OBSOLETE_PACKET: u32 = 2;

/// The interface that captured packets, as the file describes it.
#[derive(Clone, Debug, Default)]
pub struct Interface {
    /// Link type, a LINKTYPE number of tcpdump.org.
    pub link: u16,
    /// Its name, such as `eth0` or `/dev/ttyUSB0`.
    pub name: Option<String>,
    /// The description that the file gives for it.
    pub description: Option<String>,
    /// What modlens has written about it, if modlens wrote the file.
    pub written_by_modlens: Option<PortMetadata>,
    /// The smallest difference between two timestamps, in ns.
    pub resolution: Ns,
    /// Ticks of a timestamp per second.
    ticks_per_second: u64,
    /// Seconds to add to all timestamps.
    offset_s: i64,
}

/// One captured packet.
#[derive(Debug)]
pub struct CapturedPacket<'a> {
    /// Number of the packet in the file, from 1, as other tools count.
    pub number: u64,
    /// Index of its interface; those of later sections follow those of earlier ones.
    pub interface: usize,
    /// Index of the first interface of its section.
    pub section: usize,
    /// The interface that captured it.
    pub by: &'a Interface,
    /// When it was captured, in ns since 1970.
    pub time: Option<Ns>,
    /// The bytes that the capture kept.
    pub data: &'a [u8],
    /// The length of the packet on the wire.
    pub length: usize,
    /// The options of a pcapng packet.
    pub options: &'a [PcapNGOption<'a>],
    /// Whether numbers in the options are big-endian.
    pub big_endian: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileFormat {
    Unknown,
    /// pcap; `is_modified` for Kuznetzov's variant with longer record headers.
    Classic {
        is_big_endian: bool,
        is_modified: bool,
    },
    /// pcapng, in the byte order of the current section.
    Ng {
        is_big_endian: bool,
    },
}

/// Cuts a capture file into packets.
#[derive(Debug)]
pub struct CaptureFile {
    format: FileFormat,
    /// The beginning of a record whose end is in the next block of input.
    carry: Vec<u8>,
    interfaces: Vec<Arc<Interface>>,
    /// The number of interfaces in earlier sections.
    earlier_interfaces: usize,
    /// The metadata that modlens has written about the current section; empty in other files.
    section_metadata: String,
    /// Packets read so far.
    pub packets: u64,
    /// Blocks of pcapng that could not be parsed.
    pub damaged_blocks: u64,
    /// Offset and description of damage after which nothing can be read.
    pub damage: Option<(u64, &'static str)>,
    /// Offset in the file of the next record.
    position: u64,
}

impl Default for CaptureFile {
    fn default() -> Self {
        Self {
            format: FileFormat::Unknown,
            carry: Vec::new(),
            interfaces: Vec::new(),
            earlier_interfaces: 0,
            section_metadata: String::new(),
            packets: 0,
            damaged_blocks: 0,
            damage: None,
            position: 0,
        }
    }
}

/// The format of a capture file that begins with these bytes, `pcap` or `pcapng`; `None` for other files.
pub fn signature(bytes: &[u8]) -> Option<&'static str> {
    let magic = u32::from_le_bytes(*bytes.first_chunk()?);
    match magic {
        0xA1B2_C3D4 | 0xA1B2_3C4D | 0xA1B2_CD34 | 0xD4C3_B2A1 | 0x4D3C_B2A1 => Some("pcap"),
        SECTION_HEADER => matches!(bytes.get(8..12)?, [0x4D, 0x3C, 0x2B, 0x1A] | [0x1A, 0x2B, 0x3C, 0x4D]).then_some("pcapng"),
        _ => None,
    }
}

impl CaptureFile {
    /// Takes the record at the head of the input, after what is left of earlier blocks; `each` is called with its packet, if it
    /// has one. Gives what is after it: nothing, if the record goes on in the next block, or if the file is damaged.
    pub fn push_record<'a>(&mut self, mut block: &'a [u8], each: &mut impl FnMut(CapturedPacket<'_>)) -> &'a [u8] {
        while !self.carry.is_empty() && self.damage.is_none() {
            let record_length = match self.record_length(&self.carry) {
                Ok(record_length) => record_length,
                Err(what) => return self.stop_at_damage(what),
            };
            let missing = record_length.saturating_sub(self.carry.len());
            if missing == 0 {
                let record = std::mem::take(&mut self.carry);
                self.parse_record(&record, each);
                self.carry = record;
                self.carry.clear();
                return block;
            }
            if block.is_empty() {
                return block;
            }
            let (more, rest) = block.split_at(missing.min(block.len()));
            self.carry.extend_from_slice(more);
            block = rest;
        }
        if block.is_empty() || self.damage.is_some() {
            return &[];
        }
        match self.record_length(block) {
            Err(what) => self.stop_at_damage(what),
            Ok(record_length) if record_length > block.len() => {
                self.carry.extend_from_slice(block);
                &[]
            }
            Ok(record_length) => {
                let (record, rest) = block.split_at(record_length);
                self.parse_record(record, each);
                rest
            }
        }
    }

    /// The packets of pcap at the head of a block, and the interface that captured them; `None` where records are of another
    /// kind, or if an earlier block has ended inside of one.
    pub fn packets_of<'a>(&self, block: &'a [u8]) -> Option<(ClassicPackets<'a>, Arc<Interface>)> {
        let FileFormat::Classic { is_big_endian, is_modified: false } = self.format else { return None };
        if !self.carry.is_empty() || self.damage.is_some() {
            return None;
        }
        let by = Arc::clone(&self.interfaces[0]);
        Some((ClassicPackets::new(block, is_big_endian, self.packets, by.resolution), by))
    }

    /// Notes that the packets up to here were taken, of those that `packets_of` gave for a block of this length. Gives what is
    /// after them.
    pub fn pass<'a>(&mut self, packets: &ClassicPackets<'a>, block_length: usize) -> &'a [u8] {
        self.packets = packets.number();
        self.position += (block_length - packets.rest().len()) as u64;
        packets.rest()
    }

    /// The bytes of a record that is not complete; at the end of the file they are lost.
    pub fn incomplete_bytes(&self) -> usize {
        self.carry.len()
    }

    /// Notes damage at the current position, after which nothing is read; gives that.
    fn stop_at_damage(&mut self, what: &'static str) -> &'static [u8] {
        self.damage = Some((self.position, what));
        self.carry = Vec::new();
        &[]
    }

    /// The length of the record that begins here, or of its header if `bytes` do not hold the whole header yet.
    fn record_length(&self, bytes: &[u8]) -> Result<usize, &'static str> {
        let word = |at: usize, is_big_endian: bool| -> Option<usize> {
            let four = *bytes.get(at..)?.first_chunk()?;
            Some(if is_big_endian { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) } as usize)
        };
        match self.format {
            FileFormat::Unknown if bytes.len() < NG_BLOCK_OVERHEAD => Ok(NG_BLOCK_OVERHEAD),
            FileFormat::Unknown => match signature(bytes) {
                Some("pcap") => Ok(24),
                Some(_) => block_length(word(4, bytes[8] == 0x1A)),
                None => Err("not a capture file"),
            },
            FileFormat::Classic { is_big_endian, is_modified } => {
                let header = if is_modified { 24 } else { 16 };
                let Some(kept) = word(8, is_big_endian).filter(|_| bytes.len() >= header) else { return Ok(header) };
                if kept > MAX_RECORD_BYTES {
                    return Err("a packet of impossible length");
                }
                Ok(header + kept)
            }
            FileFormat::Ng { .. } if word(0, false) == Some(SECTION_HEADER as usize) && bytes.len() < NG_BLOCK_OVERHEAD => {
                Ok(NG_BLOCK_OVERHEAD)
            }
            // A section header states the byte order of its section.
            FileFormat::Ng { .. } if word(0, false) == Some(SECTION_HEADER as usize) => block_length(word(4, bytes[8] == 0x1A)),
            FileFormat::Ng { is_big_endian } => match word(4, is_big_endian) {
                None => Ok(8),
                length => block_length(length),
            },
        }
    }

    /// Parses one whole record: a file header, a packet of pcap or a block of pcapng.
    fn parse_record(&mut self, record: &[u8], each: &mut impl FnMut(CapturedPacket<'_>)) {
        match self.format {
            FileFormat::Unknown if signature(record) == Some("pcap") => self.parse_file_header(record),
            FileFormat::Unknown | FileFormat::Ng { .. } => self.parse_block(record, each),
            FileFormat::Classic { is_modified: true, .. } => {
                if let Ok((_, frame)) = parse_pcap_frame_modified(record) {
                    self.deliver_classic_packet([frame.ts_sec, frame.ts_usec, frame.origlen], frame.data, each);
                }
            }
            FileFormat::Classic { is_big_endian, .. } => {
                if let Some((header, data)) = record.split_first_chunk() {
                    let [seconds, fraction, _, length] = numbers_of_header(header, is_big_endian);
                    self.deliver_classic_packet([seconds, fraction, length], data, each);
                }
            }
        }
        self.position += record.len() as u64;
    }

    /// Parses the file header of pcap, which describes the only interface.
    fn parse_file_header(&mut self, record: &[u8]) {
        let Ok((_, header)) = parse_pcap_header(record) else { return };
        self.format = FileFormat::Classic { is_big_endian: header.is_bigendian(), is_modified: header.is_modified_format() };
        let nanoseconds = header.is_nanosecond_precision();
        let ticks_per_second = if nanoseconds { 1_000_000_000 } else { 1_000_000 };
        // The upper 16 bits hold the length of the frame check sequence, which is of no interest here.
        let link = header.network.0 as u16;
        let resolution = 1_000_000_000 / ticks_per_second as Ns;
        self.interfaces.push(Arc::new(Interface { link, resolution, ticks_per_second, ..Interface::default() }));
    }

    /// Hands on a packet of pcap with these numbers of its header: seconds, their fraction, and the length on the wire.
    fn deliver_classic_packet(
        &mut self,
        [seconds, fraction, length]: [u32; 3],
        data: &[u8],
        each: &mut impl FnMut(CapturedPacket<'_>),
    ) {
        self.packets += 1;
        let by = &*self.interfaces[0];
        let time = time_of([seconds, fraction], by.resolution);
        each(ClassicPacket { number: self.packets, time, data, length: length as usize }.captured(by));
    }

    /// Parses a block of pcapng; the kinds of blocks that matter are sections, interfaces and packets.
    fn parse_block(&mut self, record: &[u8], each: &mut impl FnMut(CapturedPacket<'_>)) {
        let is_section_header = record.first_chunk().is_some_and(|four| u32::from_le_bytes(*four) == SECTION_HEADER);
        if is_section_header {
            self.format = FileFormat::Ng { is_big_endian: record.get(8) == Some(&0x1A) };
            self.earlier_interfaces = self.interfaces.len();
        }
        let is_big_endian = self.format == FileFormat::Ng { is_big_endian: true };
        let parse = if is_big_endian { parse_block_be } else { parse_block_le };
        let Ok((_, block)) = parse(record) else {
            self.damaged_blocks += 1;
            return;
        };
        match block {
            Block::SectionHeader(header) => {
                metadata::custom_texts(&header.options).next().unwrap_or_default().clone_into(&mut self.section_metadata);
            }
            Block::InterfaceDescription(described) => {
                self.interfaces.push(Arc::new(describe_interface(&described, &self.section_metadata)));
            }
            Block::EnhancedPacket(packet) => {
                let kept = packet.data.len().min(packet.caplen as usize);
                let ticks = u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low);
                let length = packet.origlen as usize;
                self.deliver_packet(packet.if_id as usize, Some(ticks), &packet.data[..kept], length, &packet.options, each);
            }
            Block::SimplePacket(packet) => {
                let length = packet.origlen as usize;
                let kept = packet.data.len().min(length);
                self.deliver_packet(0, None, &packet.data[..kept], length, &[], each);
            }
            Block::Unknown(other)
                if other.block_type == if is_big_endian { OBSOLETE_PACKET.swap_bytes() } else { OBSOLETE_PACKET } =>
            {
                self.parse_obsolete_packet(other.data, is_big_endian, each);
            }
            _ => {}
        }
    }

    /// Parses the content of an obsolete Packet Block, the predecessor of the Enhanced Packet Block.
    fn parse_obsolete_packet(&mut self, data: &[u8], is_big_endian: bool, each: &mut impl FnMut(CapturedPacket<'_>)) {
        let word = |at: usize| -> Option<u32> {
            let four = *data.get(at..)?.first_chunk()?;
            Some(if is_big_endian { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) })
        };
        let (Some(ids), Some(high), Some(low), Some(kept), Some(length)) = (word(0), word(4), word(8), word(12), word(16)) else {
            self.damaged_blocks += 1;
            return;
        };
        let interface = if is_big_endian { ids >> 16 } else { ids & 0xFFFF };
        let kept = data.len().min(20 + kept as usize);
        let ticks = u64::from(high) << 32 | u64::from(low);
        self.deliver_packet(interface as usize, Some(ticks), &data[20..kept], length as usize, &[], each);
    }

    /// Hands on a packet of pcapng; `interface` counts within its section.
    fn deliver_packet(
        &mut self,
        interface: usize,
        ticks: Option<u64>,
        data: &[u8],
        length: usize,
        options: &[PcapNGOption<'_>],
        each: &mut impl FnMut(CapturedPacket<'_>),
    ) {
        self.packets += 1;
        let interface = self.earlier_interfaces + interface;
        let Some(by) = self.interfaces.get(interface) else {
            self.damaged_blocks += 1;
            return;
        };
        let time = ticks.map(|ticks| by.time(ticks));
        let big_endian = self.format == FileFormat::Ng { is_big_endian: true };
        let section = self.earlier_interfaces;
        each(CapturedPacket { number: self.packets, interface, section, by, time, data, length, options, big_endian });
    }
}

impl<'a> ClassicPacket<'a> {
    /// The packet as one of any file; `by` is the only interface of its file.
    pub fn captured(self, by: &'a Interface) -> CapturedPacket<'a> {
        let Self { number, time, data, length } = self;
        let (time, options) = (Some(time), &[][..]);
        CapturedPacket { number, interface: 0, section: 0, by, time, data, length, options, big_endian: false }
    }
}

impl Interface {
    /// Converts a timestamp to ns since 1970.
    fn time(&self, ticks: u64) -> Ns {
        let ticks_per_second = u128::from(self.ticks_per_second.max(1));
        (u128::from(ticks) * 1_000_000_000 / ticks_per_second) as Ns + self.offset_s * 1_000_000_000
    }
}

/// Checks the length that a block announces; an impossible one means that the file is damaged.
fn block_length(length: Option<usize>) -> Result<usize, &'static str> {
    match length {
        Some(length) if length % 4 == 0 && (NG_BLOCK_OVERHEAD..=MAX_RECORD_BYTES).contains(&length) => Ok(length),
        _ => Err("a block of impossible length"),
    }
}

/// Reads an interface description; `section_metadata` is what modlens has written about the section.
fn describe_interface(block: &InterfaceDescriptionBlock<'_>, section_metadata: &str) -> Interface {
    let text = |code: OptionCode| {
        let option = block.options.iter().find(|option| option.code == code)?;
        Some(String::from_utf8_lossy(option.as_bytes().ok()?).trim_end_matches('\0').to_owned())
    };
    let ticks_per_second = block.ts_resolution().unwrap_or(1_000_000);
    Interface {
        link: block.linktype.0 as u16,
        name: text(OptionCode::IfName),
        description: text(OptionCode::IfDescription),
        written_by_modlens: metadata::custom_texts(&block.options).find_map(|words| PortMetadata::read(section_metadata, words)),
        resolution: (1_000_000_000 / ticks_per_second.max(1)).max(1) as Ns,
        ticks_per_second,
        offset_s: block.ts_offset(),
    }
}
