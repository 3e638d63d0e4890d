//! Frames that contain frames: file transfers, loopbacks and tunnels carry what was recorded elsewhere.
//!
//! A few bytes before a frame and two after it that make a longer frame with a valid CRC are no chance match. That the
//! longer frame really contains the first one is rare, but it happens. So the longer frame is worth what both are worth
//! together, less the cost of containing any.

use crate::framer::rtu::search::hypothesis::ROOT;
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::functions::{Layout, Operation, EXCEPTION_BIT};

/// Which frames a frame may contain.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Contents {
    /// It carries what somebody else has written: frames among it are payload.
    Copied,
    /// It carries what was read. That may hold frames as well, but only where the response is the one that is due.
    Read,
}

impl Search {
    /// What a frame that begins like this may contain; `None` if it contains no frames.
    ///
    /// Where the specification fixes the layout, a header, its counts and a valid CRC around a frame are no accident, whatever
    /// unit they name. Where any length and any payload would do, the unit has to be known.
    pub(super) fn contents(&self, context: &FramerContext<'_>, frame: &[u8]) -> Option<Contents> {
        let &[unit, code, ref body @ ..] = frame else { return None };
        let row = context.functions.row(code, body).filter(|_| code & EXCEPTION_BIT == 0)?;
        let is_specified = matches!((&row.request, &row.response), (Layout::Body(_), Layout::Body(_)));
        match row.operation {
            Operation::Read => Some(Contents::Read),
            _ => (is_specified || self.model.has_unit(unit)).then_some(Contents::Copied),
        }
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
