//! Frames that hold frames: files, loopbacks and tunnels carry what was recorded elsewhere.
//!
//! That a few bytes before a frame and two behind it make another one with a right checksum is no chance, and that this
//! one holds the first is seldom, but happens: so it is worth what both are, less what it takes to hold any.

use crate::framer::rtu::costs;
use crate::framer::rtu::search::Search;
use crate::framer::Context;
use modlens_protocol::checksum::CHECKSUM;
use modlens_protocol::functions::{Operation, EXCEPTION_BIT};

impl Search {
    /// Whether a frame that begins so may hold others: answers to reads are measured, not copied.
    pub(super) fn may_hold(&self, context: &Context<'_>, frame: &[u8]) -> bool {
        let &[unit, code, ref body @ ..] = frame else { return false };
        let writes = |operation| !matches!(operation, Operation::Read);
        let row = || context.functions.row(code, body).is_some_and(|row| writes(row.operation));
        code & EXCEPTION_BIT == 0 && self.model.has_unit(unit) && row()
    }

    /// For each node, what the best path behind it is worth that stands inside a frame from `start` to here, less what it
    /// takes to hold one; nothing where there is none.
    pub(super) fn held(&self, start: u64) -> Vec<f32> {
        if self.nodes.last().is_none_or(|last| last.start <= start) {
            return Vec::new();
        }
        let mut held = vec![0.0; self.nodes.len()];
        // Parents stand before their children: the node behind which the frames inside begin is known already.
        let mut outside = vec![0; self.nodes.len()];
        for (at, node) in self.nodes.iter().enumerate() {
            let inside = at > 0 && node.start > start;
            outside[at] = if inside { outside[node.parent] } else { at };
            let worth = node.score - self.nodes[outside[at]].score - costs::HOLDS_FRAMES;
            // Nothing of a frame that is held reaches into the checksum of the one that holds it.
            if inside && node.whole && node.end + CHECKSUM as u64 <= self.next && worth > held[outside[at]] {
                held[outside[at]] = worth;
            }
        }
        held
    }
}
