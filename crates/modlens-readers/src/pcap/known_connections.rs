//! The connections of the last packets, found by the addresses and ports as they are in their headers.

use std::net::IpAddr;

use crate::pcap::net::Endpoint;

/// How many are kept, a power of two.
const PLACES: usize = 256;

/// A connection as packets of one of its sides name it.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    addresses: u64,
    ports: u32,
    /// The slot of the connection, plus one; 0 in a free place.
    slot: u32,
    /// The side that sends these packets.
    side: u8,
}

/// A cache in front of the table of connections. Each pair of ends has one place, which the last of them has taken.
#[derive(Debug)]
pub(super) struct KnownConnections {
    places: Box<[Known; PLACES]>,
}

impl Default for KnownConnections {
    fn default() -> Self {
        Self { places: Box::new([Known::default(); PLACES]) }
    }
}

/// The place of a pair of ends.
#[inline]
fn place(addresses: u64, ports: u32) -> usize {
    // Multiplicative hashing: the upper bits of the product depend on all bits.
    let mixed = (addresses ^ u64::from(ports).rotate_left(17)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed >> (64 - PLACES.ilog2())) as usize
}

impl KnownConnections {
    /// Slot and side of the connection of a packet with these addresses and ports, sender first.
    #[inline]
    pub fn find(&self, addresses: [u8; 8], ports: [u8; 4]) -> Option<(usize, usize)> {
        let (addresses, ports) = (u64::from_be_bytes(addresses), u32::from_be_bytes(ports));
        let known = &self.places[place(addresses, ports)];
        let is_same = known.addresses == addresses && known.ports == ports && known.slot > 0;
        is_same.then(|| (known.slot as usize - 1, usize::from(known.side)))
    }

    /// Keeps the connection of a packet between two ends, if these have addresses of IPv4.
    pub fn keep(&mut self, from: Endpoint, to: Endpoint, (slot, side): (usize, usize)) {
        let (IpAddr::V4(sender), IpAddr::V4(receiver)) = (from.address, to.address) else { return };
        let addresses = u64::from(u32::from(sender)) << 32 | u64::from(u32::from(receiver));
        let ports = u32::from(from.port) << 16 | u32::from(to.port);
        let slot = u32::try_from(slot + 1).unwrap_or(0);
        self.places[place(addresses, ports)] = Known { addresses, ports, slot, side: side as u8 };
    }

    /// Forgets all of them, because a slot becomes free.
    pub fn clear(&mut self) {
        self.places.fill(Known::default());
    }
}
