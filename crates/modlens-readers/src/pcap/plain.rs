//! The short way of a packet like nearly all of a capture: TCP over IPv4 over Ethernet, not fragmented, captured as a whole,
//! and neither opening nor ending its connection.
//!
//! `net` is the oracle: it finds the same segment in such a packet (see the test below). What comes of the segment is the same,
//! too (`ConnectionTable::take_plain`).

/// The length of the headers without options: Ethernet, IPv4 (RFC 791, 3.1), TCP (RFC 9293, 3.1).
const ETHERNET_BYTES: usize = 14;
const IP_BYTES: usize = 20;
const TCP_BYTES: usize = 20;

/// The link type of Ethernet.
const ETHERNET: u16 = 1;

/// The bytes of the headers from 12 to 19 and from 20 to 27 that all plain segments have in common, with a mask for each: IPv4 after
/// Ethernet, version 4 without options; not a fragment, whether or not it may be fragmented, and TCP.
const TYPE_AND_VERSION: (u64, u64) = (0x0800_4500_0000_0000, 0xFFFF_FF00_0000_0000);
const WHOLE_AND_TCP: (u64, u64) = (0x0000_0006_0000_0000, 0xBFFF_00FF_0000_0000);

/// The flags URG, ACK, RST, SYN and FIN, of which a plain segment has ACK only.
const FLAGS: u8 = 0x37;
const ACK: u8 = 0x10;

/// A TCP segment as its headers have it.
#[derive(Clone, Copy, Debug)]
pub struct PlainSegment<'a> {
    /// Addresses of sender and receiver.
    pub addresses: [u8; 8],
    /// Ports of sender and receiver.
    pub ports: [u8; 4],
    /// Identification in the IP header.
    pub ident: u16,
    /// Sequence number.
    pub sequence: u32,
    /// Acknowledgement number.
    pub acknowledged: u32,
    /// All of its payload.
    pub payload: &'a [u8],
}

/// The segment in a packet of this link type, if it is a plain one.
#[inline]
pub fn segment(link: u16, data: &[u8]) -> Option<PlainSegment<'_>> {
    let headers: &[u8; ETHERNET_BYTES + IP_BYTES + TCP_BYTES] = data.first_chunk().filter(|_| link == ETHERNET)?;
    let half = |at: usize| u16::from_be_bytes([headers[at], headers[at + 1]]);
    let word = |at: usize| u32::from_be_bytes([headers[at], headers[at + 1], headers[at + 2], headers[at + 3]]);
    let has = |at: usize, (value, mask): (u64, u64)| {
        headers[at..].first_chunk().is_some_and(|eight| u64::from_be_bytes(*eight) & mask == value)
    };
    let is_plain = has(12, TYPE_AND_VERSION) && has(20, WHOLE_AND_TCP) && headers[47] & FLAGS == ACK;
    let begin = ETHERNET_BYTES + IP_BYTES + 4 * usize::from(headers[46] >> 4);
    if !is_plain || begin < headers.len() {
        return None;
    }
    Some(PlainSegment {
        addresses: *headers[26..].first_chunk()?,
        ports: *headers[34..].first_chunk()?,
        ident: half(18),
        sequence: word(38),
        acknowledged: word(42),
        payload: data.get(begin..ETHERNET_BYTES + usize::from(half(16)))?,
    })
}

#[cfg(test)]
mod tests {
    use std::net::{IpAddr, Ipv4Addr};

    use proptest::prelude::*;

    use super::*;
    use crate::pcap::fragments::Fragments;
    use crate::pcap::net::segments;

    /// A packet with these numbers in the places that decide, and so many bytes after its headers.
    fn packet(total: u16, fragment: u16, protocol: u8, offset: u8, flags: u8, behind: usize) -> Vec<u8> {
        let mut packet = vec![2; 12];
        packet.extend([8, 0, 0x45, 0]);
        packet.extend(total.to_be_bytes());
        packet.extend([0x12, 0x34]);
        packet.extend(fragment.to_be_bytes());
        packet.extend([64, protocol, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2]);
        packet.extend([0x9C, 0x40, 0x01, 0xF6, 1, 2, 3, 4, 5, 6, 7, 8, offset << 4, flags, 0, 1, 0, 0, 0, 0]);
        packet.extend((0..behind).map(|at| at as u8));
        packet
    }

    proptest! {
        #[test]
        fn a_plain_segment_is_the_one_that_all_headers_give(
            length in 0u16..60,
            fragment in prop_oneof![4 => Just(0x4000u16), 1 => any::<u16>()],
            protocol in prop_oneof![6 => Just(6u8), 1 => any::<u8>()],
            offset in prop_oneof![4 => Just(5u8), 1 => 0u8..16],
            flags in prop_oneof![4 => Just(0x18u8), 1 => any::<u8>()],
            behind in 0usize..60,
            other in prop_oneof![9 => Just(None), 1 => (0usize..54, any::<u8>()).prop_map(Some)],
        ) {
            let mut data = packet(20 + length, fragment, protocol, offset, flags, behind);
            if let Some((at, value)) = other {
                data[at] = value;
            }
            let Some(plain) = segment(1, &data) else { return Ok(()) };
            let mut all = Vec::new();
            segments(1, &data, &mut Fragments::default(), &mut |it| {
                let tcp = it.tcp.expect("a segment of TCP");
                assert!(!tcp.syn && !tcp.fin && !tcp.rst);
                let ends = [it.from, it.to].map(|end| (end.address, end.port));
                all.push((ends, tcp.sequence, tcp.acknowledged, it.payload.to_vec(), it.length, it.ident));
            });
            let address = |at: usize| {
                let four: [u8; 4] = *plain.addresses[at..].first_chunk().unwrap();
                IpAddr::V4(Ipv4Addr::from(four))
            };
            let port = |at: usize| u16::from_be_bytes([plain.ports[at], plain.ports[at + 1]]);
            let ends = [(address(0), port(0)), (address(4), port(2))];
            let (payload, length) = (plain.payload.to_vec(), plain.payload.len());
            let expected = (ends, plain.sequence, Some(plain.acknowledged), payload, length, Some(plain.ident));
            prop_assert_eq!(all, vec![expected]);
        }
    }

    #[test]
    fn a_packet_of_polling_is_plain() {
        let data = packet(52, 0x4000, 6, 5, 0x18, 12);
        assert_eq!(segment(1, &data).map(|it| it.payload.len()), Some(12));
        assert!(segment(113, &data).is_none() && segment(1, &data[..60]).is_none());
    }
}
