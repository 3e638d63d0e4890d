//! Wraps serial frames in Modbus/TCP (Ethernet, IPv4, TCP, port 502), for programs that support nothing else.
//!
//! Everything below the Modbus layer is invented, and the section header says so. Unit n of bus b is 10.b.0.n, its
//! master 10.b.255.254. Every connection begins with a handshake and has consistent sequence numbers.

use std::collections::HashMap;

use super::payload::{mbap, Route, SERVER_PORT};

const SYN: u8 = 0x02;
const SYN_ACK: u8 = 0x12;
const ACK: u8 = 0x10;
const PUSH_ACK: u8 = 0x18;

/// The maximum number of connections. Beyond it all of them are forgotten, and each begins again with a handshake.
const MAX_CONNECTIONS: usize = 65_536;

/// The next sequence numbers of a connection: the client's and the server's.
type SequenceNumbers = [u32; 2];

/// The connections so far, by bus, unit and client port.
#[derive(Debug, Default)]
pub struct Connections {
    open: HashMap<(u8, u8, u16), SequenceNumbers>,
}

/// A frame to be carried by a connection.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// The number of the bus.
    pub bus: u8,
    /// The unit address.
    pub unit: u8,
    /// Its ports and transaction identifier.
    pub route: Route,
    /// Unit and PDU of the frame.
    pub adu: &'a [u8],
}

impl Connections {
    /// Calls `emit` with the packets that carry a frame, preceded by the handshake if the connection is new.
    pub fn packets(&mut self, segment: Segment<'_>, mut emit: impl FnMut(&[u8])) {
        let Segment { bus, unit, route, adu } = segment;
        let to_server = route.to == SERVER_PORT;
        let port = if to_server { route.from } else { route.to };
        if self.open.len() > MAX_CONNECTIONS {
            self.open.clear();
        }
        let endpoints = Endpoints { bus, unit, port };
        let sequence_numbers = self.open.entry((bus, unit, port)).or_insert_with(|| {
            emit(&endpoints.packet(true, [0, 0], SYN, &[]));
            emit(&endpoints.packet(false, [0, 1], SYN_ACK, &[]));
            emit(&endpoints.packet(true, [1, 1], ACK, &[]));
            [1, 1]
        });
        let mut bytes = Vec::with_capacity(7 + adu.len());
        bytes.extend_from_slice(&mbap(route.id, adu.len()));
        bytes.extend_from_slice(adu);
        let (mine, theirs) = if to_server { (0, 1) } else { (1, 0) };
        emit(&endpoints.packet(to_server, [sequence_numbers[mine], sequence_numbers[theirs]], PUSH_ACK, &bytes));
        sequence_numbers[mine] = sequence_numbers[mine].wrapping_add(bytes.len() as u32);
    }
}

/// The addresses of a connection.
#[derive(Clone, Copy)]
struct Endpoints {
    bus: u8,
    unit: u8,
    port: u16,
}

impl Endpoints {
    /// An Ethernet packet of the connection, with its checksums.
    fn packet(self, to_server: bool, [sequence, acknowledged]: SequenceNumbers, flags: u8, bytes: &[u8]) -> Vec<u8> {
        let sides = [
            ([10, self.bus, 255, 254], 0xFFFE_u16, self.port),
            ([10, self.bus, 0, self.unit], u16::from(self.unit), SERVER_PORT),
        ];
        let (from, to) = if to_server { (sides[0], sides[1]) } else { (sides[1], sides[0]) };
        let mut out = Vec::with_capacity(54 + bytes.len());
        for (_, host, _) in [to, from] {
            out.extend_from_slice(&[2, 0, 0, self.bus]);
            out.extend_from_slice(&host.to_be_bytes());
        }
        out.extend_from_slice(&[0x08, 0x00]);
        let length = (40 + bytes.len()) as u16;
        let ip = out.len();
        out.extend_from_slice(&[0x45, 0]);
        out.extend_from_slice(&length.to_be_bytes());
        out.extend_from_slice(&[0, 0, 0x40, 0, 64, 6, 0, 0]);
        out.extend_from_slice(&from.0);
        out.extend_from_slice(&to.0);
        let sum = checksum(&out[ip..], 0);
        out[ip + 10..ip + 12].copy_from_slice(&sum.to_be_bytes());
        let tcp = out.len();
        out.extend_from_slice(&from.2.to_be_bytes());
        out.extend_from_slice(&to.2.to_be_bytes());
        out.extend_from_slice(&sequence.to_be_bytes());
        out.extend_from_slice(&acknowledged.to_be_bytes());
        out.extend_from_slice(&[0x50, flags, 0x20, 0, 0, 0, 0, 0]);
        out.extend_from_slice(bytes);
        // The checksum covers a pseudo header of addresses, protocol and length (RFC 9293, section 3.1).
        let mut pseudo = u32::from(6_u16) + u32::from(length - 20);
        for address in [from.0, to.0] {
            pseudo +=
                u32::from(u16::from_be_bytes([address[0], address[1]])) + u32::from(u16::from_be_bytes([address[2], address[3]]));
        }
        let sum = checksum(&out[tcp..], pseudo);
        out[tcp + 16..tcp + 18].copy_from_slice(&sum.to_be_bytes());
        out
    }
}

/// The checksum of IPv4 and TCP (RFC 1071).
fn checksum(bytes: &[u8], start: u32) -> u16 {
    let words = bytes.chunks(2).map(|pair| u32::from(pair[0]) << 8 | u32::from(pair.get(1).copied().unwrap_or(0)));
    let mut sum = start + words.sum::<u32>();
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
        let route = Route { from: 50_000, to: 502, id: 4 };
        let segment = Segment { bus: 1, unit: 1, route, adu: &[1, 6, 0, 1, 0, 3] };
        Connections::default().packets(segment, |packet| packets.push(hex(packet)));
        let expected = "020000010001 02000001fffe 0800 45000034000040004006 26c3 0a01fffe 0a010001 \
                        c35001f6 00000001 00000001 50182000 b5620000 000400000006 010600010003";
        assert_eq!(packets.len(), 4);
        assert_eq!(packets[3], expected.split_whitespace().collect::<String>());
    }
}
