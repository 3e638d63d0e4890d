//! Findings on a line as a whole, which are told once: what nearly all of its frames have in common.

use crate::findings::line;
use crate::session::rows::FindingPlace;
use crate::session::Session;

/// Frames before anything is said about a line as a whole.
const MIN_FRAMES: u64 = 20;

/// Of responses only, one frame in so many may be taken for a request: a write and its response are equal.
const RESPONSES_PER_REQUEST: u64 = 10;

/// The side that alone was heard: true for requests. `heard`: good requests and good responses.
fn only_side([requests, responses]: [u64; 2]) -> Option<bool> {
    let is_enough = requests + responses >= MIN_FRAMES;
    let only_requests = is_enough && responses == 0;
    let only_responses = is_enough && requests * RESPONSES_PER_REQUEST <= responses;
    (only_requests || only_responses).then_some(only_requests)
}

impl Session {
    /// Emits the finding that only one side of a bus was heard, at the end of its recording, once.
    pub(super) fn find_on_line(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let heard = state.pairing.heard;
        let Some(is_request) = only_side(heard).filter(|_| !state.has_one_side_finding) else { return };
        state.has_one_side_finding = true;
        let (start, recording_start) = (self.buses[bus].newest, self.origin);
        let place = FindingPlace { frame: None, txn: None, bus, start, recording_start, unit: None, origin: 0 };
        for (finding, detail) in line::one_side_only(is_request, heard[usize::from(!is_request)], heard.iter().sum()) {
            self.stats.finding(finding);
            if self.wanted.findings {
                self.batch.findings.push(place.row(finding, detail));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_side_is_heard_alone_where_the_other_is_never_heard() {
        assert_eq!(
            [[20, 0], [19, 0], [300, 1], [0, 20], [3, 30], [4, 30]].map(only_side),
            [Some(true), None, None, Some(false), Some(false), None]
        );
    }
}
