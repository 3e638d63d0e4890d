//! The MBAP header of Modbus/TCP (messaging on TCP/IP, 3.1.3).

use crate::direction::possible_directions;
use crate::functions::{Extent, Functions, EXCEPTION_BIT};

/// Transaction identifier, protocol identifier and length: the header in front of the unit, which counts in the length.
pub const PREFIX_BYTES: usize = 6;

/// The largest value of the length field: the unit and a PDU of 253 bytes.
pub const MAX_LENGTH_FIELD: usize = 254;

/// The transaction identifier of a header.
pub fn transaction_id([high, low, ..]: &[u8; PREFIX_BYTES]) -> u16 {
    u16::from_be_bytes([*high, *low])
}

/// The length of the whole frame that the header at the start of `bytes` announces; `None` if it is no header.
pub fn announced_length(bytes: &[u8]) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([*bytes.get(4)?, *bytes.get(5)?]));
    // Unit and function code at least.
    (bytes[2..4] == [0, 0] && (2..=MAX_LENGTH_FIELD).contains(&length)).then_some(PREFIX_BYTES + length)
}

/// Whether the layout of its function admits a PDU of this length in either direction.
pub fn layout_fits(functions: &Functions, pdu: &[u8]) -> bool {
    let (request, response) = possible_directions(functions, pdu);
    request || response
}

/// The lengths of the whole frame by the layout of its function, whatever the header announces: as a request and as a response.
pub fn layout_lengths(functions: &Functions, bytes: &[u8]) -> [Option<usize>; 2] {
    let Some((&code, body)) = bytes.get(PREFIX_BYTES + 1..).and_then(<[u8]>::split_first) else { return [None, None] };
    if code & EXCEPTION_BIT != 0 {
        return [None, Some(PREFIX_BYTES + 3)];
    }
    let Some(row) = functions.row(code, body) else { return [None, None] };
    [&row.request, &row.response].map(|layout| match layout.extent(body) {
        Extent::Exactly(length) => Some(PREFIX_BYTES + 2 + length),
        _ => None,
    })
}
