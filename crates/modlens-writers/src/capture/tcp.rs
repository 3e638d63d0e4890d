//! Wraps frames in Modbus/TCP (Ethernet, IP, TCP), for programs that support nothing else.
//!
//! A frame of a TCP connection has the ends that it was captured with. Those of a serial line are invented: unit n of bus b is
//! 10.b.0.n, its master 10.b.255.254, the port 502. Whatever else is below the Modbus layer is invented, and the section header
//! says so. Every connection begins with a handshake and has consistent sequence numbers.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use super::payload::{mbap, SERVER_PORT};
use modlens_engine::records::Network;

const SYN: u8 = 0x02;
const SYN_ACK: u8 = 0x12;
const ACK: u8 = 0x10;
const PUSH_ACK: u8 = 0x18;

/// The protocol number of TCP.
const TCP: u8 = 6;

/// The maximum number of connections. Beyond it all of them are forgotten, and each begins again with a handshake.
const MAX_CONNECTIONS: usize = 65_536;

/// What the initial sequence numbers of two connections differ by: far enough that the second is no retransmission of the
/// first where both have the same ports (RFC 9293, 3.4.1). 2^32 divided by the golden ratio, made odd.
const INITIAL_STEP: u32 = 0x9E37_79B1;

/// The next sequence numbers of a connection: the client's and the server's.
type SequenceNumbers = [u32; 2];

/// The connections so far.
#[derive(Debug, Default)]
pub struct Connections {
    open: HashMap<Ends, SequenceNumbers>,
    /// How often all of them were forgotten.
    generation: u32,
}

/// The ends of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Ends {
    /// The end that sends requests.
    pub client: SocketAddr,
    /// The end that sends responses.
    pub server: SocketAddr,
    /// The number of the connection: the same ends may have several, one after the other.
    pub connection: u64,
}

impl Ends {
    /// The ends of a connection as they were captured; `port` is the client's where rows that are read back do not have it.
    /// `None` if the ends are no addresses.
    pub fn of(network: &Network, port: u16) -> Option<Self> {
        let client = SocketAddr::new(network.client.parse().ok()?, network.client_port.unwrap_or(port));
        Some(Self { client, server: network.server.parse().ok()?, connection: network.connection })
    }

    /// Those of a serial line, for one of its units.
    pub fn invented(bus: u8, unit: u8, port: u16) -> Self {
        let address = |[high, low]: [u8; 2]| IpAddr::V4(Ipv4Addr::new(10, bus, high, low));
        Self {
            client: SocketAddr::new(address([255, 254]), port),
            server: SocketAddr::new(address([0, unit]), SERVER_PORT),
            connection: 0,
        }
    }
}

/// A frame to be carried by a connection.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// The ends of its connection.
    pub ends: Ends,
    /// The client has sent it.
    pub to_server: bool,
    /// Its transaction identifier.
    pub id: u16,
    /// Unit and PDU of the frame.
    pub adu: &'a [u8],
}

impl Connections {
    /// Calls `emit` with the packets that carry a frame, preceded by the handshake if the connection is new.
    pub fn packets(&mut self, segment: Segment<'_>, mut emit: impl FnMut(&[u8])) {
        let Segment { ends, to_server, id, adu } = segment;
        if self.open.len() > MAX_CONNECTIONS {
            self.open.clear();
            self.generation += 1;
        }
        let initial = (ends.connection as u32).wrapping_add(self.generation).wrapping_mul(INITIAL_STEP);
        let sequence_numbers = self.open.entry(ends).or_insert_with(|| {
            let next = initial.wrapping_add(1);
            emit(&ends.packet(true, [initial, 0], SYN, &[]));
            emit(&ends.packet(false, [initial, next], SYN_ACK, &[]));
            emit(&ends.packet(true, [next, next], ACK, &[]));
            [next, next]
        });
        let mut bytes = Vec::with_capacity(7 + adu.len());
        bytes.extend_from_slice(&mbap(id, adu.len()));
        bytes.extend_from_slice(adu);
        let (mine, theirs) = if to_server { (0, 1) } else { (1, 0) };
        emit(&ends.packet(to_server, [sequence_numbers[mine], sequence_numbers[theirs]], PUSH_ACK, &bytes));
        sequence_numbers[mine] = sequence_numbers[mine].wrapping_add(bytes.len() as u32);
    }
}

impl Ends {
    /// An Ethernet packet of the connection, with its checksums.
    fn packet(self, to_server: bool, [sequence, acknowledged]: SequenceNumbers, flags: u8, bytes: &[u8]) -> Vec<u8> {
        let (from, to) = if to_server { (self.client, self.server) } else { (self.server, self.client) };
        let mut out = Vec::with_capacity(74 + bytes.len());
        out.extend_from_slice(&mac(to.ip()));
        out.extend_from_slice(&mac(from.ip()));
        let length = (20 + bytes.len()) as u16;
        push_ip(from.ip(), to.ip(), length, &mut out);
        let tcp = out.len();
        out.extend_from_slice(&from.port().to_be_bytes());
        out.extend_from_slice(&to.port().to_be_bytes());
        out.extend_from_slice(&sequence.to_be_bytes());
        out.extend_from_slice(&acknowledged.to_be_bytes());
        out.extend_from_slice(&[0x50, flags, 0x20, 0, 0, 0, 0, 0]);
        out.extend_from_slice(bytes);
        // The checksum covers a pseudo header of addresses, protocol and length (RFC 9293, section 3.1).
        let pseudo = [from.ip(), to.ip()].map(|ip| words(&octets(ip))).iter().sum::<u32>() + u32::from(TCP) + u32::from(length);
        let sum = checksum(&out[tcp..], pseudo);
        out[tcp + 16..tcp + 18].copy_from_slice(&sum.to_be_bytes());
        out
    }
}

