//! Where the counters of a request are, and how long ago it was answered: so that a request that comes again and again is not
//! looked for each time.
//!
//! All of it can be forgotten at any time: it is found anew, and counts nothing itself.

use super::recent::RECENT;
use super::request::{RequestCounts, MAX_REQUESTS};
use super::sample::Sample;
use crate::observation::RequestKey;

/// The counters of the requests of a bus.
type Requests = Sample<RequestKey, RequestCounts, MAX_REQUESTS>;

/// Places that are remembered: one for each value of the last bits of a hash.
const PLACES: usize = 4096;

/// What is remembered.
#[derive(Clone, Debug, Default)]
pub(super) struct Recall {
    /// By the last bits of a request's hash: the place of its counters.
    places: Vec<u16>,
    /// In the same order: the whole hash of a request, and the number of the last answer to it.
    answers: Vec<(u64, u64)>,
    /// How many answers there were.
    count: u64,
    /// The number of the last answer that was forgotten for another one at its place.
    last_forgotten: u64,
}

/// What is remembered makes no difference.
impl PartialEq for Recall {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Recall {
    /// The place of the counters of a request, which are added if it is new; `None` if there is no room for them.
    #[inline]
    pub fn slot(&mut self, requests: &mut Requests, key: RequestKey, hash: u64) -> Option<usize> {
        if requests.is_beyond(hash) {
            return None;
        }
        let place = hash as usize % PLACES;
        let likely = self.places.get(place).map_or(usize::MAX, |slot| usize::from(*slot));
        if requests.at(likely, &key).is_some() {
            return Some(likely);
        }
        let slot = requests.slot(hash, key)?;
        if self.places.is_empty() {
            self.places.resize(PLACES, u16::MAX);
        }
        self.places[place] = slot as u16;
        Some(slot)
    }

    /// How many answers ago that to the request with this hash was, 1 for the last; `u64::MAX` if it is none of those of which
    /// the data are remembered, `None` if that is not known.
    #[inline]
    pub fn age(&self, hash: u64) -> Option<u64> {
        match self.answers.get(hash as usize % PLACES) {
            Some((own, number)) if *own == hash => Some(self.count - number + 1),
            _ => (self.count - self.last_forgotten >= RECENT as u64).then_some(u64::MAX),
        }
    }

    /// Notes the next answer, and the hash of the request if it has read data.
    #[inline]
    pub fn note(&mut self, read: Option<u64>) {
        self.count += 1;
        let Some(hash) = read else { return };
        if self.answers.is_empty() {
            self.answers.resize(PLACES, (0, 0));
        }
        let place = &mut self.answers[hash as usize % PLACES];
        if place.0 != hash {
            self.last_forgotten = self.last_forgotten.max(place.1);
        }
        *place = (hash, self.count);
    }
}
