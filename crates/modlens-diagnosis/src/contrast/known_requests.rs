//! The requests that are asked again and again: which exchanges of each went well and are not counted yet, and what it was
//! answered last. So nothing is looked up but this for most exchanges.

use super::recent::RECENT;
use crate::observation::RequestKey;

/// Requests that are known at a time. Where there are more, all are forgotten, and found again.
const MAX_KNOWN: usize = 2048;

/// Places by the hash of a request, of which half are taken at most: a power of two.
const PLACES: usize = 2 * MAX_KNOWN;

/// A place that is not taken.
const FREE: u16 = u16::MAX;

/// What is known of the requests of a bus.
#[derive(Clone, Debug, Default)]
pub(super) struct RequestMemory {
    /// By hash, or after it where that place is taken: the index of a request.
    places: Vec<u16>,
    all: Vec<RememberedRequest>,
    /// How many transactions there were when requests, or answers to them, were forgotten.
    forgotten: u64,
}

/// What is known makes no difference once nothing is pending.
impl PartialEq for RequestMemory {
    fn eq(&self, other: &Self) -> bool {
        let pending = |all: &Self| all.all.iter().any(|known| known.pending.good > 0);
        !pending(self) && !pending(other)
    }
}

/// What is known of a request.
#[derive(Clone, Debug)]
pub(super) struct RememberedRequest {
    /// Which request, as a number.
    number: u64,
    /// The place of its counters; `None` if there is no room for them.
    pub slot: Option<u16>,
    /// The first registers of the last answer.
    pub head: [u16; 2],
    /// The number of the last transaction for which that answer is one of the last that are remembered.
    pub recent_until: u64,
    pub pending: PendingExchanges,
}

/// Exchanges that went well and are not counted yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingExchanges {
    /// How many.
    pub good: u32,
    /// Those with an answer that has data, but neither all FFFF nor all 0000.
    pub usual: u32,
    /// Those of them that begin or end with FFFF, and with 0000.
    pub near: [u32; 2],
    /// Whether they write.
    pub writes: bool,
    /// The request that mostly comes right before this one, as a number.
    pub after: u64,
    /// How many came right after that one.
    pub pairs: u32,
    /// How many came after another one, which are counted already.
    pub other_pairs: u32,
}

/// No request has this number.
const NO_REQUEST: u64 = u64::MAX;

impl Default for PendingExchanges {
    fn default() -> Self {
        Self { good: 0, usual: 0, near: [0; 2], writes: false, after: NO_REQUEST, pairs: 0, other_pairs: 0 }
    }
}

impl PendingExchanges {
    /// Takes what is pending; the request that mostly comes before stays the one that is expected there.
    pub fn take(&mut self) -> Self {
        std::mem::replace(self, Self { after: self.after, ..Self::default() })
    }

    /// Whether one came right after the request that mostly does, which counts it; `before` is its number.
    #[inline]
    pub fn is_behind(&mut self, before: u64) -> bool {
        let is_expected = self.after == before;
        self.pairs += u32::from(is_expected);
        is_expected
    }

    /// One came right after another request; gives which pairs are to be counted for that. If the request that mostly comes
    /// before has become the rarer one, that is another one from here on.
    pub fn come_behind(&mut self, another: u64) -> Option<(RequestKey, u32)> {
        if self.other_pairs < self.pairs {
            self.other_pairs += 1;
            return Some((RequestKey::of_number(another), 1));
        }
        let pairs = self.pairs();
        (self.after, self.pairs, self.other_pairs) = (another, 1, 0);
        pairs
    }

    /// The request that mostly comes right before, and how often it did.
    pub fn pairs(&self) -> Option<(RequestKey, u32)> {
        (self.pairs > 0).then(|| (RequestKey::of_number(self.after), self.pairs))
    }
}

impl RememberedRequest {
    /// Which request.
    pub fn key(&self) -> RequestKey {
        RequestKey::of_number(self.number)
    }

    /// Notes the answer of a transaction with this number.
    #[inline]
    pub fn note(&mut self, transaction: u64, head: [u16; 2]) {
        (self.head, self.recent_until) = (head, transaction + RECENT);
    }
}

impl RequestMemory {
    /// The index of the request with this number.
    #[inline]
    pub fn find(&self, number: u64) -> Option<usize> {
        let mut place = place_of(number);
        loop {
            let index = *self.places.get(place)?;
            match self.all.get(usize::from(index)) {
                Some(known) if known.number == number => return Some(usize::from(index)),
                Some(_) => place = (place + 1) % PLACES,
                None => return None,
            }
        }
    }

    /// Adds a request that is not known, and gives its index. There has to be room.
    pub fn add(&mut self, key: RequestKey, slot: Option<usize>) -> usize {
        if self.places.is_empty() {
            self.places.resize(PLACES, FREE);
        }
        let number = key.number();
        let mut place = place_of(number);
        while self.places[place] != FREE {
            place = (place + 1) % PLACES;
        }
        self.places[place] = self.all.len() as u16;
        let (slot, pending) = (slot.map(|slot| slot as u16), PendingExchanges::default());
        self.all.push(RememberedRequest { number, slot, head: [0; 2], recent_until: 0, pending });
        self.all.len() - 1
    }

    /// The request with this index.
    #[inline]
    pub fn at(&mut self, index: usize) -> &mut RememberedRequest {
        &mut self.all[index]
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether there is no room for another one.
    pub fn is_full(&self) -> bool {
        self.all.len() == MAX_KNOWN
    }

    /// Forgets all of them, of which nothing may be pending. There were so many transactions.
    pub fn clear(&mut self, transactions: u64) {
        self.places.clear();
        self.all.clear();
        self.forgotten = transactions;
    }

    /// Notes the first registers of what was read, in the transaction with this number, which is counted otherwise.
    pub fn note(&mut self, key: RequestKey, transaction: u64, head: [u16; 2]) {
        match self.find(key.number()) {
            Some(index) => self.all[index].note(transaction, head),
            None => self.forgotten = transaction,
        }
    }

    /// Whether a request that is not known may have been answered in one of the last transactions before this one.
    pub fn has_forgotten(&self, transaction: u64) -> bool {
        transaction <= self.forgotten + RECENT
    }
}

/// Where a request with this number is looked for first.
#[inline]
fn place_of(number: u64) -> usize {
    (number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - PLACES.ilog2())) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(address: u16) -> RequestKey {
        RequestKey { unit: (address % 7) as u8, function: 3, address, quantity: 1 }
    }

    #[test]
    fn all_of_them_are_found_until_they_are_forgotten() {
        let mut all = RequestMemory::default();
        assert_eq!(all.find(key(1).number()), None);
        for address in 0..MAX_KNOWN as u16 {
            assert!(!all.is_full());
            assert_eq!(all.add(key(address), None), usize::from(address));
        }
        assert!(all.is_full());
        assert!((0..MAX_KNOWN as u16).all(|address| all.find(key(address).number()) == Some(usize::from(address))));
        assert!((0..99).all(|more| all.find(key(MAX_KNOWN as u16 + more).number()).is_none()));
        all.clear(1000);
        assert_eq!(all.find(key(1).number()), None);
        assert!(all.has_forgotten(1048) && !all.has_forgotten(1049));
        assert_eq!(key(9), RequestKey::of_number(key(9).number()));
    }
}
