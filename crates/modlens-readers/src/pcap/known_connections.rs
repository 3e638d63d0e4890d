//! The connections of the last packets, found by the addresses and ports as they are in their headers.

use std::net::IpAddr;

use crate::pcap::net::Endpoint;

/// How many are kept, a power of two.
const PLACES: usize = 512;

/// A pair of ends is in one of so many places after each other: of a dozen connections, two have the same first one.
const PROBES: usize = 4;

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

/// A cache in front of the table of connections. Where all places of a pair of ends are taken, it takes the first.
#[derive(Debug)]
pub(super) struct KnownConnections {
    places: Box<[Known; PLACES]>,
}

impl Default for KnownConnections {
    fn default() -> Self {
        Self { places: Box::new([Known::default(); PLACES]) }
    }
}

/// The places of a pair of ends.
#[inline]
fn places(addresses: u64, ports: u32) -> impl Iterator<Item = usize> {
    // Multiplicative hashing: the upper bits of the product depend on all bits.
    let mixed = (addresses ^ u64::from(ports).rotate_left(17)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let first = (mixed >> (64 - PLACES.ilog2())) as usize;
    (first..first + PROBES).map(|place| place % PLACES)
}

impl Known {
    #[inline]
    fn has_ends(&self, addresses: u64, ports: u32) -> bool {
        self.addresses == addresses && self.ports == ports && self.slot > 0
    }
}

impl KnownConnections {
    /// Slot and side of the connection of a packet with these addresses and ports, sender first.
    #[inline]
    pub fn find(&self, addresses: [u8; 8], ports: [u8; 4]) -> Option<(usize, usize)> {
        let (addresses, ports) = (u64::from_be_bytes(addresses), u32::from_be_bytes(ports));
        let known = places(addresses, ports).map(|place| &self.places[place]).find(|known| known.has_ends(addresses, ports))?;
        Some((known.slot as usize - 1, usize::from(known.side)))
    }

    /// Keeps the connection of a packet between two ends, if these have addresses of IPv4.
    pub fn keep(&mut self, from: Endpoint, to: Endpoint, (slot, side): (usize, usize)) {
        let (IpAddr::V4(sender), IpAddr::V4(receiver)) = (from.address, to.address) else { return };
        let addresses = u64::from(u32::from(sender)) << 32 | u64::from(u32::from(receiver));
        let ports = u32::from(from.port) << 16 | u32::from(to.port);
        let slot = u32::try_from(slot + 1).unwrap_or(0);
        let is_own = |place: &usize| self.places[*place].slot == 0 || self.places[*place].has_ends(addresses, ports);
        let place = places(addresses, ports).find(is_own).or_else(|| places(addresses, ports).next());
        if let Some(place) = place {
            self.places[place] = Known { addresses, ports, slot, side: side as u8 };
        }
    }

    /// Forgets all of them, because a slot becomes free.
    pub fn clear(&mut self) {
        self.places.fill(Known::default());
    }
}
