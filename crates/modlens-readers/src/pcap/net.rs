//! Finds the TCP segment or UDP datagram in a captured packet, through all tunnels that a mirror port may add.
//!
//! `etherparse` parses the headers of Ethernet, VLAN, IP, TCP and UDP; the few bytes of MPLS, GRE, ERSPAN and VXLAN are
//! parsed here. IP and TCP checksums are not verified: network cards have done so already, and a packet that was captured
//! on the host which sent it has no valid checksum because its card had yet to fill it in.

use std::net::IpAddr;

use etherparse::{ether_type, ip_number, EtherType, Ethernet2HeaderSlice, IpNumber, SingleVlanHeaderSlice};
use etherparse::{Ipv6ExtensionSlice, LaxIpv4Slice, LaxIpv6Slice, TcpSlice, UdpSlice};

use crate::pcap::fragments::{FragmentPosition, Fragments};

/// One end of a connection: an IP address and a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Endpoint {
    /// IP address.
    pub address: IpAddr,
    /// TCP or UDP port.
    pub port: u16,
}

impl std::fmt::Display for Endpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.address {
            IpAddr::V4(address) => write!(f, "{address}:{}", self.port),
            IpAddr::V6(address) => write!(f, "[{address}]:{}", self.port),
        }
    }
}

/// The fields of a TCP header that matter for reassembly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tcp {
    /// Sequence number.
    pub sequence: u32,
    /// Acknowledgement number: the next byte that the sender of this segment expects.
    pub acknowledged: Option<u32>,
    /// The SYN flag, which opens the connection.
    pub syn: bool,
    /// The FIN flag, which closes this direction.
    pub fin: bool,
    /// The RST flag, which aborts the connection.
    pub rst: bool,
}

/// A TCP segment or UDP datagram.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// The sender.
    pub from: Endpoint,
    /// The receiver.
    pub to: Endpoint,
    /// Fields of the TCP header; `None` for UDP.
    pub tcp: Option<Tcp>,
    /// The payload, as far as the capture kept it.
    pub payload: &'a [u8],
    /// The length of the payload on the wire.
    pub length: usize,
    /// Identification in the IPv4 header: the same in a packet that was captured twice, another in a retransmission.
    pub ident: Option<u16>,
}

/// The most headers around a segment; packets with more are made to waste time.
const MAX_LAYERS: usize = 8;

/// UDP ports of VXLAN: the registered one (RFC 7348, 4), and the one that Linux used before.
const VXLAN_PORTS: [u16; 2] = [4789, 8472];

/// GRE protocol type of ERSPAN types I and II (draft-foschiano-erspan).
const ERSPAN: u16 = 0x88BE;
/// GRE protocol type of ERSPAN type III.
const ERSPAN_3: u16 = 0x22EB;
/// `EtherType` of Ethernet frames in a tunnel (RFC 1701).
const TRANSPARENT_ETHERNET: u16 = 0x6558;

/// The header that follows in a packet.
#[derive(Clone, Copy)]
enum Layer {
    /// An Ethernet header.
    Ethernet,
    /// What this `EtherType` announces.
    Ether(EtherType),
    /// An IP header of version 4 or 6.
    Ip,
}

/// The first header in packets of a link type, and its position; `None` for link types that are not of a network.
fn first_layer(link: u16, data: &[u8]) -> Option<(Layer, usize)> {
    let ether = |at: usize| data.get(at..at + 2).map(|two| Layer::Ether(EtherType(u16::from_be_bytes([two[0], two[1]]))));
    Some(match link {
        1 => (Layer::Ethernet, 0),
        // BSD loopback: a 4-byte address family whose value and byte order depend on the system; the IP header follows.
        0 | 108 => (Layer::Ip, 4),
        12 | 14 | 101 | 228 | 229 => (Layer::Ip, 0),
        // Linux "any" device: SLL has the protocol at its end, SLL2 at its beginning.
        113 => (ether(14)?, 16),
        276 => (ether(0)?, 20),
        _ => return None,
    })
}

/// Whether packets of this link type come from a network and can be parsed here.
pub fn is_known_link(link: u16) -> bool {
    first_layer(link, &[0; 20]).is_some()
}

