//! The frame lengths that a header announces, by the table of functions.

use crate::framer::rtu::join;
use crate::framer::Context;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, Layout, EXCEPTION_BIT};

/// Some masters announce more than the 256 bytes of the specification; a byte count cannot say more than this.
pub const LONGEST: usize = join::REACH as usize;

/// Unit, function code and checksum: bytes of a frame beside its body.
pub const AROUND: usize = 4;

/// The whole-frame lengths that a header announces, the likelier direction first.
pub fn announced(context: &Context<'_>, frame: &[u8]) -> [Option<(Direction, Extent)>; 2] {
    let (code, body) = (frame[1], &frame[2..]);
    if code & EXCEPTION_BIT != 0 {
        let function = code & !EXCEPTION_BIT;
        return if function == 0 { [None, None] } else { [Some((Direction::Response, Extent::Exactly(5))), None] };
    }
    let around = |layout: &Layout| match layout.extent(body) {
        Extent::Exactly(length) => Extent::Exactly(length + AROUND),
        Extent::AtLeast(length) => Extent::AtLeast(length + AROUND),
        Extent::Open(length) => Extent::Open(length + AROUND),
    };
    let Some(row) = context.functions.row(code, body) else {
        // No code 0 in the specification: a run of zeros is no frame.
        return if code == 0 { [None, None] } else { [Some((Direction::Unknown, Extent::Open(AROUND))), None] };
    };
    let request = Some((Direction::Request, around(&row.request)));
    let response = (row.response != Layout::Silent).then(|| (Direction::Response, around(&row.response)));
    if context.asked.is_some_and(|asked| asked.unit == frame[0] && asked.pdu.first() == Some(&code)) {
        [response, request]
    } else {
        [request, response]
    }
}
