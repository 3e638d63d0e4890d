//! Live, a silence has ended a response too early: did its sender stop, or has the tap lost the rest?
//!
//! The line's history decides. A master that did not get its response asks again, one that did goes on with its poll cycle.
//! In a recording, the next frame shows which of the two it is before the response is emitted; live, it comes too late for
//! this response and is learned for the next one. Of a request without its end nothing is learned: it is put down to the tap where
//! the line is known to lose bytes.

use crate::damage::region::DamagedFrame;
use crate::frame_result::FramerContext;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::traffic_model::TrafficModel;
use modlens_protocol::direction::Direction;

/// Attributes truncated responses, and learns from what masters do next.
#[derive(Debug, Default)]
pub struct TruncationLearner {
    /// A response without its end was found, and it is not known yet whether the master will ask again.
    awaits_reaction: bool,
}

impl TruncationLearner {
    /// Attributes the missing end of `last`, the last frame in front of a silence, to its sender or to the tap.
    pub fn attribute(&mut self, model: &TrafficModel, last: &mut DamagedFrame) {
        let Some(DamageKind::LostBytes { at, count: count @ 1.. }) = last.damage else { return };
        let lacks_end = at == last.end - last.start;
        if !lacks_end {
            return;
        }
        let is_response = last.direction == Direction::Response;
        self.awaits_reaction = is_response;
        let is_by_tap = if is_response { model.tap_truncates_responses() } else { model.loses_bytes() };
        if !is_by_tap {
            last.damage = Some(DamageKind::Truncated { count });
        }
    }

    /// Learns from the frame that follows a response without its end: a master that asks again did not get the response, so
    /// the sender had stopped; one that goes on did, so the tap lost the end.
    #[inline]
    pub fn learn_reaction(&mut self, model: &mut TrafficModel, context: &FramerContext<'_>, frame: &[u8], direction: Direction) {
        if std::mem::take(&mut self.awaits_reaction) && direction == Direction::Request {
            if let Some(request) = context.outstanding_request {
                let is_retry = frame[0] == request.unit && &frame[1..frame.len() - 2] == request.pdu;
                model.learn_truncation(is_retry);
            }
        }
    }
}
