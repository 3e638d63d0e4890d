//! Learns from the master whether a response without its end was truncated by its sender or lost by the tap.

use crate::damage::recovery::DamageRecovery;
use crate::framer::rtu::traffic_model::TrafficModel;
use crate::framer::Context;
use modlens_protocol::direction::Direction;

impl DamageRecovery {
    /// Learns from the frame that follows a response without its end, if one is waiting for that: a master that asks again
    /// did not get the response, so the sender had stopped; one that goes on did, so the tap lost the end.
    #[inline]
    pub fn learn_reaction(&mut self, model: &mut TrafficModel, context: &Context<'_>, frame: &[u8], direction: Direction) {
        if std::mem::take(&mut self.awaits_reaction) && direction == Direction::Request {
            if let Some(asked) = context.asked {
                let is_retry = frame[0] == asked.unit && &frame[1..frame.len() - 2] == asked.pdu;
                model.learn_end(is_retry);
            }
        }
    }
}
