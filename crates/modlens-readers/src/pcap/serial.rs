//! Captures of serial lines: link types 147 (bare frames), 250 (RTAC serial) and 252 (Wireshark's exported PDUs).

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use crate::chunk::Side;
use crate::pcap::file::CapturedPacket;
use crate::pcap::net::{Endpoint, Segment};
use crate::pcap::own::{self, Told};
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::mbap::HEADER as MBAP;

/// USER0: by agreement, bare RTU frames.
const USER0: u16 = 147;
/// RTAC serial: reads with a header that says who sent and what the receiver marked.
const RTAC: u16 = 250;
/// Exported PDUs: tags that name a dissector, then its bytes.
const UPPER_PDU: u16 = 252;

/// Bytes of the RTAC header.
const RTAC_HEADER: usize = 12;

/// The port that stands for the slaves in exported serial frames.
const SLAVES: u32 = 502;

/// What a packet of a serial line holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Content<'a> {
    /// The bytes of the line.
    pub bytes: &'a [u8],
    /// Who sent them: the side that asks has sent.
    pub side: Option<Side>,
    /// The packet is a frame of its own.
    pub record: bool,
    /// The receiver marked an error.
    pub line_error: bool,
    /// Bytes were lost before.
    pub hole: bool,
    /// The frame stands here without its checksum.
    pub no_checksum: bool,
    /// Bytes in front that are not of the line: a header of the program that captured.
    pub header: bool,
}

/// What the packet of a serial link type is.
#[derive(Debug)]
pub enum Serial<'a> {
    /// Bytes of a line.
    Line(Content<'a>),
    /// Modbus/TCP that was exported without its packets.
    Network(Segment<'a>),
    /// Neither.
    Nothing,
}

/// Whether packets of this link type are read here.
pub fn knows(link: u16) -> bool {
    matches!(link, USER0 | RTAC | UPPER_PDU)
}

/// Reads a packet.
pub fn read<'a>(packet: &CapturedPacket<'a>) -> Serial<'a> {
    let found = match packet.by.link {
        USER0 => Serial::Line(bare(packet.data)),
        RTAC => rtac(packet.data),
        _ => exported(packet.data),
    };
    let flags = flags(packet);
    match found {
        Serial::Line(content) => Serial::Line(Content {
            // Bits 28 to 31 are errors of the receiver: unaligned, start and preamble, symbol.
            line_error: content.line_error || flags >> 28 != 0,
            side: content.side.or(match flags & 3 {
                1 => Some(Side::Received),
                2 => Some(Side::Sent),
                _ => None,
            }),
            ..content
        }),
        other => other,
    }
}

/// The frame of an exported PDU as modlens has told it; `None` where it has not.
pub fn told<'a>(packet: &CapturedPacket<'a>) -> Option<Told<'a>> {
    let (tags, pdu) = tags(packet.data).filter(|_| packet.by.link == UPPER_PDU)?;
    let bytes = if tags.dissector == b"mbudp" { wrapped(pdu)?.0 } else { pdu };
    own::told(packet.options, bytes)
}

/// What pcapng says of a packet, in the order of the machine that wrote it (option `epb_flags`).
fn flags(packet: &CapturedPacket<'_>) -> u32 {
    let option = packet.options.iter().find(|option| option.code.0 == 2);
    let bytes = option.and_then(|option| option.as_bytes().ok()?.first_chunk().copied());
    bytes.map_or(0, if packet.big_endian { u32::from_be_bytes } else { u32::from_le_bytes })
}

/// A frame; one program puts a header of four bytes in front, which the checksum tells.
fn bare(data: &[u8]) -> Content<'_> {
    let header = !crc_valid(data) && data.get(4..).is_some_and(crc_valid);
    let bytes = if header { &data[4..] } else { data };
    Content { bytes, record: true, header, ..Content::default() }
}

fn rtac(data: &[u8]) -> Serial<'_> {
    let Some((header, bytes)) = data.split_at_checked(RTAC_HEADER) else { return Serial::Nothing };
    let content = Content { bytes, ..Content::default() };
    Serial::Line(match header[8] {
        1 | 3 => Content { side: Some(Side::Sent), ..content },
        2 | 4 => Content { side: Some(Side::Received), ..content },
        5 | 6 => Content { hole: true, ..content },
        7..=10 => Content { line_error: true, ..content },
        // Modem lines that changed.
        _ if bytes.is_empty() => return Serial::Nothing,
        _ => content,
    })
}

/// The tags of an exported PDU that matter here.
#[derive(Default)]
struct Tags<'a> {
    dissector: &'a [u8],
    addresses: [Option<IpAddr>; 2],
    ports: [Option<u32>; 2],
}

/// Tags are two bytes of number, two of length, the value; what is behind tag 0 is the PDU.
fn tags(mut data: &[u8]) -> Option<(Tags<'_>, &[u8])> {
    let mut tags = Tags::default();
    loop {
        let tag = u16::from_be_bytes(*data.first_chunk()?);
        let length = usize::from(u16::from_be_bytes(*data.get(2..)?.first_chunk()?));
        let value = data.get(4..4 + length)?;
        data = &data[4 + length..];
        let port = || value.first_chunk().map(|four| u32::from_be_bytes(*four));
        match tag {
            0 => return Some((tags, data)),
            12 => tags.dissector = value.trim_ascii_end().split(|&byte| byte == 0).next().unwrap_or(&[]),
            20 | 21 => {
                tags.addresses[usize::from(tag - 20)] = value.first_chunk().map(|four: &[u8; 4]| Ipv4Addr::from(*four).into());
            }
            22 | 23 => {
                tags.addresses[usize::from(tag - 22)] = value.first_chunk().map(|all: &[u8; 16]| Ipv6Addr::from(*all).into());
            }
            25 | 26 => tags.ports[usize::from(tag - 25)] = port(),
            _ => {}
        }
    }
}

fn exported(data: &[u8]) -> Serial<'_> {
    let Some((tags, pdu)) = tags(data) else { return Serial::Nothing };
    let side = match tags.ports {
        [_, Some(SLAVES)] => Some(Side::Sent),
        [Some(SLAVES), _] => Some(Side::Received),
        _ => None,
    };
    let content = Content { side, record: true, ..Content::default() };
    match tags.dissector {
        b"mbrtu" | b"data" | b"data-text-lines" => Serial::Line(Content { bytes: pdu, ..content }),
        b"mbudp" => match wrapped(pdu) {
            Some((bytes, no_checksum)) => Serial::Line(Content { bytes, no_checksum, ..content }),
            None => Serial::Nothing,
        },
        b"mbtcp" => {
            let end = |side: usize| Endpoint {
                address: tags.addresses[side].unwrap_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED)),
                port: tags.ports[side].unwrap_or(0) as u16,
            };
            Serial::Network(Segment { from: end(0), to: end(1), tcp: None, payload: pdu, length: pdu.len(), ident: None })
        }
        _ => Serial::Nothing,
    }
}

/// The frame behind the MBAP header that stands for it: with its CRC, as the text of an ASCII frame, or without checksum.
fn wrapped(pdu: &[u8]) -> Option<(&[u8], bool)> {
    let announced = usize::from(u16::from_be_bytes(*pdu.get(4..)?.first_chunk()?));
    let adu = pdu.get(MBAP..)?;
    let behind = adu.get(announced..)?;
    Some(match behind {
        // Two bytes are a CRC, whichever they are.
        [b':', _, _, ..] => (behind, false),
        [] => (adu, true),
        _ => (adu, false),
    })
}
