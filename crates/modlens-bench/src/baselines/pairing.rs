//! Direction and pairing of the rivals: one request is remembered. Better than in most of the tools they stand for.

use crate::baselines::layout::{fits_request, fits_response};
use crate::model::Direction;
use crate::reported::Reported;

/// A request that waits for its answer.
#[derive(Clone, Copy, Debug)]
struct Pending {
    unit: u8,
    function: u8,
    txn: u64,
}

/// Remembers the last request.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pairing {
    pending: Option<Pending>,
    txn: u64,
}

impl Pairing {
    /// Whether a frame that begins like this is expected as an answer.
    pub(crate) fn expects(&self, frame: &[u8]) -> bool {
        self.pending.is_some_and(|pending| {
            frame.first() == Some(&pending.unit) && frame.get(1).is_some_and(|code| code & 0x7F == pending.function)
        })
    }

    /// Decides about a whole frame: a fitting answer to the pending request, else a request, else an answer.
    pub(crate) fn place(&mut self, frame: &[u8], reported: &mut Reported) {
        let direction = if self.expects(frame) && fits_response(frame) || !fits_request(frame) {
            Direction::Response
        } else {
            Direction::Request
        };
        self.place_as(direction, frame, reported);
    }

    /// The same where the direction is known: by the line, or by the length that fitted.
    pub(crate) fn place_as(&mut self, direction: Direction, frame: &[u8], reported: &mut Reported) {
        reported.direction = direction;
        if direction == Direction::Request {
            self.txn += 1;
            reported.txn = Some(self.txn);
            // Nobody answers a broadcast.
            let pending = Pending { unit: frame[0], function: frame[1] & 0x7F, txn: self.txn };
            self.pending = (frame[0] != 0).then_some(pending);
        } else if self.expects(frame) {
            reported.txn = self.pending.take().map(|pending| pending.txn);
        }
    }
}

/// Frames of a two-line tap, in the order of time: requests on line 1, responses on line 2.
pub(crate) fn pair_lines(mut frames: Vec<(i64, Reported)>, bytes: impl Fn(&Reported) -> Vec<u8>) -> Vec<Reported> {
    frames.sort_by_key(|(time, _)| *time);
    let mut pairing = Pairing::default();
    let paired = frames.into_iter().map(|(_, mut frame)| {
        if frame.crc_ok {
            let direction = if frame.line == 1 { Direction::Request } else { Direction::Response };
            pairing.place_as(direction, &bytes(&frame), &mut frame);
        }
        frame
    });
    paired.collect()
}
