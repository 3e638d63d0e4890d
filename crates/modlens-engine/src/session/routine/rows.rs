//! The rows of an exchange that needed no thought.

use std::sync::Arc;

use crate::framer::{ascii, rtu, tcp};
use crate::records::{Frame, Half, Span, Transaction};
use crate::session::moment::Moment;
use crate::session::routine::Found;
use crate::session::rows::elapsed;
use modlens_profiles::points::Bound;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// One exchange as its rows have it.
pub(super) struct Told<'a> {
    pub number: u64,
    /// The request's; the answer has the next.
    pub frame: u64,
    pub bus: u32,
    /// Of the request and of the answer.
    pub lines: [u8; 2],
    pub found: &'a Found,
    pub request: Span,
    pub response: Span,
    pub asked: Moment,
    pub answered: Moment,
    pub response_time: Option<Ns>,
    /// When the recording began.
    pub recording: Option<Ns>,
}

impl Told<'_> {
    /// `pdus`: of the request and of the answer.
    pub(super) fn transaction(&self, points: Option<Arc<Bound>>, pdus: [Span; 2], findings: Span) -> Transaction {
        let half = |frame: u64, wire: Span, pdu: Span, start: Option<Ns>| Half { frame, wire, pdu, start };
        Transaction {
            number: self.number,
            bus: self.bus,
            mode: self.found.mode,
            start: self.asked.start,
            elapsed: elapsed(self.recording, self.asked.start),
            unit: self.found.known.unit,
            function: self.found.known.code,
            status: Status::Ok,
            exception: None,
            response_time: self.response_time,
            waited: None,
            late_response: None,
            retry_of: None,
            late_for: None,
            gap: self.asked.gap,
            mbap_id: self.found.id,
            request: half(self.frame, self.request, pdus[0], self.asked.start),
            response: half(self.frame + 1, self.response, pdus[1], self.answered.start),
            findings,
            points,
            origin: self.asked.origin,
        }
    }

    pub(super) fn frame(&self, direction: Direction, findings: Span) -> Frame {
        let (number, line, wire, moment) = match direction {
            Direction::Request => (self.frame, self.lines[0], self.request, &self.asked),
            _ => (self.frame + 1, self.lines[1], self.response, &self.answered),
        };
        let (confidence, cut_by) = match self.found.mode {
            Mode::Rtu => (rtu::SURE, CutBy::Length),
            Mode::Ascii => (ascii::AGREES, CutBy::Delimiter),
            Mode::Tcp => (tcp::AGREES, CutBy::Length),
        };
        Frame {
            number,
            bus: self.bus,
            line,
            offset: moment.offset,
            wire,
            start: moment.start,
            elapsed: elapsed(self.recording, moment.start),
            gap: moment.gap,
            mode: self.found.mode,
            direction,
            unit: Some(self.found.known.unit),
            code: Some(self.found.known.code),
            exception: None,
            verdict: Verdict::Ok,
            tentative: false,
            confidence,
            cut_by,
            txn: Some(self.number),
            mbap_id: self.found.id,
            findings,
            origin: moment.origin,
            last_origin: moment.last_origin,
        }
    }
}
