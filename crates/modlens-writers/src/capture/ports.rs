//! Ports and identifiers, so that Wireshark joins what belongs together and nothing else.
//!
//! It pairs a response with the newest request of the same ports, identifier, unit and function, whatever the interface,
//! and searches all requests of those ports where there is none: a bus has ports of its own, and new ones every 1000
//! transactions, so that the search stays short.

use std::collections::VecDeque;

use super::payload::{Route, SERVER_PORT};
use modlens_protocol::direction::Direction;

/// First port of the dynamic range (RFC 6335); it has 16,384.
const FIRST: u16 = 49_152;
const PORTS: u32 = 16_384;

/// Transactions of a bus that share a port.
const PER_PORT: u64 = 1000;

/// Ports of a bus that are remembered: its open transactions are among the newest.
const REMEMBERED: usize = 8;

/// A transaction's identifier is its number; frames beside the transactions have the upper half for themselves.
const BESIDE: u16 = 0x8000;

/// Gives ports to transactions.
#[derive(Debug, Default)]
pub struct Ports {
    given: u32,
    /// Of each bus: first transaction and port, the newest last.
    buses: Vec<VecDeque<(u64, u16)>>,
}

impl Ports {
    /// The master's port of a transaction.
    pub fn master(&mut self, bus: usize, txn: u64) -> u16 {
        if self.buses.len() <= bus {
            self.buses.resize_with(bus + 1, VecDeque::new);
        }
        if self.buses[bus].back().is_none_or(|&(first, _)| txn >= first + PER_PORT) {
            let port = FIRST + (self.given % PORTS) as u16;
            self.given += 1;
            let ports = &mut self.buses[bus];
            ports.push_back((txn, port));
            if ports.len() > REMEMBERED {
                ports.pop_front();
            }
        }
        let ports = &self.buses[bus];
        let found = ports.iter().rev().find(|(first, _)| *first <= txn).or(ports.front());
        found.map_or(FIRST, |(_, port)| *port)
    }

    /// The way of a frame: `beside` says that it must pair with nothing.
    pub fn route(&mut self, bus: usize, txn: u64, direction: Direction, beside: bool) -> Route {
        let master = self.master(bus, txn);
        let id = txn as u16 & !BESIDE | if beside { BESIDE } else { 0 };
        match direction {
            Direction::Request => Route { from: master, to: SERVER_PORT, id },
            Direction::Response => Route { from: SERVER_PORT, to: master, id },
            // Without the server's port Wireshark says that it cannot tell.
            Direction::Unknown => Route { from: master, to: master, id },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buses_share_no_port_and_change_it_together_with_no_transaction_cut() {
        let mut ports = Ports::default();
        let mut seen = [std::collections::HashSet::new(), std::collections::HashSet::new()];
        for txn in 1..=6000 {
            let bus = (txn % 3 == 0) as usize;
            let request = ports.route(bus, txn, Direction::Request, false);
            // Other transactions begin before this one is answered.
            if txn > 40 {
                let early = txn - 40;
                ports.master((early % 3 == 0) as usize, early);
            }
            let response = ports.route(bus, txn, Direction::Response, false);
            assert_eq!((request.from, request.to, request.id), (response.to, response.from, response.id));
            seen[bus].insert((request.from, request.id));
        }
        assert!(seen[0].is_disjoint(&seen[1]));
        assert_eq!(seen[0].len() + seen[1].len(), 6000);
    }

    #[test]
    fn an_answer_keeps_the_port_of_its_request() {
        let mut ports = Ports::default();
        let first = ports.master(0, 999);
        assert_eq!(ports.master(0, 1000), first);
        let later = ports.master(0, 1999);
        assert_ne!(later, first);
        assert_eq!(ports.master(0, 1998), first);
    }
}
