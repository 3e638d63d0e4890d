//! Requests of an RTU line that came before, with all that follows from their bytes alone.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::stats::RequestPlace;

/// Bytes of a plain read on the wire.
const READ_BYTES: usize = 8;

/// Places for requests, a power of two; a request that finds another one at its place takes it.
const PLACES: usize = 1024;

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
    /// The place of a request: the highest bits of its product with an odd number without pattern.
    fn place(bytes: [u8; READ_BYTES]) -> usize {
        (u64::from_le_bytes(bytes).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - PLACES.ilog2())) as usize
    }

    #[inline]
    pub(super) fn get(&self, bytes: &[u8]) -> Option<&KnownRead> {
        let head = bytes.first_chunk()?;
        self.0.get(Self::place(*head))?.as_ref().filter(|known| known.bytes == *head)
    }

    /// Whether a request is a read that cannot be taken for a response, and so may be kept.
    #[inline]
    pub(super) fn takes(request: &[u8], expected: &ExpectedExchange) -> bool {
        request.len() == READ_BYTES && !expected.echoes_request && !expected.resembles_response
    }

    /// Keeps a request that it takes, whose CRC is valid.
    #[cold]
    pub(super) fn add(&mut self, request: &[u8], expected: ExpectedExchange, counters: Option<RequestPlace>) {
        let Ok(bytes) = <[u8; READ_BYTES]>::try_from(request) else { return };
        self.0.resize(PLACES, None);
        self.0[Self::place(bytes)] = Some(KnownRead { bytes, expected, counters });
    }
}
