//! From a packet to the segment or datagram in it, through everything a mirror port wraps around it.
//!
//! `etherparse` reads the headers of Ethernet, VLAN, IP, TCP and UDP; the few bytes of MPLS, GRE, ERSPAN and VXLAN are
//! read here. Nothing is checked that a network card has not checked: a captured packet with a wrong checksum is nearly
//! always one that the card was still to fill in.

use std::net::IpAddr;

use etherparse::{ether_type, ip_number, EtherType, Ethernet2HeaderSlice, IpNumber, SingleVlanHeaderSlice};
use etherparse::{Ipv6ExtensionSlice, LaxIpv4Slice, LaxIpv6Slice, TcpSlice, UdpSlice};

use crate::pcap::fragments::{Fragments, Place};

/// A port of a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Endpoint {
    /// The host.
    pub address: IpAddr,
    /// The port.
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

/// What TCP says of a segment; `None` for UDP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tcp {
    /// Number of its first byte.
    pub sequence: u32,
    /// The next byte that its sender waits for.
    pub acknowledged: Option<u32>,
    /// It opens the connection.
    pub opens: bool,
    /// It closes its direction.
    pub ends: bool,
    /// It breaks the connection off.
    pub resets: bool,
}

/// A TCP segment or UDP datagram.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// Sender.
    pub from: Endpoint,
    /// Receiver.
    pub to: Endpoint,
    /// TCP's part; `None` for UDP.
    pub tcp: Option<Tcp>,
    /// What was kept of its payload.
    pub payload: &'a [u8],
    /// The payload's length on the wire.
    pub length: usize,
    /// IPv4's identification: a packet delivered twice has the same one, a retransmission another.
    pub ident: Option<u16>,
}

/// Tunnels in tunnels: no real packet has more layers.
const DEEPEST: usize = 8;

/// Port of VXLAN (RFC 7348, 4), and the one Linux used before.
const VXLAN: [u16; 2] = [4789, 8472];

/// GRE's protocol types of ERSPAN: versions 1 and 2 (draft-foschiano-erspan), version 3.
const ERSPAN: u16 = 0x88BE;
const ERSPAN_3: u16 = 0x22EB;
const TRANSPARENT_ETHERNET: u16 = 0x6558;

#[derive(Clone, Copy)]
enum Layer {
    Ethernet,
    Ether(EtherType),
    Ip,
}

/// The first layer of a link type, and where it begins; `None` for link types that are not of a network.
fn first(link: u16, data: &[u8]) -> Option<(Layer, usize)> {
    let ether = |at: usize| data.get(at..at + 2).map(|two| Layer::Ether(EtherType(u16::from_be_bytes([two[0], two[1]]))));
    Some(match link {
        1 => (Layer::Ethernet, 0),
        // BSD loopback: an address family, whose number and byte order differ by system. The IP version tells.
        0 | 108 => (Layer::Ip, 4),
        12 | 14 | 101 | 228 | 229 => (Layer::Ip, 0),
        // Linux "any" device: SLL has the protocol last, SLL2 first.
        113 => (ether(14)?, 16),
        276 => (ether(0)?, 20),
        _ => return None,
    })
}

/// Whether packets of this link type are read here.
pub fn knows(link: u16) -> bool {
    first(link, &[0; 20]).is_some()
}

/// Hands on the segment or datagram of a packet, if there is one.
pub fn segments(link: u16, data: &[u8], fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    if let Some((layer, at)) = first(link, data) {
        if let Some(data) = data.get(at..) {
            walk(layer, data, 0, fragments, each);
        }
    }
}

fn walk(mut layer: Layer, mut data: &[u8], depth: usize, fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    for depth in depth..DEEPEST {
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

/// VLAN tags (one or several), MPLS labels, IP.
fn ether_payload(kind: EtherType, data: &[u8]) -> Option<(Layer, usize)> {
    match kind {
        ether_type::IPV4 | ether_type::IPV6 => Some((Layer::Ip, 0)),
        ether_type::VLAN_TAGGED_FRAME | ether_type::PROVIDER_BRIDGING | ether_type::VLAN_DOUBLE_TAGGED_FRAME => {
            let header = SingleVlanHeaderSlice::from_slice(data).ok()?;
            Some((Layer::Ether(header.ether_type()), header.slice().len()))
        }
        // MPLS (RFC 3032, 2.1): labels of four bytes up to the bottom of the stack; what follows is not named.
        EtherType(0x8847 | 0x8848) => {
            let labels = data.chunks_exact(4).position(|label| label[2] & 1 == 1)? + 1;
            match data.get(4 * labels)? >> 4 {
                4 | 6 => Some((Layer::Ip, 4 * labels)),
                // Ethernet behind a control word (RFC 4448, 4.6).
                0 => Some((Layer::Ethernet, 4 * labels + 4)),
                _ => Some((Layer::Ethernet, 4 * labels)),
            }
        }
        EtherType(TRANSPARENT_ETHERNET) => Some((Layer::Ethernet, 0)),
        _ => None,
    }
}

/// A packet of either version of IP.
struct Datagram<'a> {
    ends: (IpAddr, IpAddr),
    ident: Option<u16>,
    protocol: IpNumber,
    payload: &'a [u8],
    /// The payload's length on the wire.
    length: usize,
    fragment: Option<Place>,
}

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
    } else if let Some(whole) = fragments.take(datagram.ends, datagram.protocol, place, datagram.payload) {
        let datagram = Datagram { payload: &whole, length: whole.len(), fragment: None, ..datagram };
        transport(&datagram, depth, fragments, each);
    }
}

