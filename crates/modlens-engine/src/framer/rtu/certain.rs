//! Frames that need no search: the answer to the request that waits, or a request in the way of this line, of the length
//! that its header announces, with a right checksum. Nearly all traffic is such, so this is what speed depends on.

use crate::framer::rtu::gain::REQUEST;
use crate::framer::rtu::pending::Request;
use crate::framer::rtu::search::Search;
use crate::framer::rtu::{AROUND, LONGEST};
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::checksum::crc_valid_at;
use modlens_protocol::direction::expected_block;
use modlens_protocol::framing::RTU_LIMIT;
use modlens_protocol::functions::{Extent, Row, EXCEPTION_BIT};

/// Unit, function code and the first byte of the body.
const HEADER: usize = 3;

/// Unit, function code, exception code and checksum.
const REFUSAL: usize = 5;

/// Fewer bytes than any frame has.
const MOST_STRAYS: usize = 3;

/// Requests of a poll cycle are short; nobody has to wait long for the rest of one.
const MOST_POLL: usize = 16;

/// A silence that is so much more like an answer than like a time-out, in bits.
pub(super) const SURELY_AN_ANSWER: f32 = -10.0;

/// What a look at the next header says.
pub enum Certain {
    /// A frame: the answer to the request that waits, or a request.
    Frame(Length),
    /// More bytes are needed to tell.
    Wait,
    /// There is doubt.
    No,
}

/// How many of the first bytes are a frame, if their checksum is right, whether their header announces just so many, and
/// whether they are a request.
///
/// In one number: it goes from function to function for every frame.
#[derive(Clone, Copy)]
pub struct Length(u32);

impl Length {
    const EXACT: u32 = 1;
    const REQUEST: u32 = 2;

    /// Just so many.
    pub fn exactly(length: usize) -> Self {
        Self((length as u32) << 2 | Self::EXACT)
    }

    fn at_least(length: usize) -> Self {
        Self((length as u32) << 2)
    }

    fn as_request(self) -> Self {
        Self(self.0 | Self::REQUEST)
    }

    /// What an extent of the body says of the frame.
    fn of(extent: Extent) -> Option<Self> {
        match extent {
            Extent::Exactly(length) => Some(Self::exactly(length + AROUND)),
            Extent::AtLeast(length) => Some(Self::at_least(length + AROUND)),
            Extent::Open(_) => None,
        }
    }

    /// So many bytes.
    pub fn bytes(self) -> usize {
        (self.0 >> 2) as usize
    }

    /// Whether they are a request.
    pub fn request(self) -> bool {
        self.0 & Self::REQUEST != 0
    }

    /// Whether the header announces just so many.
    pub fn exact(self) -> bool {
        self.0 & Self::EXACT != 0
    }
}

/// What the first bytes are, if that is beyond doubt.
#[inline]
pub fn certain(search: &Search, input: &Input, context: &Context<'_>) -> Certain {
    certain_at(search, input, context, 0)
}

/// The same behind a few strays: how many of them, and the frame behind them.
///
/// Drivers that are switched leave one to three bytes behind, fewer than the shortest frame has. Where no frame has begun
/// with one of them, there is nothing to be weighed.
pub fn behind_strays(search: &Search, input: &Input, context: &Context<'_>) -> (usize, Certain) {
    for strays in 1..=MOST_STRAYS {
        match certain_at(search, input, context, strays) {
            Certain::No => {}
            Certain::Wait => return (strays, Certain::Wait),
            Certain::Frame(length) => {
                let frame = &input.bytes()[strays..strays + length.bytes()];
                if length.request() && !asks(frame, context) {
                    break;
                }
                return match search.begins_before(input, context, strays, length.bytes()) {
                    Certain::No => (strays, Certain::Frame(length)),
                    Certain::Wait => (strays, Certain::Wait),
                    Certain::Frame(_) => break,
                };
            }
        }
    }
    (0, Certain::No)
}

/// Whether a frame that looks like a request asks for what may be asked for; else it is rather an answer whose request
/// was lost, and the zeros behind it, over which a right checksum stays right.
fn asks(frame: &[u8], context: &Context<'_>) -> bool {
    let body = &frame[2..frame.len() - 2];
    let row = context.functions.row(frame[1], body);
    let permitted = row.is_some_and(|row| row.permits[REQUEST].iter().all(|permit| permit.violated_by(body).is_none()));
    permitted && frame[frame.len() - 1] != 0
}

#[inline]
fn certain_at(search: &Search, input: &Input, context: &Context<'_>, at: usize) -> Certain {
    let bytes = input.bytes().get(at..).unwrap_or(&[]);
    if bytes.len() < HEADER && !input.closed {
        return Certain::Wait;
    }
    let Some(length) = expected(search, input, context, at) else { return Certain::No };
    let all = length.bytes();
    if bytes.len() < all {
        return if input.closed { Certain::No } else { Certain::Wait };
    }
    let whole = crc_valid_at(bytes, all) && input.edge_after(0, at + all - 1, input.break_ns).is_none();
    if whole {
        Certain::Frame(length)
    } else {
        Certain::No
    }
}

