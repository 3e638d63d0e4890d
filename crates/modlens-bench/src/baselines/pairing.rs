//! Direction and pairing for all rivals: the last request is remembered. Most real tools do less.

use crate::baselines::layout::{fits_request, fits_response};
use crate::model::Direction;
use crate::reported::ReportedFrame;

/// The outstanding request.
#[derive(Clone, Copy, Debug)]
struct Pending {
    unit: u8,
    function: u8,
    txn: u64,
}

/// Assigns directions and transactions by the outstanding request.
#[derive(Clone, Debug, Default)]
pub(crate) struct RivalPairing {
    pending: Option<Pending>,
    txn: u64,
}

impl RivalPairing {
    /// Whether a frame that begins with these bytes may be the response to the outstanding request.
    pub(crate) fn expects(&self, frame: &[u8]) -> bool {
        self.pending.is_some_and(|pending| {
            frame.first() == Some(&pending.unit) && frame.get(1).is_some_and(|code| code & 0x7F == pending.function)
        })
    }

    /// Decides direction and transaction of a whole frame: a response if it fits the outstanding request, or else a request
    /// if it can be one, or else a response.
    pub(crate) fn assign(&mut self, frame: &[u8], reported: &mut ReportedFrame) {
        let direction = if self.expects(frame) && fits_response(frame) || !fits_request(frame) {
            Direction::Response
        } else {
            Direction::Request
        };
        self.assign_with_direction(direction, frame, reported);
    }

    /// Decides the transaction of a frame whose direction is known from its line or its length.
    pub(crate) fn assign_with_direction(&mut self, direction: Direction, frame: &[u8], reported: &mut ReportedFrame) {
        reported.direction = direction;
        if direction == Direction::Request {
            self.txn += 1;
            reported.txn = Some(self.txn);
            // A broadcast has no response.
            let pending = Pending { unit: frame[0], function: frame[1] & 0x7F, txn: self.txn };
            self.pending = (frame[0] != 0).then_some(pending);
        } else if self.expects(frame) {
            reported.txn = self.pending.take().map(|pending| pending.txn);
        }
    }
}

/// Assigns transactions to the frames of a two-line tap in the order of time, with requests on line 1 and responses on line 2.
pub(crate) fn pair_lines(mut frames: Vec<(i64, ReportedFrame)>, bytes: impl Fn(&ReportedFrame) -> Vec<u8>) -> Vec<ReportedFrame> {
    frames.sort_by_key(|(time, _)| *time);
    let mut pairing = RivalPairing::default();
    let paired = frames.into_iter().map(|(_, mut frame)| {
        if frame.is_whole {
            let direction = if frame.line == 1 { Direction::Request } else { Direction::Response };
            pairing.assign_with_direction(direction, &bytes(&frame), &mut frame);
        }
        frame
    });
    paired.collect()
}
