//! IP fragments put together again. How many are kept is bounded.

use std::collections::VecDeque;
use std::net::IpAddr;

use etherparse::defrag::IpDefragBuf;
use etherparse::{IpFragOffset, IpNumber};

/// Packets that may wait for their other fragments at once; the oldest is given up for a further one.
const WAITING: usize = 64;

/// Where a fragment belongs.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// What all fragments of a packet have in common.
    pub ident: u32,
    /// How far into the packet it begins.
    pub offset: IpFragOffset,
    /// Whether it is not the last.
    pub more: bool,
}

type Key = ((IpAddr, IpAddr), IpNumber, u32);

/// Fragments that wait.
#[derive(Debug, Default)]
pub struct Fragments {
    waiting: VecDeque<(Key, IpDefragBuf)>,
    /// Packets of which a fragment is missing.
    pub lost: u64,
    /// Fragments that the capture has cut short.
    pub cut: u64,
}

impl Fragments {
    /// Takes a fragment; gives the packet's payload when it is whole.
    pub fn take(&mut self, ends: (IpAddr, IpAddr), protocol: IpNumber, place: Place, payload: &[u8]) -> Option<Vec<u8>> {
        let key = (ends, protocol, place.ident);
        let at = self.waiting.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
            if self.waiting.len() == WAITING {
                self.waiting.pop_front();
                self.lost += 1;
            }
            self.waiting.push_back((key, IpDefragBuf::new(protocol, Vec::new(), Vec::new())));
            self.waiting.len() - 1
        });
        let buffer = &mut self.waiting[at].1;
        if buffer.add(place.offset, place.more, payload).is_err() {
            // Fragments that contradict each other are of two packets with one number: the newer one counts.
            *buffer = IpDefragBuf::new(protocol, Vec::new(), Vec::new());
            self.lost += 1;
            buffer.add(place.offset, place.more, payload).ok()?;
        }
        if !buffer.is_complete() {
            return None;
        }
        let (_, buffer) = self.waiting.remove(at)?;
        Some(buffer.take_bufs().0)
    }

    /// Packets that still wait.
    pub fn open(&self) -> u64 {
        self.waiting.len() as u64
    }
}