#[inline]
fn expected(search: &Search, input: &Input, context: &Context<'_>, at: usize) -> Option<Length> {
    let bytes = input.bytes().get(at..)?;
    let (&unit, &code) = (bytes.first()?, bytes.get(1)?);
    let ask = code & EXCEPTION_BIT == 0 && search.model.familiar(unit, code, REQUEST);
    match search.asked() {
        Some(asked) if asked.is_of(unit, code & !EXCEPTION_BIT) => match asked.answer {
            Some((count, length)) if code == asked.pdu[0] && bytes.get(2) == Some(&count) => Some(Length::exactly(length)),
            _ => response(asked, input, context, at),
        },
        // Nobody answered, and the master goes on with its cycle.
        Some(asked) if ask && at == 0 && asked.unit != unit => {
            let length = request(search, bytes, context).filter(|length| length.bytes() <= MOST_POLL)?;
            let other = |frame: &[u8]| !(asks(frame, context) && search.model.polls.knows(frame));
            Some(length).filter(|length| !bytes.get(..length.bytes()).is_some_and(other))
        }
        None if ask => request(search, bytes, context),
        _ => None,
    }
}

fn response(asked: &Request, input: &Input, context: &Context<'_>, at: usize) -> Option<Length> {
    let bytes = &input.bytes()[at..];
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        return Some(Length::exactly(REFUSAL)).filter(|_| bytes.get(2).is_some_and(|&exception| exception != 0));
    }
    let row = context.functions.row(code, &asked.pdu[1..])?;
    let length = Length::of(row.response.extent(body))?;
    let same = bytes.get(1..=asked.pdu.len()) == Some(&asked.pdu[..]);
    // An echoed answer and a retry look the same; where neither the clock nor what follows tells, they are weighed.
    let copy = same && (row.mirrored || length.bytes() == asked.pdu.len() + 3);
    let quiet = || if at > 0 { input.quiet_since(input.offset(), at) } else { input.pause_before(at) };
    if copy && asked.tentative {
        return None;
    }
    if copy && (context.pause)(quiet()) > SURELY_AN_ANSWER {
        if at > 0 {
            return None;
        }
        match third_copy(bytes, asked.pdu.len() + 3) {
            Some(false) if !input.timed => {}
            Some(_) => return None,
            None if input.timed => return None,
            None => return Some(Length::at_least(bytes.len() + 1)),
        }
    }
    let agrees = match expected_block(row, &asked.pdu) {
        Some(block) => body.first().is_some_and(|&count| usize::from(count) == block),
        None => !row.echo.is_empty() && (body.len() < 4 || body.get(..4) == asked.pdu.get(1..5)),
    };
    Some(length).filter(|length| agrees && length.bytes() <= LONGEST)
}

#[inline]
fn request(search: &Search, bytes: &[u8], context: &Context<'_>) -> Option<Length> {
    let (unit, code, body) = (bytes[0], bytes[1], &bytes[2..]);
    let row = context.functions.row(code, body)?;
    let length = Length::of(row.request.extent(body)).filter(|length| length.bytes() <= RTU_LIMIT)?;
    // The answer before once more, or a late one, may look like a request.
    if Length::of(row.response.extent(body)).is_some_and(|other| other.bytes() == length.bytes()) {
        let open = search.pending();
        let again = open.late.is_some_and(|late| late.is_of(unit, code))
            || (!row.mirrored && open.last.is_some_and(|(last, _)| last.is_of(unit, code)));
        if again {
            return None;
        }
    }
    Some(length.as_request())
}

/// The count that the answer to a request begins with, and the answer's whole length, where the table says so.
#[inline]
pub fn answer(row: &Row, pdu: &[u8]) -> Option<(u8, usize)> {
    let count = expected_block(row, pdu).filter(|_| !row.mirrored)?;
    let count = u8::try_from(count).ok()?;
    // A request that could be its own answer is not one without doubt: 24 inputs from an address 0x03xx on.
    match row.response.extent(&[count]) {
        Extent::Exactly(length) if length == pdu.len() - 1 && pdu.get(1) == Some(&count) => None,
        Extent::Exactly(length) if length + AROUND <= LONGEST => Some((count, length + AROUND)),
        _ => None,
    }
}

/// Whether the bytes begin with the same frame twice; `None` if more bytes are needed to tell.
pub(super) fn third_copy(bytes: &[u8], length: usize) -> Option<bool> {
    let second = bytes.get(length..).unwrap_or(&[]);
    let compared = second.len().min(length);
    if second[..compared] != bytes[..compared] {
        return Some(false);
    }
    (compared == length).then_some(true)
}
