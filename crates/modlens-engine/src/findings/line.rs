//! Findings on a line as a whole.

use super::contradictions::Contradiction;
use super::{words, Found};
use modlens_protocol::finding::Finding;

/// What the responses of a unit have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Habit {
    /// The two bytes of the checksum are swapped.
    SwappedChecksum,
    /// There is no checksum.
    NoChecksum,
    /// So many bytes of this value follow.
    Padding(u8, u8),
}

/// One side alone was heard of a line: requests, or else responses; `heard` of `all` good frames.
pub(crate) fn one_side_only(is_request: bool, heard: u64, all: u64) -> Found {
    vec![(Finding::OneSideOnly, words::one_side_only(is_request, heard, all))]
}

/// What contradicts physics or the settings of a line.
pub(crate) fn contradictions(found: &[Contradiction]) -> Found {
    let finding = |contradiction: &Contradiction| match contradiction {
        Contradiction::Faster { .. } => Finding::FasterThanLine,
        Contradiction::Overfull { .. } => Finding::OverfullLine,
        Contradiction::ErrorsOnValid { .. } => Finding::ErrorsOnValidFrames,
    };
    found.iter().map(|contradiction| (finding(contradiction), words::contradiction(contradiction))).collect()
}

/// Next to none of the bytes of a line belong to valid frames: `valid` of `all`.
pub(crate) fn no_valid_frame(valid: u64, all: u64) -> Found {
    vec![(Finding::NoValidFrame, words::no_valid_frame(valid, all))]
}

/// What `n` of `all` responses of a unit have in common.
pub(crate) fn habit_of_unit(unit: u8, habit: Habit, n: u64, all: u64) -> Found {
    vec![match habit {
        Habit::SwappedChecksum => (Finding::SwappedChecksum, words::swapped_checksum(unit, n, all)),
        Habit::NoChecksum => (Finding::MissingChecksum, words::missing_checksum(unit, n, all)),
        Habit::Padding(byte, length) => (Finding::PaddedResponses, words::padded_responses(unit, (byte, length), n, all)),
    }]
}

/// `n` of `all` requests to a unit were answered by another one.
pub(crate) fn answers_as_other_unit(asked: u8, answering: u8, n: u64, all: u64) -> Found {
    vec![(Finding::AnswersAsOtherUnit, words::answers_as_other_unit(asked, answering, n, all))]
}
