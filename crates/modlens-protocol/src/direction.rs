//! Direction by evidence: which of the two readings of a PDU the layout and the pending request support.

use crate::functions::{FunctionRow, Functions, Layout, EXCEPTION_BIT};
use crate::pdu::u16_at;

pub use crate::framing::Direction;

/// The request that waits for its answer, as far as direction needs it.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a> {
    /// Unit asked.
    pub unit: u8,
    /// Its PDU.
    pub pdu: &'a [u8],
}

/// How well a PDU answers a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Match {
    /// Another unit or function, or no response at all.
    No,
    /// Right unit and function, but not what was asked for.
    Partly,
    /// Unit, function, length and echoed fields agree.
    Fully,
}

/// How well `pdu` of `unit` answers the request.
pub fn answers(functions: &Functions, asked: Asked<'_>, unit: u8, pdu: &[u8]) -> Match {
    let (Some(&wanted), Some(&code)) = (asked.pdu.first(), pdu.first()) else { return Match::No };
    if unit != asked.unit || code & !EXCEPTION_BIT != wanted {
        return Match::No;
    }
    if code & EXCEPTION_BIT != 0 {
        return if pdu.len() == 2 { Match::Fully } else { Match::No };
    }
    let Some(row) = functions.row(code, &asked.pdu[1..]) else { return Match::Fully };
    if row.response == Layout::NoResponse {
        // It should not have answered; if it does, it is this.
        return Match::Partly;
    }
    if !row.response.fits(&pdu[1..]) {
        return Match::No;
    }
    if row.response.shape().is_some_and(|shape| !shape.groups_fit(&pdu[1..])) {
        return Match::Partly;
    }
    let length_ok = expected_block(row, asked.pdu).is_none_or(|expected| block_length(row, pdu) == Some(expected));
    if length_ok && echoes(row, asked.pdu, pdu) {
        Match::Fully
    } else {
        Match::Partly
    }
}

/// Bytes of registers or bits that the answer to this request holds.
pub fn expected_block(row: &FunctionRow, request: &[u8]) -> Option<usize> {
    let (_, bits) = row.offsets.response_block?;
    let quantity = usize::from(u16_at(&request[1..], row.offsets.quantity?)?);
    Some(if bits { quantity.div_ceil(8) } else { 2 * quantity })
}

/// Bytes of registers or bits that this response holds.
pub fn block_length(row: &FunctionRow, response: &[u8]) -> Option<usize> {
    let (at, _) = row.offsets.response_block?;
    response.len().checked_sub(1 + at)
}

/// The echoed fields that differ: (name, in the request, in the response).
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

fn echoes(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    row.echo.is_empty() || (echo_differences(row, request, response).next().is_none() && same_echo_tail(row, request, response))
}

/// Lists that are echoed whole (sub-function 0 of diagnostics, file records) stand behind all numbers.
fn same_echo_tail(row: &FunctionRow, request: &[u8], response: &[u8]) -> bool {
    let last = row.request.shape().and_then(|shape| shape.fields.last());
    let whole = last.is_some_and(|field| field.field_type.width() == 0 && row.echo.contains(&field.name));
    !whole || request == response
}

/// Which readings the layout alone admits: (as a request, as a response).
pub fn readings(functions: &Functions, pdu: &[u8]) -> (bool, bool) {
    let Some((&code, body)) = pdu.split_first() else { return (false, false) };
    if code & EXCEPTION_BIT != 0 {
        return (false, body.len() == 1);
    }
    match functions.row(code, body) {
        Some(row) => {
            let groups = |layout: &Layout| layout.shape().is_none_or(|shape| shape.groups_fit(body));
            let request = row.request.fits(body) && consistent(row, body) && groups(&row.request);
            (request, row.response.fits(body) && groups(&row.response))
        }
        None => (true, true),
    }
}

/// Whether quantity and byte count of a write request agree.
pub fn consistent(row: &FunctionRow, body: &[u8]) -> bool {
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

/// Bits by which a silence fits this master's time-out better than this bus's answers; 0 without a clock.
///
/// It tells a retry from an echoed answer.
pub type Pause = f32;

/// Who sent this PDU?
///
/// The pending request decides; without one, a reading that only one side admits; then what the recording says; then
/// the more common case: a master asks first.
pub fn judge(
    functions: &Functions,
    asked: Option<Asked<'_>>,
    unit: u8,
    pdu: &[u8],
    said: Option<Direction>,
    pause: Pause,
) -> Direction {
    let (request, response) = readings(functions, pdu);
    let matched = asked.map_or(Match::No, |asked| answers(functions, asked, unit, pdu));
    if matched == Match::Fully {
        let identical = request && asked.is_some_and(|asked| asked.pdu == pdu);
        if identical && (pause > 0.0 || said == Some(Direction::Request)) {
            return Direction::Request;
        }
        return Direction::Response;
    }
    match (request, response) {
        (true, false) => Direction::Request,
        (false, true) => Direction::Response,
        (false, false) if matched == Match::Partly => Direction::Response,
        (false, false) => said.unwrap_or(Direction::Unknown),
        (true, true) => {
            // An answer that repeats the address but not the value is more likely than a new request for the same place.
            let same_place = matched == Match::Partly && asked.is_some_and(|asked| asked.pdu.get(1..3) == pdu.get(1..3));
            if same_place && pause <= 0.0 {
                return said.unwrap_or(Direction::Response);
            }
            said.unwrap_or(if permitted_as_request(functions, pdu) { Direction::Request } else { Direction::Response })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hex::parse_hex;

    fn judged(asked: Option<&str>, pdu: &str) -> Direction {
        let asked = asked.map(|text| parse_hex(text).unwrap());
        let asked = asked.as_deref().map(|pdu| Asked { unit: 1, pdu });
        judge(Functions::embedded(), asked, 1, &parse_hex(pdu).unwrap(), None, 0.0)
    }

    #[test]
    fn layout_decides_where_it_can() {
        assert_eq!(judged(None, "03 006B 0003"), Direction::Request);
        assert_eq!(judged(None, "03 06 022B 0000 0064"), Direction::Response);
        assert_eq!(judged(None, "83 02"), Direction::Response);
        assert_eq!(judged(None, "0F 0131 0002"), Direction::Response);
    }

    #[test]
    fn the_pending_request_decides_look_alikes() {
        assert_eq!(judged(None, "06 0001 0003"), Direction::Request);
        assert_eq!(judged(Some("06 0001 0003"), "06 0001 0003"), Direction::Response);
        assert_eq!(judged(Some("06 0001 0003"), "06 0001 0002"), Direction::Response);
        assert_eq!(judged(Some("06 0001 0003"), "06 0002 0003"), Direction::Request);
        // Eight bytes of function 1: a request, or 24 coils.
        assert_eq!(judged(Some("01 0000 0018"), "01 03 00 00 01"), Direction::Response);
        assert_eq!(judged(None, "01 03 00 00 01"), Direction::Request);
        // 56 117 inputs cannot be asked for: three bytes of inputs (seed document 000).
        assert_eq!(judged(None, "02 03 AC DB 35"), Direction::Response);
    }

    #[test]
    fn a_request_does_not_answer_another() {
        assert_eq!(judged(Some("03 0000 0001"), "03 0000 0001"), Direction::Request);
        assert_eq!(judged(Some("10 0000 0001 02 0001"), "10 0000 0001 02 0001"), Direction::Request);
    }
}
