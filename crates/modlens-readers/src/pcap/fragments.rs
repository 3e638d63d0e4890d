//! Reassembles fragmented IP packets, with a bound on how many are kept.

use std::collections::VecDeque;
use std::net::IpAddr;

use etherparse::defrag::IpDefragBuf;
use etherparse::{IpFragOffset, IpNumber};

/// How many packets may wait for further fragments; when there are more, the oldest is given up.
const MAX_INCOMPLETE_PACKETS: usize = 64;

/// Which packet a fragment belongs to, and which part of it the fragment is.
#[derive(Clone, Copy, Debug)]
pub struct FragmentPosition {
    /// The identification that all fragments of a packet share.
    pub ident: u32,
    /// Where in the packet the fragment begins.
    pub offset: IpFragOffset,
    /// Further fragments follow this one.
    pub has_more: bool,
}

/// Addresses, protocol and identification, which together name a packet.
type PacketKey = ((IpAddr, IpAddr), IpNumber, u32);

/// Packets of which not all fragments have arrived.
#[derive(Debug, Default)]
pub struct Fragments {
    incomplete: VecDeque<(PacketKey, IpDefragBuf)>,
    /// The number of packets that were given up because a fragment is missing.
    pub lost: u64,
    /// The number of fragments of which the capture kept only a part.
    pub cut: u64,
}

impl Fragments {
    /// Takes a fragment; returns the payload of the packet if it is complete now.
    pub fn take(
        &mut self,
        ends: (IpAddr, IpAddr),
        protocol: IpNumber,
        place: FragmentPosition,
        payload: &[u8],
    ) -> Option<Vec<u8>> {
        let key = (ends, protocol, place.ident);
        let at = self.incomplete.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
            if self.incomplete.len() == MAX_INCOMPLETE_PACKETS {
                self.incomplete.pop_front();
                self.lost += 1;
            }
            self.incomplete.push_back((key, IpDefragBuf::new(protocol, Vec::new(), Vec::new())));
            self.incomplete.len() - 1
        });
        let buffer = &mut self.incomplete[at].1;
        if buffer.add(place.offset, place.has_more, payload).is_err() {
            // Fragments that contradict each other belong to two packets with the same identification: keep the newer one.
            *buffer = IpDefragBuf::new(protocol, Vec::new(), Vec::new());
            self.lost += 1;
            buffer.add(place.offset, place.has_more, payload).ok()?;
        }
        if !buffer.is_complete() {
            return None;
        }
        let (_, buffer) = self.incomplete.remove(at)?;
        Some(buffer.take_bufs().0)
    }

    /// The number of packets that are incomplete now.
    pub fn incomplete(&self) -> u64 {
        self.incomplete.len() as u64
    }
}
