//! Frames that a chain proves: in a recording, they need no search whatever stands before them.

use crate::fast_path::frame_check::FrameLength;
use crate::fast_path::rtu_chain::{first_proven_frame, ProvenFrame, Unproven};
use crate::framer::rtu::search::Decision;
use crate::framer::rtu::side::REQUEST;
use crate::framer::rtu::RtuFramer;
use crate::framer::FramerContext;
use crate::input::Input;

impl RtuFramer {
    /// Commits the next frame if a chain proves it and nothing before it has to be weighed.
    ///
    /// That there is none is remembered, as `try_fast_path` remembers `NoFrame`, unless the question does not arise
    /// (`is_plain_recording`).
    pub(super) fn next_proven(&mut self, input: &Input, context: &FramerContext<'_>) -> Result<Decision, Unproven> {
        if self.no_chain_behind == Some(input.offset()) || !self.is_plain_recording(input, context) {
            return Err(Unproven::NoChain);
        }
        let found = self.find_proven(input, context);
        if found.as_ref().is_err_and(|why| *why != Unproven::NeedsMoreBytes) {
            self.no_chain_behind = Some(input.offset());
        }
        Ok(self.search.commit_proven_frame(input, context, &found?))
    }

    /// The next frame, if a chain proves it, no boundary stands before its end, the search has no other frame in mind, and
    /// nothing before it has to be weighed.
    fn find_proven(&mut self, input: &Input, context: &FramerContext<'_>) -> Result<ProvenFrame, Unproven> {
        let frame = first_proven_frame(&self.search, input, context)?;
        let length = FrameLength::exactly(frame.range.len());
        let length = if frame.direction == REQUEST { length.as_request() } else { length };
        let is_allowed = self.search.allows_fast_path(frame.range.start, length)
            && input.boundary_after(0, frame.range.end - 1, input.break_ns).is_none();
        if !is_allowed {
            return Err(Unproven::NoChain);
        }
        self.search.check_before_proven(input, context, &frame)?;
        Ok(frame)
    }
}
