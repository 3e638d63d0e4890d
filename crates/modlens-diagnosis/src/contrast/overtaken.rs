//! Answers that came after the next request, and the times of them.

use modlens_engine::durations::Durations;
use modlens_protocol::Ns;

use super::tally::{Place, Tally};

/// Answers that came after the next request: too late, if the master does not ask ahead.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Overtaken {
    /// Which.
    pub answers: Tally,
    /// How long the master waited before it went on.
    pub waited: Durations,
    /// How long they took.
    pub needed: Durations,
}

impl Overtaken {
    pub(super) fn count(&mut self, place: Place, waited: Ns, needed: Ns) {
        self.answers.count(true, place);
        self.waited.add(waited);
        self.needed.add(needed);
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.answers.merge(&later.answers);
        self.waited.merge(&later.waited);
        self.needed.merge(&later.needed);
    }
}
