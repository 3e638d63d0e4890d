//! How certain the status and the pairing of a transaction are: its `confidence`, in bits (log2 odds of being right).
//!
//! A transaction is never more certain than its frames. Beyond that its confidence is that of the weakest conclusion that was
//! drawn: that this response belongs to this request, or that there was none. The bits of each kind of conclusion were counted
//! on simulated lines (`modlens-bench odds`).

use crate::pairing::silence::Silence;
use crate::pairing::{ObservedFrame, Pairing, PendingTransaction};
use crate::weights;
use modlens_protocol::direction::{match_response, ResponseMatch};
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;

impl PendingTransaction {
    /// The log2 odds that status and pairing are right: those of the conclusion, but not above those of its frames.
    pub fn confidence(&self) -> u8 {
        let frames = [&self.request, &self.response].into_iter().filter(|frame| frame.is_present());
        frames.map(|frame| frame.confidence).chain([self.certainty]).min().unwrap_or(weights::MAX_CONFIDENCE_BITS)
    }

    /// Whether it is not to be relied on: a frame of it is unconfirmed, or its odds are low.
    pub fn is_unconfirmed(&self) -> bool {
        let has_unconfirmed_frame = self.request.is_unconfirmed || self.response.is_unconfirmed;
        self.unconfirmed || has_unconfirmed_frame || self.confidence() < weights::UNCONFIRMED_TRANSACTION_BITS
    }

    /// Notes from what the lack of a response was concluded. Where nothing is claimed of it, nothing is noted.
    pub(super) fn note_silence(&mut self, silence: Silence) {
        let bits = match self.status {
            Status::NoResponse if !self.expects_no_response => silence.bits(),
            _ => weights::MAX_CONFIDENCE_BITS,
        };
        self.certainty = self.certainty.min(bits);
    }
}

impl Pairing {
    /// How certain it is that this response belongs to this open request, in bits.
    pub(super) fn answer_bits(&self, functions: &Functions, open: &PendingTransaction, frame: &ObservedFrame<'_>) -> u8 {
        let request = open.request_to(frame.unit());
        if open.status == Status::BadRequest {
            return weights::ANSWER_TO_DAMAGED_BITS;
        }
        if match_response(functions, request, frame.unit(), frame.pdu()) != ResponseMatch::Fully {
            return weights::ANSWER_PARTLY_BITS;
        }
        match (frame.mbap_id, open.mbap_id) {
            (Some(id), Some(requested)) if id == requested => weights::ANSWER_BY_ID_BITS,
            (Some(_), Some(_)) => weights::ANSWER_BY_HABIT_BITS,
            _ if self.order_is_inferred => weights::ANSWER_IN_INFERRED_ORDER_BITS,
            _ if !self.is_wire_order => weights::ANSWER_IN_LATE_READS_BITS,
            _ if open.retry_of.is_some() => weights::ANSWER_AFTER_RETRY_BITS,
            _ if self.history.may_answer_unanswered(functions, frame, open.txn) => weights::ANSWER_AFTER_SILENCE_BITS,
            _ => weights::ANSWER_IN_TURN_BITS,
        }
    }
}
