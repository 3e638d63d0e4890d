//! Reads captured packets of serial lines: link types 147 (plain RTU frames), 250 (RTAC serial) and 252 (Wireshark's
//! exported PDUs).

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use crate::chunk::Side;
use crate::pcap::file::CapturedPacket;
use crate::pcap::metadata::{self, PacketMetadata};
use crate::pcap::net::{Endpoint, Segment};
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;

/// `LINKTYPE_USER0`, which by convention holds plain RTU frames.
pub const USER0: u16 = 147;
/// `LINKTYPE_RTAC_SERIAL`: reads with a header that states the sender and errors of the receiver.
const RTAC: u16 = 250;
/// `LINKTYPE_WIRESHARK_UPPER_PDU`: tags that name a dissector, followed by the bytes for it.
const WIRESHARK_UPPER_PDU: u16 = 252;

/// The length of the RTAC header.
const RTAC_HEADER_BYTES: usize = 12;

/// The port that stands for the slaves in exported frames of a serial line.
const SLAVE_PORT: u32 = 502;

/// What a packet of a serial line holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct SerialContent<'a> {
    /// The bytes that were on the line.
    pub bytes: &'a [u8],
    /// Who sent them: the master counts as the logging side, so requests were sent and responses received.
    pub side: Option<Side>,
    /// The packet is a whole frame, or the first part of one.
    pub is_whole_frame: bool,
    /// The receiver reported a parity, framing or break error.
    pub has_line_error: bool,
    /// Bytes were lost before these.
    pub follows_loss: bool,
    /// The frame was captured without its checksum.
    pub lacks_checksum: bool,
    /// A header of the capturing program was removed from in front of the bytes.
    pub had_header: bool,
}

/// What a packet of a serial link type holds.
#[derive(Debug)]
pub enum SerialPacket<'a> {
    /// Bytes of a serial line.
    Line(SerialContent<'a>),
    /// A frame of Modbus/TCP that was exported without the headers of its packet.
    Network(Segment<'a>),
    /// Nothing that can be decoded.
    Nothing,
}

/// Whether packets of this link type come from a serial line and can be parsed here.
pub fn is_known_link(link: u16) -> bool {
    matches!(link, USER0 | RTAC | WIRESHARK_UPPER_PDU)
}

/// Parses a packet of one of the known link types.
pub fn read<'a>(packet: &CapturedPacket<'a>) -> SerialPacket<'a> {
    let found = match packet.by.link {
        USER0 => SerialPacket::Line(plain_frame(packet.data)),
        RTAC => rtac_read(packet.data),
        _ => exported_pdu(packet.data),
    };
    let flags = packet_flags(packet);
    match found {
        SerialPacket::Line(content) => SerialPacket::Line(SerialContent {
            // Bits 28 to 31 of `epb_flags` are errors of the receiver: unaligned frame, wrong start delimiter, preamble
            // error, symbol error.
            has_line_error: content.has_line_error || flags >> 28 != 0,
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

/// The frame that modlens itself has exported in this packet, with its metadata; `None` for packets of other programs.
pub fn exported_metadata<'a>(packet: &CapturedPacket<'a>) -> Option<PacketMetadata<'a>> {
    let (tags, pdu) = parse_tags(packet.data).filter(|_| packet.by.link == WIRESHARK_UPPER_PDU)?;
    let bytes = if tags.dissector == b"mbudp" { unwrap_udp_export(pdu)?.0 } else { pdu };
    metadata::packet_metadata(packet.options, bytes)
}

/// The value of the pcapng option `epb_flags`, which is in the byte order of the section; 0 where it is missing.
fn packet_flags(packet: &CapturedPacket<'_>) -> u32 {
    let option = packet.options.iter().find(|option| option.code.0 == 2);
    let bytes = option.and_then(|option| option.as_bytes().ok()?.first_chunk().copied());
    bytes.map_or(0, if packet.big_endian { u32::from_be_bytes } else { u32::from_le_bytes })
}

/// A plain RTU frame. One capturing program puts a header of four bytes in front: if the CRC is valid only without them,
/// they are removed.
fn plain_frame(data: &[u8]) -> SerialContent<'_> {
    let had_header = !crc_valid(data) && data.get(4..).is_some_and(crc_valid);
    let bytes = if had_header { &data[4..] } else { data };
    SerialContent { bytes, is_whole_frame: true, had_header, ..SerialContent::default() }
}

