//! The data of a packet for Wireshark's dissectors, with link type 252 (exported PDU): tags, then the bytes of a frame.
//!
//! Each tag is `u16 tag, u16 length, value` (big-endian); tag 0 ends them. Wireshark's dissector `mbudp` expects an
//! MBAP header, derives the direction from the ports, pairs by the transaction identifier, decodes every function, and
//! tolerates bytes after the PDU; so an RTU frame is stored completely, with its CRC. `mbrtu`, the dissector for RTU,
//! guesses the direction and leaves most functions undecoded.

use modlens_protocol::checksum::crc16;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;

/// Wireshark assumes that the side with this port is the server.
pub const SERVER_PORT: u16 = 502;

const NAME: u16 = 12;
const PORT_TYPE: u16 = 24;
const SOURCE_PORT: u16 = 25;
const TARGET_PORT: u16 = 26;
const PROTOCOL_COLUMN: u16 = 33;
const INFO_COLUMN: u16 = 36;

/// Appends a tag, padded to a multiple of four bytes.
fn tag(code: u16, value: &[u8], out: &mut Vec<u8>) {
    let padded = value.len().next_multiple_of(4);
    out.extend_from_slice(&code.to_be_bytes());
    out.extend_from_slice(&(padded as u16).to_be_bytes());
    out.extend_from_slice(value);
    out.extend_from_slice(&[0; 3][..padded - value.len()]);
}

/// Appends the tag that ends the list.
fn end_tags(out: &mut Vec<u8>) {
    out.extend_from_slice(&[0; 4]);
}

/// The ports of sender and receiver, and the transaction identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Route {
    /// The sender's port.
    pub from: u16,
    /// The receiver's port.
    pub to: u16,
    /// The transaction identifier.
    pub id: u16,
}

/// The size in bytes of the tags that `routed` makes.
const ROUTED_BYTES: usize = 40;

/// Name and ports for a dissector that derives the direction from ports, with room for further bytes. `kind` is 2 for
/// TCP, 3 for UDP. Built in one block, because small packets consist mostly of headers.
fn routed<const N: usize>(name: [u8; 5], kind: u8, route: Route) -> [u8; N] {
    let mut header = [0; N];
    header[..4].copy_from_slice(&[0, NAME as u8, 0, 8]);
    header[4..9].copy_from_slice(&name);
    header[12..20].copy_from_slice(&[0, PORT_TYPE as u8, 0, 4, 0, 0, 0, kind]);
    header[20..26].copy_from_slice(&[0, SOURCE_PORT as u8, 0, 4, 0, 0]);
    header[26..28].copy_from_slice(&route.from.to_be_bytes());
    header[28..34].copy_from_slice(&[0, TARGET_PORT as u8, 0, 4, 0, 0]);
    header[34..36].copy_from_slice(&route.to.to_be_bytes());
    header
}

/// The MBAP header of an ADU of this length (unit and PDU).
pub fn mbap(id: u16, length: usize) -> [u8; MBAP_PREFIX_BYTES] {
    let ([a, b], [c, d]) = (id.to_be_bytes(), (length as u16).to_be_bytes());
    [a, b, 0, 0, c, d]
}

/// Appends a serial frame for `mbudp`. `adu` is unit and PDU, `trailer` the bytes after them: the CRC, or the text of
/// an ASCII frame.
pub fn udp(route: Route, adu: &[u8], trailer: &[u8], out: &mut Vec<u8>) {
    let mut header: [u8; ROUTED_BYTES + MBAP_PREFIX_BYTES] = routed(*b"mbudp", 3, route);
    header[ROUTED_BYTES..].copy_from_slice(&mbap(route.id, adu.len()));
    out.extend_from_slice(&header);
    out.extend_from_slice(adu);
    out.extend_from_slice(trailer);
}

/// Appends a Modbus/TCP frame, unchanged.
pub fn tcp(route: Route, wire: &[u8], out: &mut Vec<u8>) {
    out.extend_from_slice(&routed::<ROUTED_BYTES>(*b"mbtcp", 2, route));
    out.extend_from_slice(wire);
}

/// Appends a frame for `mbrtu`. `trailer` is its CRC; if it is empty, the CRC is computed.
pub fn rtu(adu: &[u8], trailer: &[u8], out: &mut Vec<u8>) {
    tag(NAME, b"mbrtu", out);
    end_tags(out);
    out.extend_from_slice(adu);
    if trailer.is_empty() {
        out.extend_from_slice(&crc16(adu).to_le_bytes());
    } else {
        out.extend_from_slice(trailer);
    }
}

/// Appends bytes that no dissector shall decode, with texts for Wireshark's columns Protocol and Info.
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
