//! Evidence that two masters talk on one line.
//!
//! A master waits for the response before it sends its next request. If a request arrives inside another transaction and
//! both are answered, either a second master sent it, or the only master gave up early and the unit answered late. The
//! clock distinguishes the two where the request came sooner than any master gives up. Without a clock the habit of the
//! master does: one that was seen to retry after timeouts does not turn to another unit instead. One such overlap is
//! never reported, because a false alarm sends somebody to the site.

use crate::transactions::result::Overlap;

/// Overlaps before two masters are reported, where the clock excludes a timeout.
const MIN_TIMED_OVERLAPS: u32 = 2;

/// Overlaps before two masters are reported, where only the master's habit to retry excludes a timeout.
const MIN_OVERLAPS_OF_RETRYING_MASTER: u32 = 3;

/// Retries that make a habit, and how many there must be for each timeout after which the master sent another request.
const MIN_RETRIES: u32 = 2;
const MIN_RETRIES_PER_SKIP: u32 = 4;

/// Overlaps that wait for further evidence. Those beyond it are counted, but get no finding.
const MAX_UNDECIDED_OVERLAPS: usize = 64;

/// What the recording has shown of the masters' habits.
#[derive(Clone, Debug, Default)]
pub(crate) struct MasterEvidence {
    /// Overlaps for which the clock excludes a timeout.
    timed_overlaps: u32,
    /// Overlaps for which it does not.
    untimed_overlaps: u32,
    /// Unanswered requests that were sent again.
    retries: u32,
    /// Unanswered requests that were followed by another request.
    skips: u32,
    /// Overlaps that are not reported yet.
    undecided: Vec<Overlap>,
    /// Something was counted since `take_proven` was last called.
    has_new_evidence: bool,
}

impl MasterEvidence {
    /// Counts an unanswered request: `was_retried` if the same request followed it, else another one did.
    pub(super) fn add_timeout(&mut self, was_retried: bool) {
        let count = if was_retried { &mut self.retries } else { &mut self.skips };
        *count = count.saturating_add(1);
        self.has_new_evidence = true;
    }

    /// Counts two overlapping transactions that both have their response.
    pub(super) fn add_overlap(&mut self, overlap: Overlap) {
        let count = if overlap.timeout_excluded { &mut self.timed_overlaps } else { &mut self.untimed_overlaps };
        *count = count.saturating_add(1);
        self.has_new_evidence = true;
        if self.undecided.len() < MAX_UNDECIDED_OVERLAPS {
            self.undecided.push(overlap);
        }
    }

    /// Whether unanswered requests are nearly always sent again.
    pub(super) fn retries_by_habit(&self) -> bool {
        self.retries >= MIN_RETRIES && self.retries >= MIN_RETRIES_PER_SKIP * self.skips
    }

    /// Whether unanswered requests are nearly always followed by another request.
    pub(super) fn skips_by_habit(&self) -> bool {
        self.skips >= MIN_RETRIES && self.skips >= MIN_RETRIES_PER_SKIP * self.retries
    }

    /// Whether an overlap is by now certain to be the work of two masters. `timeout_excluded`: the clock shows that the
    /// master had not given up yet.
    ///
    /// Two overlaps of that kind prove all others as well. Without them, three overlaps of any kind prove those that the clock
    /// does not exclude, if the master retries by habit: at least twice, and four times as often as it goes on to another
    /// request.
    fn is_proven(&self, timeout_excluded: bool) -> bool {
        let overlaps = self.timed_overlaps + self.untimed_overlaps;
        self.timed_overlaps >= MIN_TIMED_OVERLAPS
            || (!timeout_excluded && self.retries_by_habit() && overlaps >= MIN_OVERLAPS_OF_RETRYING_MASTER)
    }

    /// The overlaps that are proven by now; each is returned once, and the others go on waiting.
    pub(super) fn take_proven(&mut self) -> Vec<Overlap> {
        self.has_new_evidence = false;
        if self.undecided.is_empty() {
            return Vec::new();
        }
        let all = self.undecided.drain(..).collect::<Vec<_>>();
        let (proven, undecided) = all.into_iter().partition(|overlap| self.is_proven(overlap.timeout_excluded));
        self.undecided = undecided;
        proven
    }

    /// Whether `take_proven` has nothing to return.
    pub(crate) fn is_idle(&self) -> bool {
        !self.has_new_evidence || self.undecided.is_empty()
    }

    /// The overlaps that were never proven, at the end of the recording: their responses are taken to be late ones.
    pub(super) fn take_undecided(&mut self) -> Vec<Overlap> {
        std::mem::take(&mut self.undecided)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transactions::result::FrameLocation;

    fn overlap(txn: u64, timeout_excluded: bool) -> Overlap {
        let response = FrameLocation { txn, frame: 2 * txn, unit: 1, start: None, origin: 0 };
        Overlap { response, later_txn: txn + 1, timeout_excluded }
    }

    #[test]
    fn two_timed_overlaps_are_needed_for_a_proof() {
        let mut masters = MasterEvidence::default();
        masters.add_overlap(overlap(5, true));
        assert!(masters.take_proven().is_empty());
        masters.add_overlap(overlap(9, true));
        assert_eq!(masters.take_proven().len(), 2, "the second overlap proves the first one, too");
        assert!(masters.take_undecided().is_empty());
    }

    #[test]
    fn a_master_without_retries_and_a_slow_unit_are_not_two_masters() {
        let mut masters = MasterEvidence::default();
        for txn in 0..40 {
            masters.add_timeout(false);
            masters.add_overlap(overlap(3 * txn, false));
        }
        assert!(masters.take_proven().is_empty());
        assert_eq!(masters.take_undecided().len(), 40);
    }

    #[test]
    fn three_overlaps_prove_a_second_master_where_the_first_one_always_retries() {
        let mut masters = MasterEvidence::default();
        for _ in 0..8 {
            masters.add_timeout(true);
        }
        masters.add_timeout(false);
        (1..=2).for_each(|txn| masters.add_overlap(overlap(txn, false)));
        assert!(masters.take_proven().is_empty());
        masters.add_overlap(overlap(3, false));
        assert_eq!(masters.take_proven().len(), 3);
    }
}
