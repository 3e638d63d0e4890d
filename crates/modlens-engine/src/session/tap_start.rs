//! The start of a tap: the line was in operation before, so the first bytes may be the rest of an exchange.
//!
//! Nothing is reported about that exchange: its other part was on the line, only not yet heard. `BusState::begins_inside` says
//! that it may still be going on.

use crate::findings;
use crate::framer::FrameResult;
use crate::input::Input;
use crate::pairing::Pairing;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;

/// The first frame of the tap as the rest of a longer one, if its checksum is wrong: unit and function may not be its own.
pub(super) fn rest_of_frame(input: &Input, framed: &FrameResult) -> Option<FrameResult> {
    let is_rest = framed.verdict == Verdict::BadChecksum && input.offset() == 0 && !comes_in_records(input);
    is_rest.then_some(FrameResult { verdict: Verdict::Incomplete, damage: None, ..*framed })
}

/// Whether the request to the next frame, if that is a response, was on the line before the tap began.
pub(super) fn lacks_request(input: &Input, pairing: &Pairing) -> bool {
    !comes_in_records(input) && pairing.heard == [0, 0]
}

/// Whether a finding on a frame at this `offset` is due to the start of the tap alone: noise there is the end of a frame, and
/// what follows it seems isolated.
pub(super) fn is_due_to_start(framed: &FrameResult, offset: u64, finding: Finding) -> bool {
    match framed.verdict {
        Verdict::Noise => offset == 0,
        verdict => verdict.is_good() && finding == findings::UNCONFIRMED,
    }
}

/// Whether the start of the tap still shows after a frame at this `offset`.
pub(super) fn goes_on(framed: &FrameResult, offset: u64) -> bool {
    framed.unconfirmed || (framed.verdict == Verdict::Noise && offset == 0)
}

/// Whether the input came in records, which are whole: lines of a log, packets.
pub(super) fn comes_in_records(input: &Input) -> bool {
    input.first_read().is_some_and(|read| read.starts_record)
}
