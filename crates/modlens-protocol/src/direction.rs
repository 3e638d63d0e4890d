//! Direction by evidence: whether layout and outstanding request speak for a PDU as a request or as a response.

use crate::functions::{FunctionRow, Functions, Layout, EXCEPTION_BIT};
use crate::pdu::u16_at;

pub use crate::framing::Direction;

/// A request that may be answered.
#[derive(Clone, Copy, Debug)]
pub struct RequestRef<'a> {
    /// The unit that it is addressed to.
    pub unit: u8,
    /// Its PDU.
    pub pdu: &'a [u8],
}

/// How well a PDU fits a request as its response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ResponseMatch {
    /// Another unit or function, or no response at all.
    No,
    /// Unit and function agree, but not what was requested.
    Partly,
    /// Unit, function, length and echoed fields agree.
    Fully,
}

/// How well `pdu` of `unit` fits the request as its response.
pub fn match_response(functions: &Functions, asked: RequestRef<'_>, unit: u8, pdu: &[u8]) -> ResponseMatch {
    let (Some(&wanted), Some(&code)) = (asked.pdu.first(), pdu.first()) else { return ResponseMatch::No };
    if unit != asked.unit || code & !EXCEPTION_BIT != wanted {
        return ResponseMatch::No;
    }
    if code & EXCEPTION_BIT != 0 {
        return if pdu.len() == 2 { ResponseMatch::Fully } else { ResponseMatch::No };
    }
    let Some(row) = functions.row(code, &asked.pdu[1..]) else { return ResponseMatch::Fully };
    if row.response == Layout::NoResponse {
        // The unit should not have responded; if it does, it is to this request.
        return ResponseMatch::Partly;
    }
    if !row.response.fits(&pdu[1..]) {
        return if counts_registers(row, asked.pdu, pdu) { ResponseMatch::Partly } else { ResponseMatch::No };
    }
    if row.response.shape().is_some_and(|shape| !shape.groups_fit(&pdu[1..])) {
        return ResponseMatch::Partly;
    }
    let length_ok = expected_data_bytes(row, asked.pdu).is_none_or(|expected| data_bytes(row, pdu) == Some(expected));
    if length_ok && echoes(row, asked.pdu, pdu) {
        ResponseMatch::Fully
    } else {
        ResponseMatch::Partly
    }
}

/// The bytes of registers or bits that the response to this request has to have; `None` if the request does not say.
pub fn expected_data_bytes(row: &FunctionRow, request: &[u8]) -> Option<usize> {
    let (_, bits) = row.offsets.response_block?;
    let quantity = usize::from(u16_at(&request[1..], row.offsets.quantity?)?);
    Some(if bits { quantity.div_ceil(8) } else { 2 * quantity })
}

/// The bytes of registers or bits that this response has.
pub fn data_bytes(row: &FunctionRow, response: &[u8]) -> Option<usize> {
    let (at, _) = row.offsets.response_block?;
    response.len().checked_sub(1 + at)
}

/// Whether a response to this request has the registers asked for, but counts these in place of their bytes, as some units do.
pub fn counts_registers(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    let Some((at, false)) = row.offsets.response_block else { return false };
    let expected = expected_data_bytes(row, request);
    expected.is_some()
        && data_bytes(row, response) == expected
        && response.get(at).map(|&count| 2 * usize::from(count)) == expected
}