fn ip4(data: &[u8]) -> Option<Datagram<'_>> {
    let (slice, _) = LaxIpv4Slice::from_slice(data).ok()?;
    let (header, payload) = (slice.header(), slice.payload());
    let before = payload.payload.as_ptr() as usize - data.as_ptr() as usize;
    let fragment = payload.fragmented.then(|| Place {
        ident: u32::from(header.identification()),
        offset: header.fragments_offset(),
        more: header.more_fragments(),
    });
    Some(Datagram {
        ends: (IpAddr::V4(header.source_addr()), IpAddr::V4(header.destination_addr())),
        ident: Some(header.identification()),
        protocol: payload.ip_number,
        payload: payload.payload,
        // A length of zero was still to be filled in by the network card.
        length: usize::from(header.total_len()).saturating_sub(before).max(payload.payload.len()),
        fragment,
    })
}

fn ip6(data: &[u8]) -> Option<Datagram<'_>> {
    let (slice, _) = LaxIpv6Slice::from_slice(data).ok()?;
    let (header, payload) = (slice.header(), slice.payload());
    let before = payload.payload.as_ptr() as usize - data.as_ptr() as usize;
    let fragment = slice.extensions().clone().into_iter().find_map(|extension| match extension {
        Ipv6ExtensionSlice::Fragment(it) if payload.fragmented => {
            Some(Place { ident: it.identification(), offset: it.fragment_offset(), more: it.more_fragments() })
        }
        _ => None,
    });
    Some(Datagram {
        ends: (IpAddr::V6(header.source_addr()), IpAddr::V6(header.destination_addr())),
        ident: None,
        protocol: payload.ip_number,
        payload: payload.payload,
        length: (header.slice().len() + usize::from(header.payload_length())).saturating_sub(before).max(payload.payload.len()),
        fragment,
    })
}

fn transport(datagram: &Datagram<'_>, depth: usize, fragments: &mut Fragments, each: &mut dyn FnMut(&Segment<'_>)) {
    let data = datagram.payload;
    let ends =
        |from: u16, to: u16| (Endpoint { address: datagram.ends.0, port: from }, Endpoint { address: datagram.ends.1, port: to });
    match datagram.protocol {
        ip_number::TCP => {
            let Ok(slice) = TcpSlice::from_slice(data) else { return };
            let (from, to) = ends(slice.source_port(), slice.destination_port());
            let tcp = Tcp {
                sequence: slice.sequence_number(),
                acknowledged: slice.ack().then(|| slice.acknowledgment_number()),
                opens: slice.syn(),
                ends: slice.fin(),
                resets: slice.rst(),
            };
            let length = datagram.length.saturating_sub(slice.header_slice().len());
            each(&Segment { from, to, tcp: Some(tcp), payload: slice.payload(), length, ident: datagram.ident });
        }
        ip_number::UDP => {
            let Ok(slice) = UdpSlice::from_slice_lax(data) else { return };
            let (from, to) = ends(slice.source_port(), slice.destination_port());
            if VXLAN.contains(&to.port) && slice.payload().first().is_some_and(|flags| flags & 8 != 0) {
                let inner = slice.payload().get(8..).unwrap_or(&[]);
                return walk(Layer::Ethernet, inner, depth + 1, fragments, each);
            }
            let length = usize::from(slice.length()).saturating_sub(slice.header_slice().len()).max(slice.payload().len());
            each(&Segment { from, to, tcp: None, payload: slice.payload(), length, ident: datagram.ident });
        }
        ip_number::GRE => {
            if let Some((layer, at)) = gre(data) {
                walk(layer, data.get(at..).unwrap_or(&[]), depth + 1, fragments, each);
            }
        }
        ip_number::IPV4 | ip_number::IPV6 => walk(Layer::Ip, data, depth + 1, fragments, each),
        _ => {}
    }
}

/// GRE (RFC 2784, RFC 2890) and what ERSPAN puts behind it.
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
