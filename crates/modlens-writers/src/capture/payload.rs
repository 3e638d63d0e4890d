//! What a frame looks like to Wireshark's dissectors: link type 252, tags in front of the bytes.
//!
//! A record is `u16 tag, u16 length, value` (big-endian), again and again, then tag 0 and the bytes. Wireshark's
//! dissector `mbudp` takes an MBAP header, knows who asks and who answers by the ports, pairs by the transaction
//! identifier, decodes every function, and lets bytes stand behind the PDU: so the RTU frame goes in whole, with its CRC.
//! `mbrtu` is the dissector of RTU itself; it guesses who speaks, and leaves most functions undecoded.

use modlens_protocol::checksum::crc16;
use modlens_protocol::mbap::HEADER as MBAP;

/// Wireshark takes the side with this port for the server.
pub const SERVER_PORT: u16 = 502;

const NAME: u16 = 12;
const PORT_TYPE: u16 = 24;
const SOURCE_PORT: u16 = 25;
const TARGET_PORT: u16 = 26;
const PROTOCOL_COLUMN: u16 = 33;
const INFO_COLUMN: u16 = 36;

fn tag(code: u16, value: &[u8], out: &mut Vec<u8>) {
    let padded = value.len().next_multiple_of(4);
    out.extend_from_slice(&code.to_be_bytes());
    out.extend_from_slice(&(padded as u16).to_be_bytes());
    out.extend_from_slice(value);
    out.extend_from_slice(&[0; 3][..padded - value.len()]);
}

fn end_tags(out: &mut Vec<u8>) {
    out.extend_from_slice(&[0; 4]);
}

/// Who sends and who gets, and the transaction's identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Route {
    /// Sender's port.
    pub from: u16,
    /// Receiver's port.
    pub to: u16,
    /// Transaction identifier.
    pub id: u16,
}

/// Bytes of the tags of a dissector that goes by ports.
const ROUTED: usize = 40;

/// These tags, and room behind them; `kind` is 2 for TCP, 3 for UDP. In one piece: a capture is mostly heads like this one.
fn routed<const N: usize>(name: [u8; 5], kind: u8, route: Route) -> [u8; N] {
    let mut head = [0; N];
    head[..4].copy_from_slice(&[0, NAME as u8, 0, 8]);
    head[4..9].copy_from_slice(&name);
    head[12..20].copy_from_slice(&[0, PORT_TYPE as u8, 0, 4, 0, 0, 0, kind]);
    head[20..26].copy_from_slice(&[0, SOURCE_PORT as u8, 0, 4, 0, 0]);
    head[26..28].copy_from_slice(&route.from.to_be_bytes());
    head[28..34].copy_from_slice(&[0, TARGET_PORT as u8, 0, 4, 0, 0]);
    head[34..36].copy_from_slice(&route.to.to_be_bytes());
    head
}

/// The MBAP header of an ADU (unit and PDU) of this length.
pub fn mbap(id: u16, length: usize) -> [u8; MBAP] {
    let ([a, b], [c, d]) = (id.to_be_bytes(), (length as u16).to_be_bytes());
    [a, b, 0, 0, c, d]
}

/// A serial frame for `mbudp`: `adu` is unit and PDU, `behind` what stood behind them (the CRC, or the ASCII text).
pub fn udp(route: Route, adu: &[u8], behind: &[u8], out: &mut Vec<u8>) {
    let mut head: [u8; ROUTED + MBAP] = routed(*b"mbudp", 3, route);
    head[ROUTED..].copy_from_slice(&mbap(route.id, adu.len()));
    out.extend_from_slice(&head);
    out.extend_from_slice(adu);
    out.extend_from_slice(behind);
}

/// A frame of Modbus/TCP as it is.
pub fn tcp(route: Route, wire: &[u8], out: &mut Vec<u8>) {
    out.extend_from_slice(&routed::<ROUTED>(*b"mbtcp", 2, route));
    out.extend_from_slice(wire);
}

/// A frame for `mbrtu`: `behind` is the CRC, or nothing, where one is made.
pub fn rtu(adu: &[u8], behind: &[u8], out: &mut Vec<u8>) {
    tag(NAME, b"mbrtu", out);
    end_tags(out);
    out.extend_from_slice(adu);
    if behind.is_empty() {
        out.extend_from_slice(&crc16(adu).to_le_bytes());
    } else {
        out.extend_from_slice(behind);
    }
}

/// Bytes that no dissector shall touch, with what the columns Protocol and Info say of them.
pub fn data(protocol: &str, info: &str, wire: &[u8], out: &mut Vec<u8>) {
    tag(NAME, b"data", out);
    tag(PROTOCOL_COLUMN, protocol.as_bytes(), out);
    tag(INFO_COLUMN, info.as_bytes(), out);
    end_tags(out);
    out.extend_from_slice(wire);
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::hex::hex;

    /// Bytes that tshark 4.0, 4.4 and 4.6 were seen to decode.
    #[test]
    fn records_have_the_bytes_that_wireshark_was_seen_to_take() {
        let mut out = Vec::new();
        udp(Route { from: 50_000, to: 502, id: 4 }, &[1, 6, 0, 1, 0, 3], &[0x98, 0x0B], &mut out);
        let expected = "000c0008 6d62756470000000 001800040000 0003 001900040000c350 001a0004000001f6 00000000 \
                        000400000006 010600010003980b";
        assert_eq!(hex(&out), expected.split_whitespace().collect::<String>());
        out.clear();
        rtu(&[1, 3, 0, 0x64, 0, 2], &[], &mut out);
        assert_eq!(hex(&out), "000c00086d627274750000000000000001030064000285d4");
        out.clear();
        data("RTU noise", "8 bytes", &[0xFF], &mut out);
        let expected = "000c0004 64617461 0021000c 525455206e6f697365000000 00240008 3820627974657300 00000000 ff";
        assert_eq!(hex(&out), expected.split_whitespace().collect::<String>());
    }
}
