//! A plain write on an RTU line, which its response repeats in full or by its first six bytes, in as few steps as it takes.
//!
//! Writes hardly come again with the same bytes, so that what follows from them is computed for each of them. `ExpectedExchange` says the
//! same of any request, and is the oracle of the property below.

use crate::fast_path::expected_exchange::{RTU_UNITS, SHORT_REQUEST_BYTES, WRITE_HEADER_BYTES};
use crate::findings::frame::is_plain_request;
use crate::framer::rtu::frame_check::is_followed_by_copy;
use modlens_protocol::checksum::{crc_valid_at, CRC_BYTES};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, StandardLayout};

/// Bytes of a response, and of a request that writes one value.
const SHORT_BYTES: usize = SHORT_REQUEST_BYTES + CRC_BYTES;

/// A write as its request announces it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PlainWrite {
    /// Bytes of the request and of the response, with their checksums.
    pub lengths: [usize; 2],
    /// The response has the same bytes as the request.
    pub is_mirrored: bool,
    /// Address of the first register or bit, and how many.
    pub address: u16,
    pub quantity: u16,
}

impl PlainWrite {
    /// Returns the write that a request at the head of these bytes announces; `None` where `ExpectedExchange::announced_by` gives
    /// none, or no write.
    #[inline]
    pub(crate) fn at(functions: &Functions, bytes: &[u8]) -> Option<Self> {
        let &[unit, code, address_high, address_low, high, low, count, _] = bytes.first_chunk()?;
        let standard = functions.standard_request(code)?;
        let number = u16::from_be_bytes([high, low]);
        let (quantity, data) = match standard.kind {
            StandardLayout::WriteOne => (1, None),
            StandardLayout::WriteBits => (number, Some(usize::from(number.div_ceil(8)))),
            StandardLayout::WriteRegisters => (number, Some(2 * usize::from(number))),
            _ => return None,
        };
        let is_consistent = data.is_none_or(|data| data == usize::from(count)) && RTU_UNITS.contains(&unit);
        let request = data.map_or(SHORT_BYTES, |data| WRITE_HEADER_BYTES + CRC_BYTES + data);
        is_consistent.then_some(Self {
            lengths: [request, SHORT_BYTES],
            is_mirrored: standard.has_equal_layouts,
            address: u16::from_be_bytes([address_high, address_low]),
            quantity,
        })
    }

    /// Returns whether its response follows at once, both have valid checksums, the response is no retry that a third copy may
    /// follow, and the slow path would find nothing on the request.
    #[inline]
    pub(crate) fn is_answered(&self, functions: &Functions, bytes: &[u8]) -> bool {
        let [request, response] = self.lengths;
        if bytes.len() < request + response {
            return false;
        }
        let answer = &bytes[request..];
        let is_copy = request == SHORT_BYTES && answer.first_chunk::<SHORT_BYTES>() == bytes.first_chunk();
        (is_copy || answer.first_chunk::<SHORT_REQUEST_BYTES>() == bytes.first_chunk() && crc_valid_at(answer, response))
            && crc_valid_at(bytes, request)
            && (!self.is_mirrored || is_followed_by_copy(answer, request) == Some(false))
            && is_plain_request(functions, Mode::Rtu, &bytes[..request - CRC_BYTES])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fast_path::expected_exchange::ExpectedExchange;
    use modlens_protocol::checksum::crc16;
    use proptest::prelude::*;

    fn framed(bytes: &[u8]) -> Vec<u8> {
        [bytes, &crc16(bytes).to_le_bytes()].concat()
    }

    proptest! {
        #[test]
        fn writes_are_those_that_requests_announce(
            unit in 0u8..250, code in prop_oneof![1u8..24, Just(5u8), Just(6), Just(15), Just(16)], address in any::<u16>(),
            quantity in prop_oneof![0u16..260, Just(0xFF00u16), any::<u16>()], count in prop_oneof![Just(None), any::<u8>().prop_map(Some)],
            data in proptest::collection::vec(any::<u8>(), 0..300), copies in 0usize..3, damage in prop_oneof![Just(None), (0usize..40, 1u8..).prop_map(Some)],
        ) {
            let functions = Functions::default();
            let [high, low] = quantity.to_be_bytes();
            let head = [&[unit, code][..], &address.to_be_bytes(), &[high, low]].concat();
            let bytes = match code { 15 => usize::from(quantity.div_ceil(8)), 16 => 2 * usize::from(quantity), _ => 0 };
            let request = match code {
                15 | 16 => [&head[..], &[count.unwrap_or(bytes as u8)], &data[..bytes.min(data.len())]].concat(),
                _ => head.clone(),
            };
            let mut line = [framed(&request), framed(&head).repeat(1 + copies), vec![1, 3, 0, 0, 0, 1]].concat();
            if let Some((at, bits)) = damage {
                let at = at % line.len();
                line[at] ^= bits;
            }
            let expected = ExpectedExchange::announced_by(&functions, Mode::Rtu, &line).filter(ExpectedExchange::is_write);
            let write = PlainWrite::at(&functions, &line);
            let announced = expected.map(|expected| PlainWrite {
                lengths: expected.rtu_lengths(),
                is_mirrored: expected.echoes_request,
                address: expected.address,
                quantity: expected.quantity,
            });
            prop_assert_eq!(write, announced);
            let Some((write, expected)) = write.zip(expected) else { return Ok(()) };
            let [request, response] = write.lengths;
            let is_answered = line.len() >= request + response && {
                let (asked, answer) = line.split_at(request);
                ExpectedExchange::from_request(&functions, Mode::Rtu, &line).is_some()
                    && expected.is_answered_by(asked, answer) && crc_valid_at(asked, request) && crc_valid_at(answer, response)
                    && (!write.is_mirrored || is_followed_by_copy(answer, request) == Some(false))
            };
            prop_assert_eq!(write.is_answered(&functions, &line), is_answered);
        }
    }
}