/// Appends the type of the Ethernet frame and the IP header in front of `length` bytes of TCP.
fn push_ip(from: IpAddr, to: IpAddr, length: u16, out: &mut Vec<u8>) {
    if let (IpAddr::V4(from), IpAddr::V4(to)) = (from, to) {
        out.extend_from_slice(&[0x08, 0x00]);
        let ip = out.len();
        out.extend_from_slice(&[0x45, 0]);
        out.extend_from_slice(&(20 + length).to_be_bytes());
        out.extend_from_slice(&[0, 0, 0x40, 0, 64, TCP, 0, 0]);
        out.extend_from_slice(&from.octets());
        out.extend_from_slice(&to.octets());
        let sum = checksum(&out[ip..], 0);
        out[ip + 10..ip + 12].copy_from_slice(&sum.to_be_bytes());
        return;
    }
    // Version 6 (RFC 8200, section 3) has no checksum of its own.
    out.extend_from_slice(&[0x86, 0xDD, 0x60, 0, 0, 0]);
    out.extend_from_slice(&length.to_be_bytes());
    out.extend_from_slice(&[TCP, 64]);
    out.extend_from_slice(&octets(from));
    out.extend_from_slice(&octets(to));
}

/// The bytes of an address.
fn octets(address: IpAddr) -> Vec<u8> {
    match address {
        IpAddr::V4(address) => address.octets().to_vec(),
        IpAddr::V6(address) => address.octets().to_vec(),
    }
}

/// An Ethernet address that is made of the last bytes of an IP address; its second bit says that it is given locally.
fn mac(address: IpAddr) -> [u8; 6] {
    let octets = octets(address);
    let last = &octets[octets.len() - 3..];
    [2, 0, 0, last[0], last[1], last[2]]
}

/// The sum of the 16-bit words of these bytes.
fn words(bytes: &[u8]) -> u32 {
    bytes.chunks(2).map(|pair| u32::from(pair[0]) << 8 | u32::from(pair.get(1).copied().unwrap_or(0))).sum()
}

/// The checksum of IPv4 and TCP (RFC 1071).
fn checksum(bytes: &[u8], start: u32) -> u16 {
    let mut sum = start + words(bytes);
    while sum > 0xFFFF {
        sum = (sum & 0xFFFF) + (sum >> 16);
    }
    !sum as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::hex::hex;

    /// The expected bytes were decoded by tshark.
    #[test]
    fn a_request_is_a_packet_that_wireshark_decodes() {
        let mut packets = Vec::new();
        let ends = Ends::invented(1, 1, 50_000);
        let segment = Segment { ends, to_server: true, id: 4, adu: &[1, 6, 0, 1, 0, 3] };
        Connections::default().packets(segment, |packet| packets.push(hex(packet)));
        let expected = "020000010001 02000001fffe 0800 45000034000040004006 26c3 0a01fffe 0a010001 \
                        c35001f6 00000001 00000001 50182000 b5620000 000400000006 010600010003";
        assert_eq!(packets.len(), 4);
        assert_eq!(packets[3], expected.split_whitespace().collect::<String>());
    }

    /// A SYN with the number of the one before would be its retransmission, and what follows a repetition (RFC 9293, 3.4.1).
    #[test]
    fn a_second_connection_of_the_same_ports_has_numbers_of_its_own() {
        let mut connections = Connections::default();
        let mut numbers = Vec::new();
        for connection in [0, 1] {
            let ends = Ends { connection, ..Ends::invented(1, 1, 50_000) };
            let segment = Segment { ends, to_server: true, id: 4, adu: &[1, 6, 0, 1, 0, 3] };
            connections.packets(segment, |packet| numbers.push(u32::from_be_bytes(packet[38..42].try_into().unwrap())));
        }
        let far = |a: u32, b: u32| a.abs_diff(b) > 1 << 24 && a.abs_diff(b) < u32::MAX - (1 << 24);
        assert!(far(numbers[0], numbers[4]) && far(numbers[1], numbers[5]), "{numbers:x?}");
        assert_eq!(numbers[7], numbers[4].wrapping_add(1));
    }

    /// The checksum by hand: the words of pseudo header, TCP header and data add up to FFFF with it (RFC 9293, 3.1).
    #[test]
    fn a_connection_of_ipv6_has_its_ends_and_a_checksum_that_is_right() {
        let ends = Ends { client: "[fe80::1]:40000".parse().unwrap(), server: "[fe80::2]:1502".parse().unwrap(), connection: 7 };
        let mut packets = Vec::new();
        let segment = Segment { ends, to_server: false, id: 9, adu: &[1, 3, 2, 0] };
        Connections::default().packets(segment, |packet| packets.push(packet.to_vec()));
        let packet = &packets[3];
        assert_eq!((&packet[12..14], packet[20], packet.len()), (&[0x86, 0xDD][..], 6, 14 + 40 + 20 + 10));
        assert_eq!((packet[37], packet[53]), (2, 1));
        assert_eq!(&packet[54..58], [1502_u16.to_be_bytes(), 40_000_u16.to_be_bytes()].concat());
        // Addresses and length of the pseudo header, and the protocol.
        let length = (packet.len() - 54) as u32;
        assert_eq!(checksum(&packet[22..], length + 6), 0);
    }
}
