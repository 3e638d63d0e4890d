//! What the rows of all buses share, in pieces: a batch keeps the list as it was then, and where a connection is added
//! to thousands, one piece of them is copied and not all.

use std::ops::{Index, IndexMut};
use std::sync::Arc;

use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};

/// Who talks on a connection of a network.
#[derive(Clone, Debug)]
pub struct Network {
    /// Address of the client.
    pub client: String,
    /// Address and port of the server.
    pub server: String,
    /// Number of the connection.
    pub connection: u64,
}

/// What all rows of a bus, or of one connection, share.
#[derive(Clone, Debug)]
pub struct Bus {
    /// As the `bus` column names it.
    pub name: String,
    /// The file or port, as `source` names it.
    pub source: String,
    /// What `origin` counts.
    pub place: Place,
    /// Its clock.
    pub clock: Clock,
    /// Its line settings, where they are known.
    pub line: Option<LineSettings>,
    /// Who talks, where it is a connection of a network.
    pub network: Option<Network>,
}

/// Buses of a piece: large ones are dear to copy, small ones make a long list.
const PIECE: usize = 16;

/// Buses by number. A copy of it shares what neither of the two changes.
#[derive(Clone, Debug, Default)]
pub struct Buses(Vec<Arc<[Bus]>>);

impl Buses {
    /// Adds one.
    pub fn push(&mut self, bus: Bus) {
        match self.0.last_mut().filter(|piece| piece.len() < PIECE) {
            Some(piece) => *piece = piece.iter().cloned().chain([bus]).collect(),
            None => self.0.push(Arc::new([bus])),
        }
    }
}

impl Index<usize> for Buses {
    type Output = Bus;

    #[inline]
    fn index(&self, bus: usize) -> &Bus {
        &self.0[bus / PIECE][bus % PIECE]
    }
}

impl IndexMut<usize> for Buses {
    fn index_mut(&mut self, bus: usize) -> &mut Bus {
        &mut Arc::make_mut(&mut self.0[bus / PIECE])[bus % PIECE]
    }
}

impl FromIterator<Bus> for Buses {
    fn from_iter<I: IntoIterator<Item = Bus>>(buses: I) -> Self {
        let mut all = Self::default();
        buses.into_iter().for_each(|bus| all.push(bus));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::BusOptions;

    fn named(number: usize) -> Bus {
        BusOptions::named(&number.to_string()).bus
    }

    #[test]
    fn a_copy_stays_as_it_was_and_shares_the_rest() {
        let mut all: Buses = (0..100).map(named).collect();
        let before = all.clone();
        all.push(named(100));
        all[40].name = String::from("another");
        assert_eq!((all[40].name.as_str(), all[100].name.as_str()), ("another", "100"));
        assert!((0..100).all(|bus| before[bus].name == bus.to_string()));
        let shared = all.0.iter().zip(&before.0).filter(|(one, other)| Arc::ptr_eq(one, other)).count();
        assert_eq!(shared, 100_usize.div_ceil(PIECE) - 2);
    }
}
