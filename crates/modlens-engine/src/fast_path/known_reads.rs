//! Requests that came before, with all that follows from their bytes alone.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::stats::RequestPlace;

/// The bytes that tell a plain read from others: all of it on an RTU line; on TCP the length that the header says, and what
/// follows.
const READ_BYTES: usize = 8;

/// Places for requests at first, and at most: powers of two. A capture may have thousands of connections with a few requests each.
const FIRST_PLACES: usize = 16;
const MAX_PLACES: usize = 1024;

/// Reads that were found valid and unlike any response, with what follows from their bytes.
#[derive(Default)]
pub(crate) struct KnownReads(Vec<Option<KnownRead>>);

/// One of them.
#[derive(Clone, Copy)]
pub(super) struct KnownRead {
    bytes: [u8; READ_BYTES],
    pub expected: ExpectedExchange,
    /// Where the statistics count it; `None` if they have no room for it.
    pub counters: Option<RequestPlace>,
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

    /// Keeps a request that it takes, which is valid. If there is another one at its place, there come to be more places, or at
    /// last it takes that place.
    #[cold]
    pub(super) fn add(&mut self, request: &[u8], expected: ExpectedExchange, counters: Option<RequestPlace>) {
        let Ok(bytes) = <[u8; READ_BYTES]>::try_from(request) else { return };
        let new = KnownRead { bytes, expected, counters };
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

    fn put(&mut self, known: KnownRead) {
        let place = self.place(known.bytes);
        self.0[place] = Some(known);
    }
}
