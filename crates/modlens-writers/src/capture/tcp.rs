//! Serial traffic dressed as Modbus/TCP, for programs that know no other: Ethernet, IPv4, TCP, port 502.
//!
//! Everything below the Modbus layer is invented, and the section header says so. Unit n of bus b is 10.b.0.n, its master
//! 10.b.255.254; every connection begins with a handshake, and its sequence numbers are counted.

use std::collections::HashMap;

use super::payload::{mbap, Route, SERVER_PORT};

const SYN: u8 = 0x02;
const SYN_ACK: u8 = 0x12;
const ACK: u8 = 0x10;
const PUSH_ACK: u8 = 0x18;

/// Connections that are remembered; older ones begin anew.
const REMEMBERED: usize = 65_536;

/// Sequence numbers of one connection: client's and server's next.
type Counts = [u32; 2];

/// The connections so far.
#[derive(Debug, Default)]
pub struct Connections {
    open: HashMap<(u8, u8, u16), Counts>,
}

/// One frame on its way: which bus and unit, who sends, unit and PDU.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// Number of the bus.
    pub bus: u8,
    /// Unit.
    pub unit: u8,
    /// Ports and identifier.
    pub route: Route,
    /// Unit and PDU.
    pub adu: &'a [u8],
}

impl Connections {
    /// Gives `emit` the packets that carry a frame: those of the handshake first, where the connection is new.
    pub fn packets(&mut self, segment: Segment<'_>, mut emit: impl FnMut(&[u8])) {
        let Segment { bus, unit, route, adu } = segment;
        let to_server = route.to == SERVER_PORT;
        let port = if to_server { route.from } else { route.to };
        if self.open.len() > REMEMBERED {
            self.open.clear();
        }
        let ends = Ends { bus, unit, port };
        let counts = self.open.entry((bus, unit, port)).or_insert_with(|| {
            emit(&ends.packet(true, [0, 0], SYN, &[]));
            emit(&ends.packet(false, [0, 1], SYN_ACK, &[]));
            emit(&ends.packet(true, [1, 1], ACK, &[]));
            [1, 1]
        });
        let mut bytes = Vec::with_capacity(7 + adu.len());
        bytes.extend_from_slice(&mbap(route.id, adu.len()));
        bytes.extend_from_slice(adu);
        let (mine, theirs) = if to_server { (0, 1) } else { (1, 0) };
        emit(&ends.packet(to_server, [counts[mine], counts[theirs]], PUSH_ACK, &bytes));
        counts[mine] = counts[mine].wrapping_add(bytes.len() as u32);
    }
}

#[derive(Clone, Copy)]
struct Ends {
    bus: u8,
    unit: u8,
    port: u16,
}

impl Ends {
    fn packet(self, to_server: bool, [sequence, acknowledged]: Counts, flags: u8, bytes: &[u8]) -> Vec<u8> {
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
        // The pseudo header: addresses, protocol, length (RFC 9293, 3.1).
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

    /// Bytes that tshark was seen to decode.
    #[test]
    fn a_request_has_the_bytes_that_wireshark_was_seen_to_take() {
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
