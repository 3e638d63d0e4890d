//! The MBAP header of Modbus/TCP (messaging on TCP/IP, 3.1.3).

use crate::direction::readings;
use crate::functions::{Extent, Functions, EXCEPTION_BIT};

/// Transaction, protocol, length; the unit counts in the length.
pub const HEADER: usize = 6;

/// The longest that a length field can say.
pub const LONGEST: usize = 254;

/// The whole length that the header at the start of `bytes` announces, if it is one.
pub fn announced(bytes: &[u8]) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([*bytes.get(4)?, *bytes.get(5)?]));
    // Unit and function code at least; 253 bytes of PDU at most.
    (bytes[2..4] == [0, 0] && (2..=LONGEST).contains(&length)).then_some(HEADER + length)
}

/// Whether a PDU of this length can be one in either direction.
pub fn layout_fits(functions: &Functions, pdu: &[u8]) -> bool {
    let (request, response) = readings(functions, pdu);
    request || response
}

/// The whole lengths that a frame which begins like this has by its layout, read as a request and as a response.
pub fn natural(functions: &Functions, bytes: &[u8]) -> [Option<usize>; 2] {
    let Some((&code, body)) = bytes.get(HEADER + 1..).and_then(<[u8]>::split_first) else { return [None, None] };
    if code & EXCEPTION_BIT != 0 {
        return [None, Some(HEADER + 3)];
    }
    let Some(row) = functions.row(code, body) else { return [None, None] };
    [&row.request, &row.response].map(|layout| match layout.extent(body) {
        Extent::Exactly(length) => Some(HEADER + 2 + length),
        _ => None,
    })
}
