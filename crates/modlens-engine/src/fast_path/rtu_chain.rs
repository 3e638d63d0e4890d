//! Frames in a recording that need no search, because they are known, or a chain proves them: what stands behind a frame shows what it
//! is.
//!
//! `rtu_frame` finds what is beyond doubt by itself, behind three stray bytes at most. Here the bytes before a frame may be any,
//! such as a damaged frame, another request may be outstanding, and its function may have frames of any length:
//!
//! - a request of the poll cycle that cannot be its own response;
//! - the response that the outstanding request determines, to the byte count;
//! - a response of open length to the outstanding request, with a request of the poll cycle to another unit or function behind it;
//! - a request of open length, with such a response behind it.
//!
//! Each frame has a valid CRC. Those of a chain stand no more than `MAX_SKIPPED_STRAY_BYTES` one behind the other. Whether the bytes before
//! them hide a frame is left to the caller.

use crate::fast_path::frame_check::expected_response;
use crate::fast_path::rtu_frame::{is_permitted_request, may_answer_earlier_request};
use crate::framer::rtu::announced_length::ENVELOPE_BYTES;
use crate::framer::rtu::answerable::HeldRequest;
use crate::framer::rtu::crc_scan::MAX_CANDIDATE_BYTES;
use crate::framer::rtu::search::{max_frame_length, Search};
use crate::framer::rtu::side::{REQUEST, RESPONSE};
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights::{MAX_POLL_REQUEST_BYTES, MAX_SKIPPED_STRAY_BYTES};
use modlens_protocol::checksum::{crc_valid_at, first_valid_length, CRC_BYTES};
use modlens_protocol::direction::RequestRef;
use modlens_protocol::functions::{Extent, FunctionRow, EXCEPTION_BIT};
use std::ops::Range;

/// A frame that a chain proves.
pub struct ProvenFrame {
    /// Indices of its bytes in the input, the end excluded.
    pub range: Range<usize>,
    /// `REQUEST`, or `RESPONSE` to the outstanding request.
    pub direction: usize,
}

/// Why no chain proves a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unproven {
    /// No frame begins there.
    NoFrame,
    /// A frame may begin there, but nothing proves it.
    NoChain,
    /// More bytes are needed to tell.
    NeedsMoreBytes,
}

/// The first frame of the input that a chain proves, behind fewer bytes than the longest frame has. The first place decides at
/// which there may be a frame. Changes nothing.
pub fn first_proven_frame(search: &Search, input: &Input, context: &FramerContext<'_>) -> Result<ProvenFrame, Unproven> {
    let outstanding = search.outstanding_request().filter(|request| !request.is_unconfirmed && !request.is_damaged);
    let chain = Chain { search, input, context, outstanding };
    let bytes = input.bytes();
    let asked_unit = outstanding.map(|request| request.unit);
    for (at, &unit) in bytes.iter().enumerate().take(MAX_CANDIDATE_BYTES) {
        // Most bytes are no unit of this line.
        if !search.model.is_familiar_unit(unit) && asked_unit != Some(unit) {
            continue;
        }
        match chain.proven_frame_at(at) {
            Err(Unproven::NoFrame) => {}
            found => return found,
        }
    }
    Err(if bytes.len() < MAX_CANDIDATE_BYTES { chain.lack() } else { Unproven::NoFrame })
}

/// What chains are looked for in.
struct Chain<'a> {
    search: &'a Search,
    input: &'a Input,
    context: &'a FramerContext<'a>,
    /// The outstanding request, if it is sound.
    outstanding: Option<&'a HeldRequest>,
}

impl<'a> Chain<'a> {
    /// The frame that begins at this index of the input, if a chain proves it.
    #[inline]
    fn proven_frame_at(&self, at: usize) -> Result<ProvenFrame, Unproven> {
        let &[unit, code] = self.bytes(at, 2)?.first_chunk().ok_or(Unproven::NoFrame)?;
        let answers = |request: &&HeldRequest| request.matches(unit, code);
        if let Some(request) = self.outstanding.filter(answers) {
            match self.proven_response(request, at) {
                Err(Unproven::NoFrame) => {}
                end => return end.map(|end| ProvenFrame { range: at..end, direction: RESPONSE }),
            }
        }
        if code & EXCEPTION_BIT != 0 || !self.search.model.is_familiar(unit, code, REQUEST) {
            return Err(Unproven::NoFrame);
        }
        self.proven_request(at).map(|end| ProvenFrame { range: at..end, direction: REQUEST })
    }

    /// The end of the response at this index to the outstanding request, whose unit and function it has.
    fn proven_response(&self, request: &HeldRequest, at: usize) -> Result<usize, Unproven> {
        if let Some(row) = self.context.functions.row(request.pdu[0], &request.pdu[1..]) {
            return self.determined_response(row, request.as_request_ref(), at);
        }
        let end = self.open_response(at)?;
        let (frame, pdu) = (&self.input.bytes()[at..end], &self.input.bytes()[at + 1..end - CRC_BYTES]);
        // The same request again, or another one to the same unit.
        let may_be_request = request.pdu == pdu || self.search.model.poll_cycle.contains(frame);
        if may_be_request {
            Err(Unproven::NoChain)
        } else {
            Ok(end)
        }
    }

    /// The end of the request at this index, whose unit and function are familiar.
    fn proven_request(&self, at: usize) -> Result<usize, Unproven> {
        let bytes = self.bytes(at, ENVELOPE_BYTES)?;
        match self.context.functions.row(bytes[1], &bytes[2..]) {
            Some(row) => self.polled_request(at, row),
            None => self.open_request(at),
        }
    }

