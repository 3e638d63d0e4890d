//! The rows of an exchange that the fast path has matched.

use std::sync::Arc;

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rtu_exchange::rtu_request_confidence;
use crate::records::{Frame, FrameRef, Span, Transaction};
use crate::session::frame_timing::FrameTiming;
use crate::session::rows::elapsed;
use crate::stats::RequestPlace;
use crate::weights::{
    ANSWER_BY_ID_BITS, ANSWER_IN_TURN_BITS, LRC_CONFIDENCE_BITS, MBAP_CONFIDENCE_BITS, UNCONFIRMED_TRANSACTION_BITS,
};
use modlens_profiles::points::PlanInstance;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// A request and its response at the heads of their lines.
pub(super) struct MatchedExchange {
    /// The exchange as the request announces it; the response is the one expected.
    pub expected: ExpectedExchange,
    /// The framing.
    pub mode: Mode,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// Indices of the lines of request and response.
    pub lines: [usize; 2],
    /// Lengths of request and response on their lines, in bytes or, for ASCII, characters.
    pub lengths: [usize; 2],
    /// Log2 of the odds of the response's direction.
    pub response_bits: u8,
    /// Where the statistics count the request, if that is known.
    pub counters: Option<RequestPlace>,
}

/// Returns the log2 odds of an exchange on a connection, as `MatchedExchange::transaction_confidence` has them.
pub(super) fn confidence_by_id() -> u8 {
    ANSWER_BY_ID_BITS.min(MBAP_CONFIDENCE_BITS)
}

impl MatchedExchange {
    /// Returns the log2 odds that request and response belong together: as pairing has them, but not above those of the frames.
    pub(super) fn transaction_confidence(&self) -> u8 {
        let pairing = if self.mbap_id.is_some() { ANSWER_BY_ID_BITS } else { ANSWER_IN_TURN_BITS };
        pairing.min(self.request_confidence()).min(self.response_bits)
    }

    /// Returns the confidence of the request, which is that of the mode's framer.
    fn request_confidence(&self) -> u8 {
        match self.mode {
            Mode::Rtu => rtu_request_confidence(self.expected.echoes_request),
            Mode::Ascii => LRC_CONFIDENCE_BITS,
            Mode::Tcp => MBAP_CONFIDENCE_BITS,
        }
    }
}

/// One exchange with all that its rows need.
pub(super) struct ExchangeRows<'a> {
    /// Number of the transaction.
    pub txn: u64,
    /// Number of the request's frame; the response's frame has the next one.
    pub request_frame: u64,
    /// Number of the bus.
    pub bus: u32,
    /// Lines of the request and of the response.
    pub lines: [u8; 2],
    /// The exchange itself.
    pub matched: &'a MatchedExchange,
    /// Place of the request's bytes in the arena of the batch.
    pub request_wire: Span,
    /// Place of the response's bytes in the arena.
    pub response_wire: Span,
    /// When and where the request was.
    pub request_timing: FrameTiming,
    /// When and where the response was.
    pub response_timing: FrameTiming,
    /// `None` if the clock cannot measure it.
    pub response_time: Option<Ns>,
    /// When the recording began.
    pub recording_start: Option<Ns>,
}

impl ExchangeRows<'_> {
    /// Returns the row of the transaction, which starts with its request and has status ok: what is neither plain nor complete
    /// takes the slow path, so there is no exception, retry or late response. `points`: the profile of its unit, if there is one.
    /// `pdus`: places of the PDUs of request and response in the arena. `findings`: an empty place in the batch. Times are
    /// nanoseconds, and `None` without a clock.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A row is large, and `Session::emit_exchange` moves it into its table at once.
    pub(super) fn transaction(&self, points: Option<Arc<PlanInstance>>, pdus: [Span; 2], findings: Span) -> Transaction {
        let frame_ref = |frame: u64, wire: Span, pdu: Span, timing: &FrameTiming| FrameRef {
            frame,
            wire,
            pdu,
            start: timing.start,
            end: timing.end,
        };
        Transaction {
            number: self.txn,
            bus: self.bus,
            mode: self.matched.mode,
            start: self.request_timing.start,
            elapsed: elapsed(self.recording_start, self.request_timing.start),
            unit: self.matched.expected.unit,
            function: self.matched.expected.code,
            status: Status::Ok,
            exception: None,
            confidence: self.matched.transaction_confidence(),
            unconfirmed: self.matched.transaction_confidence() < UNCONFIRMED_TRANSACTION_BITS,
            response_time: self.response_time,
            waited: None,
            late_response: None,
            retry_of: None,
            late_response_to: None,
            gap: self.request_timing.gap,
            mbap_id: self.matched.mbap_id,
            request: frame_ref(self.request_frame, self.request_wire, pdus[0], &self.request_timing),
            response: frame_ref(self.request_frame + 1, self.response_wire, pdus[1], &self.response_timing),
            findings,
            points,
            origin: self.request_timing.origin,
        }
    }

    /// Returns the row of the request's frame, or of the response's for any other `direction`. `findings`: an empty place in the
    /// batch. Verdict, confidence and what delimits the frame are those that the framer of the mode would give.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A row is large, and `Session::emit_exchange` moves it into its table at once.
    pub(super) fn frame(&self, direction: Direction, findings: Span) -> Frame {
        let (number, line, wire, timing) = match direction {
            Direction::Request => (self.request_frame, self.lines[0], self.request_wire, &self.request_timing),
            _ => (self.request_frame + 1, self.lines[1], self.response_wire, &self.response_timing),
        };
        let is_ascii = self.matched.mode == Mode::Ascii;
        let delimited_by = if is_ascii { DelimitedBy::Delimiter } else { DelimitedBy::Length };
        let confidence = if direction == Direction::Request { u8::MAX } else { self.matched.response_bits }
            .min(self.matched.request_confidence());
        Frame {
            number,
            bus: self.bus,
            line,
            offset: timing.offset,
            wire,
            start: timing.start,
            end: timing.end,
            elapsed: elapsed(self.recording_start, timing.start),
            gap: timing.gap,
            pauses: timing.pauses,
            mode: self.matched.mode,
            direction,
            unit: Some(self.matched.expected.unit),
            code: Some(self.matched.expected.code),
            exception: None,
            verdict: Verdict::Ok,
            unconfirmed: false,
            confidence,
            delimited_by,
            txn: Some(self.txn),
            mbap_id: self.matched.mbap_id,
            findings,
            origin: timing.origin,
            last_origin: timing.last_origin,
        }
    }
}