/// The fields that the response should repeat and does not: (name, value in the request, value in the response).
pub fn echo_differences<'a>(
    row: &'a FunctionRow,
    request: &'a [u8],
    response: &'a [u8],
) -> impl Iterator<Item = (&'a str, u32, u32)> + 'a {
    row.echoes.iter().filter_map(move |echo| {
        let value = |pdu: &[u8], at: usize| pdu.get(1 + at..1 + at + echo.width).map(crate::pdu::big_endian);
        let (asked, answered) = value(request, echo.request_offset).zip(value(response, echo.response_offset))?;
        (asked != answered).then_some((echo.name.as_str(), asked, answered))
    })
}

/// Whether the response should repeat the address of its request and has another one.
pub fn repeats_other_address(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    row.echoes.first().is_some_and(|echo| {
        let is_other = |(name, _, _): (&str, u32, u32)| name == echo.name;
        echo.name == "address" && echo_differences(row, request, response).next().is_some_and(is_other)
    })
}

fn echoes(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    row.echo.is_empty() || (echo_differences(row, request, response).next().is_none() && same_echo_tail(row, request, response))
}

/// Whether a list that is repeated as a whole agrees (sub-function 0 of diagnostics, file records). It follows all numbers.
fn same_echo_tail(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    let last = row.request.shape().and_then(|shape| shape.fields.last());
    let whole = last.is_some_and(|field| field.field_type.width() == 0 && row.echo.contains(&field.name));
    !whole || request == response
}

/// The directions that the layout alone admits: (as a request, as a response).
pub fn possible_directions(functions: &Functions, pdu: &[u8]) -> (bool, bool) {
    let Some((&code, body)) = pdu.split_first() else { return (false, false) };
    if code & EXCEPTION_BIT != 0 {
        return (false, body.len() == 1);
    }
    match functions.row(code, body) {
        Some(row) => {
            let groups = |layout: &Layout| layout.shape().is_none_or(|shape| shape.groups_fit(body));
            let request = row.request.fits(body) && counts_agree(row, body) && groups(&row.request);
            (request, row.response.fits(body) && groups(&row.response))
        }
        None => (true, true),
    }
}

/// Whether quantity and number of data bytes of a write request agree.
pub fn counts_agree(row: &FunctionRow, body: &[u8]) -> bool {
    let Some((at, bits)) = row.offsets.request_block else { return true };
    let quantity = row.offsets.write_quantity.or(row.offsets.quantity).and_then(|at| u16_at(body, at));
    let Some(quantity) = quantity.map(usize::from) else { return true };
    body.len().checked_sub(at) == Some(if bits { quantity.div_ceil(8) } else { 2 * quantity })
}

/// Whether the specification permits the numbers of this PDU, read as a request.
fn permitted_as_request(functions: &Functions, pdu: &[u8]) -> bool {
    let row = functions.row(pdu[0], &pdu[1..]);
    row.is_none_or(|row| row.field_limits[0].iter().all(|permit| permit.violated_by(&pdu[1..]).is_none()))
}

/// Log-odds in bits of a silence: by how much it fits this master's timeout better than the response times of this bus. 0
/// without a clock.
///
/// It distinguishes a retry from a response that equals its request.
pub type TimeoutLogOdds = f32;

/// Infers who sent a PDU from the outstanding request, the layout, what the recording declares, and the silence before it.
///
/// The outstanding request decides first. Without one, a layout that only one direction has decides; then what the recording
/// declares; then the more common case, that the PDU is a request.
pub fn infer_direction(
    functions: &Functions,
    outstanding: Option<RequestRef<'_>>,
    unit: u8,
    pdu: &[u8],
    declared: Option<Direction>,
    pause: TimeoutLogOdds,
) -> Direction {
    let (may_be_request, may_be_response) = possible_directions(functions, pdu);
    let matched = outstanding.map_or(ResponseMatch::No, |request| match_response(functions, request, unit, pdu));
    if matched == ResponseMatch::Fully {
        let equals_request = may_be_request && outstanding.is_some_and(|request| request.pdu == pdu);
        if equals_request && (pause > 0.0 || declared == Some(Direction::Request)) {
            return Direction::Request;
        }
        return Direction::Response;
    }
    match (may_be_request, may_be_response) {
        (true, false) => Direction::Request,
        (false, true) => Direction::Response,
        (false, false) if matched == ResponseMatch::Partly => Direction::Response,
        (false, false) => declared.unwrap_or(Direction::Unknown),
        (true, true) => {
            // A response that repeats the address but not the value is more likely than a new request for the same place; the
            // same request again is none.
            let repeats_address = |request: RequestRef<'_>| request.pdu.get(1..3) == pdu.get(1..3) && request.pdu != pdu;
            let repeats_address = matched == ResponseMatch::Partly && outstanding.is_some_and(repeats_address);
            if repeats_address && pause <= 0.0 {
                return declared.unwrap_or(Direction::Response);
            }
            let is_permitted = permitted_as_request(functions, pdu);
            declared.unwrap_or(if is_permitted { Direction::Request } else { Direction::Response })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hex::parse_hex;

    fn inferred(outstanding: Option<&str>, pdu: &str) -> Direction {
        let outstanding = outstanding.map(|text| parse_hex(text).unwrap());
        let outstanding = outstanding.as_deref().map(|pdu| RequestRef { unit: 1, pdu });
        infer_direction(Functions::embedded(), outstanding, 1, &parse_hex(pdu).unwrap(), None, 0.0)
    }

    #[test]
    fn layout_decides_where_it_can() {
        assert_eq!(inferred(None, "03 006B 0003"), Direction::Request);
        assert_eq!(inferred(None, "03 06 022B 0000 0064"), Direction::Response);
        assert_eq!(inferred(None, "83 02"), Direction::Response);
        assert_eq!(inferred(None, "0F 0131 0002"), Direction::Response);
    }

    #[test]
    fn the_outstanding_request_decides_between_look_alikes() {
        assert_eq!(inferred(None, "06 0001 0003"), Direction::Request);
        assert_eq!(inferred(Some("06 0001 0003"), "06 0001 0003"), Direction::Response);
        assert_eq!(inferred(Some("06 0001 0003"), "06 0001 0002"), Direction::Response);
        assert_eq!(inferred(Some("06 0001 0003"), "06 0002 0003"), Direction::Request);
        // Eight bytes of function 1: a request, or 24 coils.
        assert_eq!(inferred(Some("01 0000 0018"), "01 03 00 00 01"), Direction::Response);
        assert_eq!(inferred(None, "01 03 00 00 01"), Direction::Request);
        // 56 117 inputs cannot be asked for: three bytes of inputs (seed document 000).
        assert_eq!(inferred(None, "02 03 AC DB 35"), Direction::Response);
    }

    #[test]
    fn a_request_does_not_answer_another() {
        assert_eq!(inferred(Some("03 0000 0001"), "03 0000 0001"), Direction::Request);
        assert_eq!(inferred(Some("10 0000 0001 02 0001"), "10 0000 0001 02 0001"), Direction::Request);
        // The request for four registers from 0x033C on, again: three bytes are no answer to it.
        assert_eq!(inferred(Some("03 033C 0004"), "03 033C 0004"), Direction::Request);
    }
}
