//! Frames that contain frames: file transfers, loopbacks and tunnels carry what was recorded elsewhere.
//!
//! A few bytes before a frame and two behind it that make a longer frame with a valid CRC are no chance match. That the
//! longer frame really contains the first one is rare, but it happens. So the longer frame is worth what both are worth
//! together, less the cost of containing any.

use crate::framer::rtu::search::hypothesis::ROOT;
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::functions::{Operation, EXCEPTION_BIT};

impl Search {
    /// Whether a frame that begins like this may contain others: responses to reads may not, their payload is measured and
    /// not copied.
    pub(super) fn may_contain_frames(&self, context: &FramerContext<'_>, frame: &[u8]) -> bool {
        let &[unit, code, ref body @ ..] = frame else { return false };
        let copies_payload = |operation| !matches!(operation, Operation::Read);
        let row = || context.functions.row(code, body).is_some_and(|row| copies_payload(row.operation));
        code & EXCEPTION_BIT == 0 && self.model.has_unit(unit) && row()
    }

    /// By index of each hypothesis outside a frame from stream offset `start` to the last byte scanned: what the best path that
    /// goes on from it inside that frame has gained there, in bits, less the cost of containing frames (`NESTING_BITS`). 0 where
    /// nothing is gained; empty if the latest hypothesis does not begin inside. The path ends with a valid frame before the CRC.
    pub(super) fn nested_scores(&self, start: u64) -> Vec<f32> {
        if self.lattice.last().is_none_or(|last| last.start <= start) {
            return Vec::new();
        }
        let mut nested = vec![0.0; self.lattice.len()];
        // For each hypothesis, the last one on its path that does not begin inside the frame, itself included. Parents stand
        // before their children, so theirs is known already.
        let mut outside = vec![ROOT; self.lattice.len()];
        for (i, hypothesis) in self.lattice.iter().enumerate() {
            let is_inside = i != ROOT && hypothesis.start > start;
            outside[i] = if is_inside { outside[hypothesis.parent] } else { i };
            let score = hypothesis.path_score - self.lattice[outside[i]].path_score - weights::NESTING_BITS;
            // A nested frame does not reach into the CRC of the frame that contains it.
            let ends_before_crc = hypothesis.end + CRC_BYTES as u64 <= self.scanned_to;
            if is_inside && hypothesis.is_crc_valid && ends_before_crc && score > nested[outside[i]] {
                nested[outside[i]] = score;
            }
        }
        nested
    }
}