/// A read with the RTAC header, whose event type is in its ninth byte: data sent or received, lost data, receiver errors,
/// or a change of modem lines.
fn rtac_read(data: &[u8]) -> SerialPacket<'_> {
    let Some((header, bytes)) = data.split_at_checked(RTAC_HEADER_BYTES) else { return SerialPacket::Nothing };
    let content = SerialContent { bytes, ..SerialContent::default() };
    SerialPacket::Line(match header[8] {
        1 | 3 => SerialContent { side: Some(Side::Sent), ..content },
        2 | 4 => SerialContent { side: Some(Side::Received), ..content },
        5 | 6 => SerialContent { follows_loss: true, ..content },
        7..=10 => SerialContent { has_line_error: true, ..content },
        // A change of modem lines carries no data.
        _ if bytes.is_empty() => return SerialPacket::Nothing,
        _ => content,
    })
}

/// The tags of an exported PDU that are needed.
#[derive(Default)]
struct Tags<'a> {
    dissector: &'a [u8],
    addresses: [Option<IpAddr>; 2],
    ports: [Option<u32>; 2],
}

/// Parses the tags of an exported PDU, each of which is a 2-byte number, a 2-byte length and a value. The PDU follows
/// tag 0 and is returned beside them.
fn parse_tags(mut data: &[u8]) -> Option<(Tags<'_>, &[u8])> {
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

/// Reads an exported PDU, for which the name of the dissector reports the framing.
fn exported_pdu(data: &[u8]) -> SerialPacket<'_> {
    let Some((tags, pdu)) = parse_tags(data) else { return SerialPacket::Nothing };
    let side = match tags.ports {
        [_, Some(SLAVE_PORT)] => Some(Side::Sent),
        [Some(SLAVE_PORT), _] => Some(Side::Received),
        _ => None,
    };
    let content = SerialContent { side, is_whole_frame: true, ..SerialContent::default() };
    match tags.dissector {
        b"mbrtu" | b"data" | b"data-text-lines" => SerialPacket::Line(SerialContent { bytes: pdu, ..content }),
        b"mbudp" => match unwrap_udp_export(pdu) {
            Some((bytes, lacks_checksum)) => SerialPacket::Line(SerialContent { bytes, lacks_checksum, ..content }),
            None => SerialPacket::Nothing,
        },
        b"mbtcp" => {
            let end = |side: usize| Endpoint {
                address: tags.addresses[side].unwrap_or(IpAddr::V4(Ipv4Addr::UNSPECIFIED)),
                port: tags.ports[side].unwrap_or(0) as u16,
            };
            SerialPacket::Network(Segment { from: end(0), to: end(1), tcp: None, payload: pdu, length: pdu.len(), ident: None })
        }
        _ => SerialPacket::Nothing,
    }
}

/// Unwraps a frame that was exported as Modbus/UDP: an MBAP header and the unit and PDU, followed by what the frame had
/// beside them. That is the CRC of an RTU frame, the whole text of an ASCII frame, or nothing. Returns the bytes of the
/// frame and whether they lack a checksum.
fn unwrap_udp_export(pdu: &[u8]) -> Option<(&[u8], bool)> {
    let announced = usize::from(u16::from_be_bytes(*pdu.get(4..)?.first_chunk()?));
    let adu = pdu.get(MBAP_PREFIX_BYTES..)?;
    let trailer = adu.get(announced..)?;
    Some(match trailer {
        // Text of an ASCII frame has more than two bytes, so that a CRC that begins with a colon is not taken for it.
        [b':', _, _, ..] => (trailer, false),
        [] => (adu, true),
        _ => (adu, false),
    })
}
