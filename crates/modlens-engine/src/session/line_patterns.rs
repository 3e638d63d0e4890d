//! Findings on a line as a whole, which are reported once: what nearly all of its frames, or those of a unit, have in common.

use crate::findings::line;
use crate::findings::Found;
use crate::session::bus::BusState;
use crate::session::decoder::Decoder;
use crate::session::rows::FindingPlace;
use crate::session::unit_habits::{MIN_HABIT_RESPONSES, RESPONSES_PER_HABIT};
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Frames before anything is said about a line as a whole.
const MIN_FRAMES: u64 = 20;

/// Of responses only, one frame in so many may be taken for a request: a write and its response are equal.
const RESPONSES_PER_REQUEST: u64 = 10;

/// Bytes of a recording before it is said that nothing fits.
const MIN_UNFIT_BYTES: u64 = 256;

/// Nothing fits if less than one in so many bytes belongs to a valid frame.
const BYTES_PER_VALID_BYTE: u64 = 50;

/// The side that alone was heard: true for requests. `heard`: good requests and good responses.
fn only_side([requests, responses]: [u64; 2]) -> Option<bool> {
    let is_enough = requests + responses >= MIN_FRAMES;
    let only_requests = is_enough && responses == 0;
    let only_responses = is_enough && requests * RESPONSES_PER_REQUEST <= responses;
    (only_requests || only_responses).then_some(only_requests)
}

/// That only one side of a bus was heard; empty if it was said before.
fn only_one_side(state: &mut BusState) -> Found {
    let heard = state.pairing.heard;
    let Some(is_request) = only_side(heard).filter(|_| !state.has_one_side_finding) else { return Found::new() };
    state.has_one_side_finding = true;
    line::one_side_only(is_request, heard[usize::from(!is_request)], heard.iter().sum())
}

impl Decoder {
    /// Emits the findings on a bus as a whole, at the end of its recording: each is reported once.
    pub(super) fn find_on_line(&mut self, bus: usize) {
        let mut found = only_one_side(&mut self.buses[bus]);
        found.extend(self.habits_of_units(bus));
        found.extend(self.no_valid_frame(bus));
        found.extend(self.contradictions(bus));
        let (start, recording_start) = (self.buses[bus].newest, self.origin);
        let place = FindingPlace { frame: None, txn: None, bus, start, recording_start, unit: None, origin: 0 };
        for (finding, detail) in found {
            self.stats.finding(finding);
            if self.wanted.findings {
                self.batch.findings.push(place.row(finding, detail));
            }
        }
    }

    /// What many responses of a unit have in common, and the units that others answer for. The counts restart.
    fn habits_of_units(&mut self, bus: usize) -> Found {
        let state = &mut self.buses[bus];
        let mut found = Found::new();
        for ((unit, habit), n) in state.habits.take() {
            let all = self.stats.responses_of(state.counts, unit).max(n);
            if n > MIN_HABIT_RESPONSES && n * RESPONSES_PER_HABIT >= all {
                found.extend(line::habit_of_unit(unit, habit, n, all));
            }
        }
        for ((asked, answering), n) in std::mem::take(&mut state.pairing.answered_by_other) {
            let all = self.stats.transactions_of(state.counts, asked).max(n);
            if n > MIN_HABIT_RESPONSES && n * RESPONSES_PER_HABIT >= all {
                found.extend(line::answers_as_other_unit(asked, answering, n, all));
            }
        }
        found
    }

    /// What contradicts the settings of its lines. All lines of a bus may carry bytes at the same time.
    fn contradictions(&mut self, bus: usize) -> Found {
        let state = &mut self.buses[bus];
        let valid = self.stats.valid_frames_of(state.counts);
        let (_, bytes) = self.stats.valid_bytes_of(state.counts);
        let lines = state.lines.len() as u64;
        let settings = state.options.line.filter(|_| state.options.mode != Some(Mode::Tcp));
        let all = settings.zip(self.stats.duration_of(state.counts));
        let all = all.map(|(line, lasts)| (bytes, (bytes / lines.max(1)) as Ns * line.char_ns(), lasts));
        let mut found = Found::new();
        for (_, line) in &mut state.lines {
            found.extend(line::contradictions(&line.contradictions.take(valid / lines.max(1), all)));
        }
        found.dedup_by_key(|(finding, _)| *finding);
        found
    }

    /// That no framing fits; empty if one does, or if it was said before.
    fn no_valid_frame(&mut self, bus: usize) -> Found {
        let state = &mut self.buses[bus];
        let (valid, all) = self.stats.valid_bytes_of(state.counts);
        if state.has_no_valid_frame_finding || all < MIN_UNFIT_BYTES || valid * BYTES_PER_VALID_BYTE >= all {
            return Found::new();
        }
        state.has_no_valid_frame_finding = true;
        line::no_valid_frame(valid, all)
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
