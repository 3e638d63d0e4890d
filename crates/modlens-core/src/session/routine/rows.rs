//! The rows of an exchange that needed no thought.

use std::sync::Arc;

use crate::direction::Direction;
use crate::framer::{rtu, tcp, CutBy, Mode, Verdict};
use crate::points::Bound;
use crate::records::{Frame, Half, Span, Status, Transaction};
use crate::session::moment::Moment;
use crate::session::routine::expected::Expected;
use crate::session::rows::elapsed;
use crate::Ns;

/// One exchange as its rows have it.
pub(super) struct Told<'a> {
    pub number: u64,
    /// The request's; the answer has the next.
    pub frame: u64,
    pub bus: u32,
    /// Of the request and of the answer.
    pub lines: [u8; 2],
    pub known: &'a Expected,
    pub request: Span,
    pub response: Span,
    pub asked: Moment,
    pub answered: Moment,
    pub response_time: Option<Ns>,
    /// When the recording began.
    pub recording: Option<Ns>,
}

impl Told<'_> {
    pub(super) fn transaction(&self, points: Option<Arc<Bound>>, findings: Span) -> Transaction {
        let half = |frame: u64, wire: Span, start: Option<Ns>| {
            let (before, around) = self.known.around();
            let pdu = Span { start: wire.start + before as u32, length: wire.length - around as u32 };
            Half { frame, wire, pdu, start }
        };
        Transaction {
            number: self.number,
            bus: self.bus,
            mode: self.known.mode,
            start: self.asked.start,
            elapsed: elapsed(self.recording, self.asked.start),
            unit: self.known.unit,
            function: self.known.code,
            status: Status::Ok,
            exception: None,
            response_time: self.response_time,
            waited: None,
            late_response: None,
            retry_of: None,
            late_for: None,
            gap: self.asked.gap,
            mbap_id: self.known.id,
            request: half(self.frame, self.request, self.asked.start),
            response: half(self.frame + 1, self.response, self.answered.start),
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
        Frame {
            number,
            bus: self.bus,
            line,
            offset: moment.offset,
            wire,
            start: moment.start,
            elapsed: elapsed(self.recording, moment.start),
            gap: moment.gap,
            mode: self.known.mode,
            direction,
            unit: Some(self.known.unit),
            code: Some(self.known.code),
            exception: None,
            verdict: Verdict::Ok,
            tentative: false,
            confidence: if self.known.mode == Mode::Tcp { tcp::AGREES } else { rtu::SURE },
            cut_by: CutBy::Length,
            txn: Some(self.number),
            mbap_id: self.known.id,
            findings,
            origin: moment.origin,
            last_origin: moment.last_origin,
        }
    }
}
