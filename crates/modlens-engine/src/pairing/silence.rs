//! From what it is concluded that a request had no response, and how sure that is.

use crate::weights;

/// From what it was concluded that a request had no response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Silence {
    /// Its master has sent it again.
    BeforeRetry,
    /// It was a retry, and its master has gone on to another request.
    OfRetry,
    /// Its master has gone on to another request, as it does.
    ByHabit,
    /// Its master has gone on to another request, after the time of a timeout.
    BeforeAnother,
    /// Its master has gone on to another request, and neither is known.
    Unproven,
    /// No response at all was heard on this line.
    Unheard,
    /// Its waiting time was over, or the recording ended long after it.
    TimedOut,
}

impl Silence {
    pub(super) fn bits(self) -> u8 {
        match self {
            Self::BeforeRetry => weights::SILENCE_BEFORE_RETRY_BITS,
            Self::OfRetry => weights::SILENCE_OF_RETRY_BITS,
            Self::ByHabit => weights::SILENCE_BY_HABIT_BITS,
            Self::BeforeAnother => weights::SILENCE_BEFORE_ANOTHER_BITS,
            Self::Unproven => weights::SILENCE_OF_UNKNOWN_UNIT_BITS,
            Self::Unheard => weights::SILENCE_OF_ALL_BITS,
            Self::TimedOut => weights::SILENCE_TIMED_OUT_BITS,
        }
    }
}
