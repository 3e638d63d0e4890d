//! The requests of a bus by unit and function, each with its series.

use std::collections::{BTreeMap, HashMap};

use super::line::RequestBucket;
use super::series::Series;

/// Pairs of unit and function that have series, all buses taken together.
pub const MAX_REQUESTS: usize = 1024;

/// Where a pair of unit and function is looked for first: by its last bits.
const LIKELY: usize = 256;

/// The requests of one function to one unit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Requests {
    /// Unit and function as one number.
    key: u16,
    pub series: Series<RequestBucket>,
    /// The least hash of a transaction, by status.
    pub examples: [u64; 8],
}

/// Those of a bus, which are looked up for each transaction.
#[derive(Clone, Debug)]
pub(super) struct RequestsOfBus {
    all: Vec<Requests>,
    /// By unit and function as one number: the index of their requests.
    places: HashMap<u16, u16, foldhash::fast::FixedState>,
    /// By the last bits of unit and function: those that were looked for last, and their index.
    likely: [(u16, u16); LIKELY],
}

impl Default for RequestsOfBus {
    fn default() -> Self {
        // In each place something that is never looked for there: 0 is looked for in the first one, and 1 in the next.
        let mut likely = [(0, 0); LIKELY];
        likely[0].0 = 1;
        Self { all: Vec::new(), places: HashMap::default(), likely }
    }
}

/// Two are equal that have the same series, whatever the order in which they came.
impl PartialEq for RequestsOfBus {
    fn eq(&self, other: &Self) -> bool {
        self.sorted() == other.sorted()
    }
}

impl Requests {
    /// None yet, with buckets that will be two to the power of `shift` wide or wider.
    pub fn new((unit, function): (u8, u8), shift: u32) -> Self {
        Self { key: u16::from_be_bytes([unit, function]), series: Series::new(shift), examples: [u64::MAX; 8] }
    }

    /// Unit and function.
    pub fn unit_and_function(&self) -> (u8, u8) {
        self.key.to_be_bytes().into()
    }
}

impl RequestsOfBus {
    /// The index of those of one function to one unit.
    #[inline]
    pub fn find(&mut self, (unit, function): (u8, u8)) -> Option<usize> {
        let key = u16::from_be_bytes([unit, function]);
        let likely = &mut self.likely[likely_place(key)];
        if likely.0 != key {
            *likely = (key, *self.places.get(&key)?);
        }
        Some(likely.1.into())
    }

    /// Those with this index.
    #[inline]
    pub fn at(&mut self, index: usize) -> &mut Requests {
        &mut self.all[index]
    }

    /// Adds those of a function to a unit that is not among them, and gives their index.
    pub fn add(&mut self, requests: Requests) -> usize {
        self.places.insert(requests.key, self.all.len() as u16);
        self.all.push(requests);
        self.all.len() - 1
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// All of them, in the order in which they came.
    pub fn iter(&self) -> impl Iterator<Item = &Requests> {
        self.all.iter()
    }

    /// By unit and function, so that output does not depend on the order in which they came.
    pub fn sorted(&self) -> BTreeMap<(u8, u8), &Requests> {
        self.all.iter().map(|requests| (requests.unit_and_function(), requests)).collect()
    }
}

/// Neighbouring units with the functions that are usual have places of their own.
#[inline]
fn likely_place(key: u16) -> usize {
    (usize::from(key >> 8) * 29 + usize::from(key & 0xFF)) % LIKELY
}