/// Calls `each` with the segment or datagram in a packet, if there is one.
pub fn segments(link: u16, data: &[u8], fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    if let Some((layer, at)) = first_layer(link, data) {
        if let Some(data) = data.get(at..) {
            parse_layers(layer, data, 0, fragments, each);
        }
    }
}

/// Parses one header after the other down to IP; `depth` counts them through all tunnels.
fn parse_layers(mut layer: Layer, mut data: &[u8], depth: usize, fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    for depth in depth..MAX_LAYERS {
        let next = match layer {
            Layer::Ethernet => ethernet(data),
            Layer::Ether(kind) => ether_payload(kind, data),
            Layer::Ip => return ip(data, depth, fragments, each),
        };
        let Some((inner, header)) = next else { return };
        (layer, data) = (inner, &data[header.min(data.len())..]);
    }
}

fn ethernet(data: &[u8]) -> Option<(Layer, usize)> {
    let header = Ethernet2HeaderSlice::from_slice(data).ok()?;
    Some((Layer::Ether(header.ether_type()), header.slice().len()))
}

/// What follows an `EtherType` (a VLAN tag, MPLS labels or IP): the next layer and the length of the tag or labels.
fn ether_payload(kind: EtherType, data: &[u8]) -> Option<(Layer, usize)> {
    match kind {
        ether_type::IPV4 | ether_type::IPV6 => Some((Layer::Ip, 0)),
        ether_type::VLAN_TAGGED_FRAME | ether_type::PROVIDER_BRIDGING | ether_type::VLAN_DOUBLE_TAGGED_FRAME => {
            let header = SingleVlanHeaderSlice::from_slice(data).ok()?;
            Some((Layer::Ether(header.ether_type()), header.slice().len()))
        }
        // MPLS (RFC 3032, 2.1): labels of four bytes up to the bottom of the stack. They do not name what follows, so its
        // first four bits have to tell.
        EtherType(0x8847 | 0x8848) => {
            let labels = data.chunks_exact(4).position(|label| label[2] & 1 == 1)? + 1;
            match data.get(4 * labels)? >> 4 {
                4 | 6 => Some((Layer::Ip, 4 * labels)),
                // Ethernet after a control word, which begins with four zero bits (RFC 4448, 4.6).
                0 => Some((Layer::Ethernet, 4 * labels + 4)),
                _ => Some((Layer::Ethernet, 4 * labels)),
            }
        }
        EtherType(TRANSPARENT_ETHERNET) => Some((Layer::Ethernet, 0)),
        _ => None,
    }
}

/// An IP packet of version 4 or 6.
struct IpPacket<'a> {
    addresses: (IpAddr, IpAddr),
    ident: Option<u16>,
    protocol: IpNumber,
    payload: &'a [u8],
    /// The length of the payload on the wire.
    length: usize,
    /// The position of a fragment; `None` for a packet that is not fragmented.
    fragment: Option<FragmentPosition>,
}

/// Parses an IP packet; a fragment waits until its packet is complete.
fn ip(data: &[u8], depth: usize, fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    let datagram = match data.first().map(|byte| byte >> 4) {
        Some(4) => ip4(data),
        Some(6) => ip6(data),
        _ => None,
    };
    let Some(datagram) = datagram else { return };
    let Some(place) = datagram.fragment else { return transport(&datagram, depth, fragments, each) };
    if datagram.payload.len() < datagram.length {
        fragments.cut += 1;
    } else if let Some(whole) = fragments.take(datagram.addresses, datagram.protocol, place, datagram.payload) {
        let datagram = IpPacket { payload: &whole, length: whole.len(), fragment: None, ..datagram };
        transport(&datagram, depth, fragments, each);
    }
}

/// Parses an IPv4 packet; packets that the capture cut short are parsed as far as they go.
fn ip4(data: &[u8]) -> Option<IpPacket<'_>> {
    let (slice, _) = LaxIpv4Slice::from_slice(data).ok()?;
    let (header, payload) = (slice.header(), slice.payload());
    let before = payload.payload.as_ptr() as usize - data.as_ptr() as usize;
    let fragment = payload.fragmented.then(|| FragmentPosition {
        ident: u32::from(header.identification()),
        offset: header.fragments_offset(),
        has_more: header.more_fragments(),
    });
    Some(IpPacket {
        addresses: (IpAddr::V4(header.source_addr()), IpAddr::V4(header.destination_addr())),
        ident: Some(header.identification()),
        protocol: payload.ip_number,
        payload: payload.payload,
        // A packet captured on the sending host may have length 0, which its network card fills in.
        length: usize::from(header.total_len()).saturating_sub(before).max(payload.payload.len()),
        fragment,
    })
}

