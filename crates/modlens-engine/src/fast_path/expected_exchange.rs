//! A plain read or write request, or both in one, and what its response has to look like.
//!
//! Example: the request `11 03 00 6B 00 03` (read three registers) determines a response of nine bytes that begins with
//! `11 03 06`, and the request `11 05 00 AC FF 00` (write one coil) is its own response. If the bytes after a request are
//! not that response, the fast path leaves both to the framer and to pairing.

use std::ops::RangeInclusive;

use crate::findings::frame::is_plain_request;
use crate::records::Exchange;
use crate::stats::RequestKey;
use modlens_profiles::points::sunspec::{marker, may_begin_in};
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, StandardLayout, EXCEPTION_BIT};

/// Unit addresses on a serial line that cause no finding (serial line specification, 2.2).
const RTU_UNITS: RangeInclusive<u8> = 1..=247;

/// Bytes of unit, function, address, and quantity or value (application protocol, 6.1 to 6.6).
const SHORT_REQUEST_BYTES: usize = 6;

/// Bytes of unit, function and byte count in front of the data of a read response.
const READ_HEADER_BYTES: usize = 3;

/// Bytes in front of the data of a request that writes several values: as above, and a byte count (6.11, 6.12).
const WRITE_HEADER_BYTES: usize = SHORT_REQUEST_BYTES + 1;

/// Bytes in front of the data of a request that reads registers and writes others: as a short one, then address, quantity and
/// byte count of what is written (6.17).
const READ_WRITE_HEADER_BYTES: usize = SHORT_REQUEST_BYTES + 5;

/// Unit, function code and exception code (7).
const REFUSAL_BYTES: usize = 3;

/// What the response has to look like.
#[derive(Clone, Copy, Debug)]
enum Response {
    /// A byte count and as many bytes; the bits of `padding` in the last byte were not asked for and have to be 0.
    Block { count: u8, padding: u8 },
    /// The first six bytes of the request.
    Echo,
}

/// An exchange as its request announces it. Lengths are those of unit and PDU, without checksum and MBAP header.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedExchange {
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub code: u8,
    /// Whether it reads or writes, and what.
    pub kind: StandardLayout,
    /// Address of the first register or bit; that of what is read, if both is done.
    pub address: u16,
    /// Number of these registers or bits.
    pub quantity: u16,
    /// Length of the request in bytes.
    pub request_bytes: usize,
    /// Length of the response in bytes.
    pub response_bytes: usize,
    /// The response has the same bytes as the request.
    pub echoes_request: bool,
    /// The request has the length and the first bytes that the response to another request of its kind would have, so that
    /// it may be the previous response again. Example: reading coils from 0x0300 on begins like three bytes of coils. Of
    /// registers there is no such response, since they have two bytes each; on an ASCII line it is set for registers anyway.
    pub resembles_response: bool,
    /// A self-describing register map (`points::sunspec`) may begin in the registers that are read: the response shows.
    may_hold_map: bool,
    response: Response,
}

impl ExpectedExchange {
    /// Returns the exchange that the request at the head of these bytes announces, if the slow path would have nothing to report
    /// on the request. The bytes begin with the unit and may go on after the request; checksums are left to the caller.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The result is large, and the caller takes it apart at once.
    pub fn from_request(functions: &Functions, mode: Mode, bytes: &[u8]) -> Option<Self> {
        let expected = Self::announced_by(functions, mode, bytes)?;
        let reads_registers = matches!(expected.kind, StandardLayout::ReadRegisters | StandardLayout::ReadWriteRegisters);
        let may_hold_map = reads_registers && may_begin_in(expected.address, usize::from(expected.quantity));
        let is_plain = is_plain_request(functions, mode, bytes.get(..expected.request_bytes)?);
        is_plain.then_some(Self { may_hold_map, ..expected })
    }

