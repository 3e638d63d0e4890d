//! Live, where silence alone ends an answer: has the sender stopped, or has the tap lost the rest?
//!
//! What the line has shown decides. A master that did not get its answer asks again, one that did goes on; in a recording
//! that is known before anything is told.

use crate::damage::kind::Harm;
use crate::framer::rtu::search::Told;
use crate::framer::rtu::Rtu;
use crate::framer::Context;
use modlens_protocol::direction::Direction;

impl Rtu {
    /// Says so of the last piece that was found, if it is such an answer.
    pub(crate) fn blame(&mut self) {
        if matches!(self.told, Some(Told::Frame { .. } | Told::Damaged { .. })) {
            return;
        }
        let Some((_, last)) = self.pieces.back_mut().filter(|(_, last)| last.direction == Direction::Response) else { return };
        let Some(Harm::Lost { at, count: count @ 1.. }) = last.harm else { return };
        if at == last.end - last.start {
            self.open_end = true;
            if !self.search.model.loses_ends() {
                last.harm = Some(Harm::Truncated { count });
            }
        }
    }

    /// A frame behind such an answer: does the master ask again?
    #[inline]
    pub(crate) fn learn_end(&mut self, context: &Context<'_>, frame: &[u8], direction: Direction) {
        if std::mem::take(&mut self.open_end) && direction == Direction::Request {
            if let Some(asked) = context.asked {
                let again = frame[0] == asked.unit && &frame[1..frame.len() - 2] == asked.pdu;
                self.search.model.learn_end(again);
            }
        }
    }
}
