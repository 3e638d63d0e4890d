//! Chooses UDP ports and transaction identifiers so that Wireshark pairs the frames of a transaction and no others.
//!
//! Wireshark pairs a response with the newest request that has the same ports, identifier, unit and function, whatever
//! the interface; if there is none, it searches all requests of those ports. So every bus has ports of its own, and new
//! ones every 1000 transactions to keep that search short.

use std::collections::VecDeque;

use super::payload::{Route, SERVER_PORT};
use modlens_protocol::direction::Direction;

/// The first port of the dynamic range (RFC 6335, section 6), and the number of its ports.
const FIRST_PORT: u16 = 49_152;
const PORT_COUNT: u32 = 16_384;

/// The number of consecutive transactions of a bus that share a port.
const TRANSACTIONS_PER_PORT: u64 = 1000;

/// The number of ports remembered per bus. Open transactions are among the newest, so they use one of these.
const PORTS_PER_BUS: usize = 8;

/// Set in the identifiers of frames without a transaction. The identifiers of transactions are the lower bits of their
/// numbers.
const UNPAIRED_ID: u16 = 0x8000;

/// Assigns ports to transactions.
#[derive(Debug, Default)]
pub struct Ports {
    assigned: u32,
    /// For each bus: the first transaction of each port, and the port, newest last.
    buses: Vec<VecDeque<(u64, u16)>>,
}

impl Ports {
    /// The port of the master in a transaction.
    pub fn master(&mut self, bus: usize, txn: u64) -> u16 {
        if self.buses.len() <= bus {
            self.buses.resize_with(bus + 1, VecDeque::new);
        }
        if self.buses[bus].back().is_none_or(|&(first, _)| txn >= first + TRANSACTIONS_PER_PORT) {
            let port = FIRST_PORT + (self.assigned % PORT_COUNT) as u16;
            self.assigned += 1;
            let ports = &mut self.buses[bus];
            ports.push_back((txn, port));
            if ports.len() > PORTS_PER_BUS {
                ports.pop_front();
            }
        }
        let ports = &self.buses[bus];
        let found = ports.iter().rev().find(|(first, _)| *first <= txn).or(ports.front());
        found.map_or(FIRST_PORT, |(_, port)| *port)
    }

    /// Ports and identifier of a frame. `beside` says that the frame must not be paired with any other.
    pub fn route(&mut self, bus: usize, txn: u64, direction: Direction, unpaired: bool) -> Route {
        let master = self.master(bus, txn);
        let id = txn as u16 & !UNPAIRED_ID | if unpaired { UNPAIRED_ID } else { 0 };
        match direction {
            Direction::Request => Route { from: master, to: SERVER_PORT, id },
            Direction::Response => Route { from: SERVER_PORT, to: master, id },
            // If neither port is the server's, Wireshark shows the direction as unknown.
            Direction::Unknown => Route { from: master, to: master, id },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buses_share_no_ports_and_both_frames_of_a_transaction_have_the_same() {
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
    fn a_response_has_the_port_of_its_request() {
        let mut ports = Ports::default();
        let first = ports.master(0, 999);
        assert_eq!(ports.master(0, 1000), first);
        let later = ports.master(0, 1999);
        assert_ne!(later, first);
        assert_eq!(ports.master(0, 1998), first);
    }
}
