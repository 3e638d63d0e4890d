//! Requests that came before, with all that follows from their bytes alone.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rtu_exchange::rtu_transaction_confidence;
use crate::records::Exchange;
use crate::rtu_model::traffic_model::RequestIdentity;
use crate::stats::{RequestPlace, Stats};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;

/// The bytes that tell a plain read from others: all of it on an RTU line; on TCP the length that the header says, and what
/// follows.
pub(crate) const READ_BYTES: usize = 8;

/// Places for requests at first, and at most: powers of two. A capture may have thousands of connections with a few requests
/// each.
const FIRST_PLACES: usize = 16;
const MAX_PLACES: usize = 2048;

/// A request is in one of so many places after each other, unless all of them were taken. With a single one, a tenth of a list
/// of 120 polls took the places of others again and again.
const PROBES: usize = 4;

/// Reads that were found valid, with what follows from their bytes.
#[derive(Default)]
pub(crate) struct RequestMemo {
    /// For each place, the number of the read in `reads` plus one; 0 where there is none.
    places: Vec<u16>,
    reads: Vec<MemoEntry>,
    /// Numbers of the read that came last, and of the one that followed it the last time (`next`).
    last: usize,
    likely: usize,
}

/// One of them.
#[derive(Clone, Copy)]
pub(crate) struct MemoEntry {
    pub bytes: [u8; READ_BYTES],
    pub expected: ExpectedExchange,
    /// Where the statistics count it; `None` if they have no room for it.
    pub counters: Option<RequestPlace>,
    /// The compact exchange on an RTU line, but for its place.
    pub exchange: Exchange,
    /// What the framer knows it by there.
    pub identity: RequestIdentity,
    /// The generation of the bus's profiles (`Profiles::generation`) in which they have nothing more to learn from it.
    pub settled: u32,
    /// Number of the read that followed it the last time.
    follower: u16,
}

