//! What the rows of a bus share, for all buses. Each batch keeps the list as it was when the batch was taken. The list
//! is split into chunks that copies share, so that adding a connection to thousands of them copies one chunk only.

use std::ops::{Index, IndexMut};
use std::sync::Arc;

use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};

/// The two ends of a connection.
#[derive(Clone, Debug)]
pub struct Network {
    /// Address of the client.
    pub client: String,
    /// Port of the client; `None` in rows that are read back, which do not have it.
    pub client_port: Option<u16>,
    /// Address and port of the server.
    pub server: String,
    /// Running number of the connection.
    pub connection: u64,
}

/// What all rows of a bus, or of one connection, share.
#[derive(Clone, Debug)]
pub struct Bus {
    /// Its name, as in the column `bus`.
    pub name: String,
    /// The file or port, as in the column `source`.
    pub source: String,
    /// The unit of `origin`: offsets, lines or packets.
    pub place: Place,
    /// The kind of its clock.
    pub clock: Clock,
    /// Its line settings, where they are known.
    pub line: Option<LineSettings>,
    /// The two ends, where it is a connection.
    pub network: Option<Network>,
}

/// Buses in a chunk. Large chunks are expensive to copy, small ones make the list of chunks long.
const BUSES_PER_CHUNK: usize = 16;

/// The buses by index. A copy shares all chunks until one of the two changes them.
#[derive(Clone, Debug, Default)]
pub struct Buses(Vec<Arc<[Bus]>>);

impl Buses {
    /// Adds a bus.
    pub fn push(&mut self, bus: Bus) {
        match self.0.last_mut().filter(|chunk| chunk.len() < BUSES_PER_CHUNK) {
            Some(chunk) => *chunk = chunk.iter().cloned().chain([bus]).collect(),
            None => self.0.push(Arc::new([bus])),
        }
    }
}

impl Index<usize> for Buses {
    type Output = Bus;

    #[inline]
    fn index(&self, bus: usize) -> &Bus {
        &self.0[bus / BUSES_PER_CHUNK][bus % BUSES_PER_CHUNK]
    }
}

impl IndexMut<usize> for Buses {
    fn index_mut(&mut self, bus: usize) -> &mut Bus {
        &mut Arc::make_mut(&mut self.0[bus / BUSES_PER_CHUNK])[bus % BUSES_PER_CHUNK]
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
    fn a_copy_does_not_change_and_shares_the_unchanged_chunks() {
        let mut all: Buses = (0..100).map(named).collect();
        let before = all.clone();
        all.push(named(100));
        all[40].name = String::from("another");
        assert_eq!((all[40].name.as_str(), all[100].name.as_str()), ("another", "100"));
        assert!((0..100).all(|bus| before[bus].name == bus.to_string()));
        let shared = all.0.iter().zip(&before.0).filter(|(one, other)| Arc::ptr_eq(one, other)).count();
        assert_eq!(shared, 100_usize.div_ceil(BUSES_PER_CHUNK) - 2);
    }
}
