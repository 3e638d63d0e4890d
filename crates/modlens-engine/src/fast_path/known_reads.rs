//! Requests that came before, with all that follows from their bytes alone.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::stats::{RequestPlace, Stats};

/// The bytes that tell a plain read from others: all of it on an RTU line; on TCP the length that the header says, and what
/// follows.
const READ_BYTES: usize = 8;

/// Places for requests at first, and at most: powers of two. A capture may have thousands of connections with a few requests
/// each.
const FIRST_PLACES: usize = 16;
const MAX_PLACES: usize = 1024;

/// Reads that were found valid and unlike any response, with what follows from their bytes.
#[derive(Default)]
pub(crate) struct KnownReads(Vec<Option<KnownRead>>);

/// One of them.
#[derive(Clone, Copy)]
pub(super) struct KnownRead {
    pub bytes: [u8; READ_BYTES],
    pub expected: ExpectedExchange,
    /// Where the statistics count it; `None` if they have no room for it.
    pub counters: Option<RequestPlace>,
    /// The generation of the bus's profiles (`Profiles::generation`) in which they have nothing more to learn from it.
    pub settled: u32,
}

impl KnownReads {
    /// The place of a request: some of the highest bits of its product with an odd number without pattern.
    #[inline]
    fn place(&self, bytes: [u8; READ_BYTES]) -> usize {
        let mixed = u64::from_le_bytes(bytes).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - MAX_PLACES.ilog2());
        mixed as usize & self.0.len().wrapping_sub(1)
    }

    #[inline]
    pub(super) fn get(&self, bytes: &[u8]) -> Option<&KnownRead> {
        let head = bytes.first_chunk()?;
        self.0.get(self.place(*head))?.as_ref().filter(|known| known.bytes == *head)
    }

    /// Whether a request is a read that cannot be taken for a response, and so may be kept.
    #[inline]
    pub(super) fn takes(request: &[u8], expected: &ExpectedExchange) -> bool {
        request.len() == READ_BYTES && !expected.echoes_request && !expected.resembles_response
    }

    /// Keeps a request that has just been counted under `counts`, if it is a plain read.
    #[inline]
    pub(super) fn keep(&mut self, stats: &mut Stats, counts: usize, request: &[u8], expected: &ExpectedExchange) {
        if Self::takes(request, expected) {
            self.add(request, *expected, stats.place_of(counts, expected.key()));
        }
    }

    /// Keeps a request that it takes, which is valid. If there is another one at its place, there come to be more places, or at
    /// last it takes that place.
    #[cold]
    pub(super) fn add(&mut self, request: &[u8], expected: ExpectedExchange, counters: Option<RequestPlace>) {
        let Ok(bytes) = <[u8; READ_BYTES]>::try_from(request) else { return };
        let new = KnownRead { bytes, expected, counters, settled: 0 };
        if self.0.is_empty() {
            self.0.resize(FIRST_PLACES, None);
        }
        while self.0[self.place(bytes)].is_some_and(|known| known.bytes != bytes) && self.0.len() < MAX_PLACES {
            let known = std::mem::take(&mut self.0);
            self.0.resize(2 * known.len(), None);
            known.into_iter().flatten().for_each(|known| self.put(known));
        }
        self.put(new);
    }

    /// Notes that the profiles of this generation have nothing more to learn from a read that is kept.
    #[cold]
    pub(super) fn settle(&mut self, bytes: [u8; READ_BYTES], generation: u32) {
        let place = self.place(bytes);
        if let Some(known) = self.0[place].as_mut().filter(|known| known.bytes == bytes) {
            known.settled = generation;
        }
    }

    fn put(&mut self, known: KnownRead) {
        let place = self.place(known.bytes);
        self.0[place] = Some(known);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::framing::Mode;
    use modlens_protocol::functions::Functions;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        // A request may have to give its place to another one, but what is found is what was kept of the same bytes.
        #[test]
        fn what_is_found_was_kept_of_the_same_bytes(reads in proptest::collection::vec((1u8..248, 3u8..5, any::<u16>(), 1u8..126), 1..3000)) {
            let functions = Functions::default();
            let (mut known, mut kept) = (KnownReads::default(), HashMap::new());
            for &(unit, function, address, quantity) in &reads {
                let [high, low] = address.to_be_bytes();
                let head = [unit, function, high, low, 0, quantity];
                let request = modlens_protocol::checksum::crc16(&head).to_le_bytes();
                let request = [&head[..], &request].concat();
                let Some(expected) = ExpectedExchange::from_request(&functions, Mode::Rtu, &request) else { continue };
                if KnownReads::takes(&request, &expected) {
                    known.add(&request, expected, None);
                    kept.insert(request.clone(), (unit, function, address, u16::from(quantity)));
                    prop_assert!(known.get(&request).is_some(), "the last one kept is found");
                }
            }
            let found = |request: &Vec<u8>| known.get(request).map(|known| known.expected);
            for (request, fields) in &kept {
                if let Some(found) = found(request) {
                    prop_assert_eq!((found.unit, found.code, found.address, found.quantity), *fields);
                }
            }
            prop_assert!(known.0.len() <= MAX_PLACES);
        }
    }
}