    /// Returns the exchange that a request announces by its layout alone; of a write, the data need not have come.
    ///
    /// `None` if the bytes are too few for a header or no plain read or write, if the unit cannot answer on a serial line, or if
    /// the byte count of a write is wrong. On a serial line, a read of bits from an address 0x03xx on has the length of a response
    /// with three bytes: `None` if it asks for three bytes, since it could be its own response, else `resembles_response` is set
    /// and the caller decides.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub(crate) fn announced_by(functions: &Functions, mode: Mode, bytes: &[u8]) -> Option<Self> {
        let request: &[u8; SHORT_REQUEST_BYTES] = bytes.first_chunk()?;
        let [unit, code, ..] = *request;
        let standard = functions.standard_request(code).filter(|_| mode == Mode::Tcp || RTU_UNITS.contains(&unit))?;
        let (address, number) = (u16_at(*request, 2), u16_at(*request, 4));
        let echoed = Self {
            unit,
            code,
            kind: standard.kind,
            address,
            quantity: number,
            request_bytes: SHORT_REQUEST_BYTES,
            response_bytes: SHORT_REQUEST_BYTES,
            echoes_request: standard.has_equal_layouts,
            resembles_response: false,
            may_hold_map: false,
            response: Response::Echo,
        };
        let (bit_bytes, register_bytes) = (usize::from(number.div_ceil(8)), 2 * usize::from(number));
        match standard.kind {
            StandardLayout::ReadBits => echoed.as_read(mode, bit_bytes, padding_bits(number)),
            StandardLayout::ReadRegisters => echoed.as_read(mode, register_bytes, 0),
            StandardLayout::WriteBits => echoed.as_write_of(bit_bytes, bytes),
            StandardLayout::WriteRegisters => echoed.as_write_of(register_bytes, bytes),
            StandardLayout::WriteOne => Some(Self { quantity: 1, ..echoed }),
            StandardLayout::ReadWriteRegisters => echoed.as_read_write(mode, bytes),
        }
    }

    /// Returns the same as a read of `count` bytes of data, of which the last one has these padding bits; `None` if a byte count
    /// cannot say that many, or if the request could be its own response.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn as_read(self, mode: Mode, count: usize, padding: u8) -> Option<Self> {
        // The high byte of the address is where a response has its byte count, which is 3 in a response of this length.
        let [in_place_of_count, _] = self.address.to_be_bytes();
        let may_be_odd = self.kind == StandardLayout::ReadBits || mode == Mode::Ascii;
        let has_length_of_response = may_be_odd && usize::from(in_place_of_count) + READ_HEADER_BYTES == SHORT_REQUEST_BYTES;
        let resembles_response = mode != Mode::Tcp && has_length_of_response;
        let count = u8::try_from(count).ok().filter(|&count| !resembles_response || count != in_place_of_count)?;
        let response_bytes = READ_HEADER_BYTES + usize::from(count);
        let response = Response::Block { count, padding };
        Some(Self { response_bytes, echoes_request: false, resembles_response, response, ..self })
    }

    /// Returns the same as a write of `count` bytes of data; `None` unless the byte count of the request, which begins with these
    /// bytes, is there and says as many.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn as_write_of(self, count: usize, request: &[u8]) -> Option<Self> {
        let announced = request.get(SHORT_REQUEST_BYTES).copied().map(usize::from);
        (announced == Some(count)).then_some(Self { request_bytes: WRITE_HEADER_BYTES + count, ..self })
    }

    /// Returns the same as a read of registers with a write of others, which begins with these bytes. `None` unless quantity and
    /// byte count of what is written are there and agree. On a serial line `None`, too, if the byte at index 2, read as
    /// the byte count of a response, announces this length, give or take one (checksums may end in 00): the search weighs that.
    #[inline(never)]
    fn as_read_write(self, mode: Mode, request: &[u8]) -> Option<Self> {
        let header: &[u8; READ_WRITE_HEADER_BYTES] = request.first_chunk()?;
        let [.., high, low, count] = *header;
        let request_bytes = READ_WRITE_HEADER_BYTES + usize::from(count);
        let as_response = READ_HEADER_BYTES + usize::from(header[2]);
        let resembles_response = mode != Mode::Tcp && as_response.abs_diff(request_bytes) <= 1;
        let is_consistent = usize::from(count) == 2 * usize::from(u16::from_be_bytes([high, low]));
        let count = u8::try_from(2 * u32::from(self.quantity)).ok().filter(|_| is_consistent && !resembles_response)?;
        let (response_bytes, response) = (READ_HEADER_BYTES + usize::from(count), Response::Block { count, padding: 0 });
        Some(Self { request_bytes, response_bytes, echoes_request: false, response, ..self })
    }

    /// Returns the same as the unit refuses it: with an exception in place of the response.
    #[must_use]
    pub fn refused(self) -> Self {
        Self { response_bytes: REFUSAL_BYTES, ..self }
    }

    /// Returns the exception code with which this response refuses the request; `None` if it does not, or if there is no place for
    /// that exception in a compact exchange.
    pub fn refused_by(&self, response: &[u8]) -> Option<u8> {
        let [unit, code, exception]: [u8; REFUSAL_BYTES] = *response.first_chunk()?;
        let is_refusal = [unit, code] == [self.unit, self.code | EXCEPTION_BIT] && Exchange::has_place_for(exception);
        is_refusal.then_some(exception)
    }

    /// Returns whether this response is the expected one, and no self-describing register map begins in it, which the slow path
    /// follows. Both slices must have at least the expected lengths.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Asked of every exchange.
    pub fn is_answered_by(&self, request: &[u8], response: &[u8]) -> bool {
        match self.response {
            Response::Block { count, padding } => {
                let has_header = response[..READ_HEADER_BYTES] == [self.unit, self.code, count];
                has_header
                    && response[self.response_bytes - 1] & padding == 0
                    && !(self.may_hold_map && marker(self.address, &response[READ_HEADER_BYTES..self.response_bytes]).is_some())
            }
            Response::Echo => response[..SHORT_REQUEST_BYTES] == request[..SHORT_REQUEST_BYTES],
        }
    }

    /// Bytes of the request and of the response on an RTU line: with their checksums.
    #[inline]
    pub fn rtu_lengths(&self) -> [usize; 2] {
        [self.request_bytes, self.response_bytes].map(|length| length + CRC_BYTES)
    }

    /// What the statistics know its request by.
    #[inline]
    pub(crate) fn key(&self) -> RequestKey {
        RequestKey::plain(self.unit, self.code, self.address, self.quantity)
    }

    /// Returns the compact exchange, whose bytes, of these lengths, begin at `start` in the arena; with the exception code if it
    /// was refused, else 0.
    #[inline]
    pub(crate) fn compact(&self, start: u32, lengths: [usize; 2], confidence: u8, exception: u8) -> Exchange {
        Exchange {
            start,
            lengths: lengths.map(|length| length as u16),
            address: self.address,
            quantity: self.quantity,
            unit: self.unit,
            function: self.code,
            confidence,
            exception,
        }
    }

    /// Returns the data of a read response: what follows the byte count.
    pub fn read_data<'a>(&self, response: &'a [u8]) -> Option<&'a [u8]> {
        matches!(self.response, Response::Block { .. }).then(|| &response[READ_HEADER_BYTES..])
    }
}

/// Returns the big-endian number at this index of a request.
#[inline]
fn u16_at(request: [u8; SHORT_REQUEST_BYTES], index: usize) -> u16 {
    u16::from_be_bytes([request[index], request[index + 1]])
}

/// Returns the bits of the last byte of a response that lie beyond the quantity asked for, as a mask.
fn padding_bits(quantity: u16) -> u8 {
    match quantity % 8 {
        0 => 0,
        rest => 0xFF << rest,
    }
}