impl RequestMemo {
    /// Returns the places for a request, none if there are none at all. The first one is some of the highest bits of its product
    /// with an odd number without pattern.
    #[inline]
    fn places_for(&self, bytes: [u8; READ_BYTES]) -> impl Iterator<Item = usize> + use<> {
        let mixed = u64::from_le_bytes(bytes).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - MAX_PLACES.ilog2());
        let mask = self.places.len().wrapping_sub(1);
        (0..PROBES.min(self.places.len())).map(move |probe| (mixed as usize + probe) & mask)
    }

    /// Returns the number of a request in `reads`.
    #[inline]
    fn number_of(&self, bytes: [u8; READ_BYTES]) -> Option<usize> {
        let mut taken = self.places_for(bytes).map_while(|place| usize::from(self.places[place]).checked_sub(1));
        taken.find(|&number| self.reads[number].bytes == bytes)
    }

    /// Returns the exchange that a request announces, if the slow path would have nothing to report on it
    /// (`ExpectedExchange::from_request`), and what is known of it if it came before. `key`: the bytes that tell it from others.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
    pub(crate) fn announced(
        &self,
        functions: &Functions,
        mode: Mode,
        key: &[u8],
        request: &[u8],
    ) -> Option<(ExpectedExchange, Option<&MemoEntry>)> {
        match self.get(key) {
            Some(known) => Some((known.expected, Some(known))),
            None => Some((ExpectedExchange::from_request(functions, mode, request)?, None)),
        }
    }

    #[inline]
    pub(crate) fn get(&self, bytes: &[u8]) -> Option<&MemoEntry> {
        Some(&self.reads[self.number_of(*bytes.first_chunk()?)?])
    }

    /// Returns the same for the request after the one that this was asked for the last time: a master polls in a cycle, so it is
    /// mostly the one that came after that before, and need not be looked for.
    #[inline]
    pub(crate) fn next(&mut self, bytes: [u8; READ_BYTES]) -> Option<&MemoEntry> {
        if self.reads.get(self.likely).is_none_or(|likely| likely.bytes != bytes) {
            self.likely = self.number_of(bytes)?;
            if let Some(last) = self.reads.get_mut(self.last) {
                last.follower = self.likely as u16;
            }
        }
        let read = self.reads.get(self.likely)?;
        (self.last, self.likely) = (self.likely, usize::from(read.follower));
        Some(read)
    }

    /// Returns whether a request is a read, and so may be kept.
    #[inline]
    pub(crate) fn takes(request: &[u8], expected: &ExpectedExchange) -> bool {
        request.len() == READ_BYTES && !expected.echoes_request
    }

    /// Keeps a request that has just been counted under `counts`, if it is a plain read.
    #[inline]
    pub(crate) fn keep(&mut self, stats: &mut Stats, counts: usize, request: &[u8], expected: &ExpectedExchange) {
        if Self::takes(request, expected) {
            self.add(request, *expected, stats.place_of(counts, expected.key()));
        }
    }

    /// Keeps a request that it takes, which is valid. If all places that it may have are taken, there come to be more, or at last
    /// it takes that of another one.
    #[cold]
    pub(crate) fn add(&mut self, request: &[u8], expected: ExpectedExchange, counters: Option<RequestPlace>) {
        let Ok(bytes) = <[u8; READ_BYTES]>::try_from(request) else { return };
        while self.place_of(bytes).is_none() && self.places.len() < MAX_PLACES {
            let places = (2 * self.places.len()).max(FIRST_PLACES);
            self.places.clear();
            self.places.resize(places, 0);
            for known in std::mem::take(&mut self.reads) {
                self.put(known);
            }
        }
        let confidence = rtu_transaction_confidence(false, u8::MAX);
        let exchange = expected.compact(0, expected.rtu_lengths(), confidence, 0);
        self.put(MemoEntry {
            bytes,
            expected,
            counters,
            exchange,
            identity: RequestIdentity::of(request),
            settled: 0,
            follower: 0,
        });
    }

    /// Returns the place that a read has, or else the first free one that it may have.
    fn place_of(&self, bytes: [u8; READ_BYTES]) -> Option<usize> {
        let is_own = |number: usize| self.reads[number].bytes == bytes;
        self.places_for(bytes).find(|&place| usize::from(self.places[place]).checked_sub(1).is_none_or(is_own))
    }

    /// Notes that the profiles of this generation have nothing more to learn from the read at the head of these bytes, if it is
    /// kept.
    #[inline]
    pub(crate) fn settle(&mut self, bytes: &[u8], generation: u32) {
        let place = bytes.first_chunk().and_then(|head| self.place_of(*head));
        if let Some(number) = place.and_then(|place| usize::from(self.places[place]).checked_sub(1)) {
            self.reads[number].settled = generation;
        }
    }

    /// Puts a read into its place, or else into that of another read.
    fn put(&mut self, known: MemoEntry) {
        let place = self.place_of(known.bytes).or_else(|| self.places_for(known.bytes).next()).expect("there are some");
        if let Some(number) = usize::from(self.places[place]).checked_sub(1) {
            self.reads[number] = known;
        } else {
            self.reads.push(known);
            self.places[place] = self.reads.len() as u16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        // A request may have to give its place to another one, but what is found is what was kept of the same bytes.
        #[test]
        fn what_is_found_was_kept_of_the_same_bytes(reads in proptest::collection::vec((1u8..248, 3u8..5, any::<u16>(), 1u8..126), 1..3000)) {
            let functions = Functions::default();
            let (mut known, mut kept) = (RequestMemo::default(), HashMap::new());
            for &(unit, function, address, quantity) in &reads {
                let [high, low] = address.to_be_bytes();
                let head = [unit, function, high, low, 0, quantity];
                let request = modlens_protocol::checksum::crc16(&head).to_le_bytes();
                let request = [&head[..], &request].concat();
                let Some(expected) = ExpectedExchange::from_request(&functions, Mode::Rtu, &request) else { continue };
                if RequestMemo::takes(&request, &expected) {
                    known.add(&request, expected, None);
                    kept.insert(request.clone(), (unit, function, address, u16::from(quantity)));
                    prop_assert!(known.get(&request).is_some(), "the last one kept is found");
                }
            }
            // A read is found after another one as it is found alone, whichever came after that before.
            let mut polled: Vec<[u8; READ_BYTES]> = kept.keys().map(|request| request[..].try_into().unwrap()).collect();
            polled.sort_unstable();
            for turn in 0..3 {
                for at in 0..polled.len() {
                    let request = polled[(at * (2 * turn + 1)) % polled.len()];
                    let alone = known.get(&request).map(|read| read.bytes);
                    let behind = known.next(request).map(|read| read.bytes);
                    prop_assert_eq!(behind, alone);
                }
            }
            let found = |request: &Vec<u8>| known.get(request).map(|known| known.expected);
            for (request, fields) in &kept {
                if let Some(found) = found(request) {
                    prop_assert_eq!((found.unit, found.code, found.address, found.quantity), *fields);
                }
            }
            prop_assert!(known.reads.len() <= known.places.len() && known.places.len() <= MAX_PLACES);
        }
    }
}
