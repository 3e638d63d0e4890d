//! Frames that need no search in a recording, whatever stands before them, and damaged ones before these.

use crate::fast_path::rtu_chain::{first_proven_frame, Unproven};
use crate::framer::rtu::search::{BeforeProven, Decision};
use crate::framer::rtu::RtuFramer;
use crate::framer::FramerContext;
use crate::input::Input;

impl RtuFramer {
    /// Commits the next frame if it is proven and nothing before it has to be weighed; or else the damaged frame before it.
    ///
    /// That there is none is remembered, as `try_fast_path` remembers `NoFrame`, unless the question does not arise: where the
    /// search has frames in mind, where the recording is no plain one, or where its times say more than the bytes.
    pub(super) fn next_proven(&mut self, input: &Input, context: &FramerContext<'_>) -> Result<Decision, Unproven> {
        let has_failed = self.no_chain_behind == Some(input.offset());
        if has_failed || input.has_times || !self.search.has_no_hypotheses() || !self.is_plain_recording(input, context) {
            return Err(Unproven::NoChain);
        }
        let decision = self.find_proven(input, context);
        if decision.is_err_and(|why| why != Unproven::NeedsMoreBytes) {
            self.no_chain_behind = Some(input.offset());
        }
        decision
    }

    fn find_proven(&mut self, input: &Input, context: &FramerContext<'_>) -> Result<Decision, Unproven> {
        let frame = first_proven_frame(&self.search, input, context)?;
        if input.boundary_after(0, frame.range.end - 1, input.break_ns).is_some() {
            return Err(Unproven::NoChain);
        }
        Ok(match self.search.look_before_proven(input, context, &frame)? {
            BeforeProven::Nothing => self.search.commit_without_search(input, context, &frame, true),
            BeforeProven::Damaged(damaged) => self.search.commit_without_search(input, context, &damaged, false),
        })
    }
}