    /// The end of the request of the poll cycle at this index, whose function has this row, and which cannot be its own response.
    fn polled_request(&self, at: usize, row: &FunctionRow) -> Result<usize, Unproven> {
        let Extent::Exactly(length) = row.request.extent(&self.input.bytes()[at + 2..]) else { return Err(Unproven::NoFrame) };
        let end = self.valid_frame(at, length + ENVELOPE_BYTES)?;
        let frame = &self.input.bytes()[at..end];
        let is_polled = || is_permitted_request(frame, self.context) && self.search.model.poll_cycle.contains(frame);
        let differs_from_response = expected_response(row, &frame[1..frame.len() - CRC_BYTES]).is_some();
        if differs_from_response && frame.len() <= MAX_POLL_REQUEST_BYTES && is_polled() {
            Ok(end)
        } else {
            Err(Unproven::NoChain)
        }
    }

    /// The end of the response at this index that this request, whose function has this row, determines to the byte count.
    fn determined_response(&self, row: &FunctionRow, request: RequestRef<'_>, at: usize) -> Result<usize, Unproven> {
        let header = self.bytes(at, ENVELOPE_BYTES)?;
        match expected_response(row, request.pdu) {
            Some((count, length)) if header[2] == count => self.valid_frame(at, length),
            Some(_) => Err(Unproven::NoFrame),
            // A response that has its length, but that nothing proves.
            None => match row.response.extent(&self.input.bytes()[at + 2..]) {
                Extent::Exactly(length) => self.valid_frame(at, length + ENVELOPE_BYTES).and(Err(Unproven::NoChain)),
                Extent::AtLeast(_) | Extent::Open(_) => Err(Unproven::NoFrame),
            },
        }
    }

    /// The end of the request of open length at this index, whose unit and function are familiar: a response of these stands
    /// behind it.
    fn open_request(&self, at: usize) -> Result<usize, Unproven> {
        let bytes = &self.input.bytes()[at..];
        let (unit, code) = (bytes[0], bytes[1]);
        let is_idle = self.search.outstanding_request().is_none() && !may_answer_earlier_request(self.search, unit, code);
        if !is_idle {
            return Err(Unproven::NoFrame);
        }
        let end = self.open_frame(at)?;
        self.behind_strays(end, |place| {
            let header = self.bytes(place, ENVELOPE_BYTES)?;
            let is_response = header[..2] == [unit, code];
            let end = if is_response { self.open_response(place)? } else { return Err(Unproven::NoFrame) };
            if self.input.bytes()[place..end] == bytes[..end - place] {
                Err(Unproven::NoFrame)
            } else {
                Ok(end)
            }
        })?;
        Ok(end)
    }

    /// The end of the frame of open length at this index that a request of the poll cycle to another unit or function follows: so
    /// it is a response.
    fn open_response(&self, at: usize) -> Result<usize, Unproven> {
        let end = self.open_frame(at)?;
        let header = &self.input.bytes()[at..at + 2];
        self.behind_strays(end, |place| {
            let next = self.bytes(place, ENVELOPE_BYTES)?;
            let row = self.context.functions.row(next[1], &self.input.bytes()[place + 2..]);
            let is_other = next[..2] != *header && self.search.model.is_familiar(next[0], next[1], REQUEST);
            self.polled_request(place, row.filter(|_| is_other).ok_or(Unproven::NoFrame)?)
        })?;
        Ok(end)
    }

    /// The end of the frame at this index that is the shortest one with a valid CRC, if no layout says how long it is.
    fn open_frame(&self, at: usize) -> Result<usize, Unproven> {
        let bytes = &self.input.bytes()[at..];
        let max_length = max_frame_length(self.input, at);
        let is_open = self.context.functions.row(bytes[1], &bytes[2..]).is_none();
        let found = first_valid_length(&bytes[..max_length.min(bytes.len())], ENVELOPE_BYTES).filter(|_| is_open);
        match found {
            Some(length) => match bytes.get(length) {
                // With zeros behind it, a frame has a valid CRC, too: they may belong to it.
                Some(0) => Err(Unproven::NoChain),
                None if !self.input.is_closed => Err(Unproven::NeedsMoreBytes),
                _ => self.valid_frame(at, length),
            },
            None if is_open && max_length > bytes.len() => Err(self.lack()),
            None => Err(Unproven::NoFrame),
        }
    }

    /// The end of the next frame of a chain, which `at` finds at one of the places where it may begin behind index `end`.
    fn behind_strays(&self, end: usize, at: impl Fn(usize) -> Result<usize, Unproven>) -> Result<usize, Unproven> {
        let places = end..=end + MAX_SKIPPED_STRAY_BYTES;
        places.map(at).find(|result| *result != Err(Unproven::NoFrame)).unwrap_or(Err(Unproven::NoChain))
    }

    /// The end of the frame of this length at this index, if there is one, with a valid CRC and no boundary inside.
    fn valid_frame(&self, at: usize, length: usize) -> Result<usize, Unproven> {
        if length > MAX_CANDIDATE_BYTES {
            return Err(Unproven::NoFrame);
        }
        let is_valid = crc_valid_at(self.bytes(at, length)?, length)
            && self.input.boundary_after(at, at + length - 1, self.input.break_ns).is_none();
        if is_valid {
            Ok(at + length)
        } else {
            Err(Unproven::NoFrame)
        }
    }

    /// The bytes from this index on, of which there have to be so many.
    #[inline]
    fn bytes(&self, at: usize, length: usize) -> Result<&'a [u8], Unproven> {
        self.input.bytes().get(at..).filter(|bytes| bytes.len() >= length).ok_or_else(|| self.lack())
    }

    /// What the lack of bytes means: that more have to come, unless the input is closed.
    fn lack(&self) -> Unproven {
        if self.input.is_closed {
            Unproven::NoFrame
        } else {
            Unproven::NeedsMoreBytes
        }
    }
}