/// Parses an IPv6 packet with its extension headers; packets that the capture cut short are parsed as far as they go.
fn ip6(data: &[u8]) -> Option<IpPacket<'_>> {
    let (slice, _) = LaxIpv6Slice::from_slice(data).ok()?;
    let (header, payload) = (slice.header(), slice.payload());
    let before = payload.payload.as_ptr() as usize - data.as_ptr() as usize;
    let fragment = slice.extensions().clone().into_iter().find_map(|extension| match extension {
        Ipv6ExtensionSlice::Fragment(it) if payload.fragmented => {
            Some(FragmentPosition { ident: it.identification(), offset: it.fragment_offset(), has_more: it.more_fragments() })
        }
        _ => None,
    });
    Some(IpPacket {
        addresses: (IpAddr::V6(header.source_addr()), IpAddr::V6(header.destination_addr())),
        ident: None,
        protocol: payload.ip_number,
        payload: payload.payload,
        length: (header.slice().len() + usize::from(header.payload_length())).saturating_sub(before).max(payload.payload.len()),
        fragment,
    })
}

/// Parses TCP or UDP, or the tunnel that an IP packet carries.
fn transport(datagram: &IpPacket<'_>, depth: usize, fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    let data = datagram.payload;
    let endpoints = |from: u16, to: u16| {
        (Endpoint { address: datagram.addresses.0, port: from }, Endpoint { address: datagram.addresses.1, port: to })
    };
    match datagram.protocol {
        ip_number::TCP => {
            let Ok(slice) = TcpSlice::from_slice(data) else { return };
            let (from, to) = endpoints(slice.source_port(), slice.destination_port());
            let tcp = Tcp {
                sequence: slice.sequence_number(),
                acknowledged: slice.ack().then(|| slice.acknowledgment_number()),
                syn: slice.syn(),
                fin: slice.fin(),
                rst: slice.rst(),
            };
            let length = datagram.length.saturating_sub(slice.header_slice().len());
            each(&Segment { from, to, tcp: Some(tcp), payload: slice.payload(), length, ident: datagram.ident });
        }
        ip_number::UDP => {
            let Ok(slice) = UdpSlice::from_slice_lax(data) else { return };
            let (from, to) = endpoints(slice.source_port(), slice.destination_port());
            if VXLAN_PORTS.contains(&to.port) && slice.payload().first().is_some_and(|flags| flags & 8 != 0) {
                let inner = slice.payload().get(8..).unwrap_or(&[]);
                return parse_layers(Layer::Ethernet, inner, depth + 1, fragments, each);
            }
            let length = usize::from(slice.length()).saturating_sub(slice.header_slice().len()).max(slice.payload().len());
            each(&Segment { from, to, tcp: None, payload: slice.payload(), length, ident: datagram.ident });
        }
        ip_number::GRE => {
            if let Some((layer, at)) = gre(data) {
                parse_layers(layer, data.get(at..).unwrap_or(&[]), depth + 1, fragments, each);
            }
        }
        ip_number::IPV4 | ip_number::IPV6 => parse_layers(Layer::Ip, data, depth + 1, fragments, each),
        _ => {}
    }
}

/// Parses a GRE header (RFC 2784, RFC 2890) and the ERSPAN header that may follow: the next layer and its position.
fn gre(data: &[u8]) -> Option<(Layer, usize)> {
    let flags = u16::from_be_bytes(*data.first_chunk()?);
    let kind = u16::from_be_bytes(*data.get(2..)?.first_chunk()?);
    let optional = [0x8000, 0x2000, 0x1000].iter().filter(|&bit| flags & bit != 0).count();
    let header = 4 + 4 * optional;
    let sequenced = flags & 0x1000 != 0;
    Some(match kind {
        ERSPAN => (Layer::Ethernet, header + if sequenced { 8 } else { 0 }),
        ERSPAN_3 => (Layer::Ethernet, header + if data.get(header + 11)? & 1 == 1 { 20 } else { 12 }),
        _ => (Layer::Ether(EtherType(kind)), header),
    })
}
