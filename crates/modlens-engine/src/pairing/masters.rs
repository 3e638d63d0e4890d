//! Evidence that two masters talk on one line.
//!
//! One master waits for its answer. A request inside another one's exchange, both of them answered, is the work of a
//! second master, or of a first one that gave up early and a unit that was late. A clock tells the two apart; without
//! one, a master that was seen to ask again after a time-out does not go on to another unit instead. Nothing is said
//! after one such meeting: a false alarm sends somebody to the site.

use modlens_protocol::Ns;

/// Meetings before anything is said, where the clock excludes a time-out.
const ENOUGH: u32 = 2;

/// The same where the master's retries do.
const ENOUGH_BY_HABIT: u32 = 3;

/// Retries that make a habit, and their number for each time that the master went on to another request.
const HABIT: u32 = 2;
const RETRIES_PER_LAPSE: u32 = 4;

/// Meetings that wait for more of them. The oldest are called late answers then.
const REMEMBERED: usize = 64;

/// An answer that came after another request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Meeting {
    /// The transaction whose answer it is.
    pub txn: u64,
    /// The frame of the answer.
    pub frame: u64,
    /// The unit that answered.
    pub unit: u8,
    /// Start of the answer.
    pub start: Option<Ns>,
    /// The request between: its transaction.
    pub other: u64,
    /// The clock excludes that the master gave up.
    pub clear: bool,
    /// Line or packet number, or the stream offset, of the answer.
    pub origin: u64,
}

/// What was seen of the masters.
#[derive(Clone, Debug, Default)]
pub(super) struct Masters {
    clear: u32,
    unclear: u32,
    retries: u32,
    lapses: u32,
    waiting: Vec<Meeting>,
    /// Something was seen since the last look for proofs.
    news: bool,
}

impl Masters {
    /// An unanswered request was followed by the same one, or by another one.
    pub(super) fn unanswered(&mut self, again: bool) {
        let count = if again { &mut self.retries } else { &mut self.lapses };
        *count = count.saturating_add(1);
        self.news = true;
    }

    /// A meeting with both answers.
    pub(super) fn met(&mut self, meeting: Meeting) {
        let count = if meeting.clear { &mut self.clear } else { &mut self.unclear };
        *count = count.saturating_add(1);
        self.news = true;
        if self.waiting.len() < REMEMBERED {
            self.waiting.push(meeting);
        }
    }

    fn proven(&self, clear: bool) -> bool {
        let habit = self.retries >= HABIT && self.retries >= RETRIES_PER_LAPSE * self.lapses;
        self.clear >= ENOUGH || (!clear && habit && self.clear + self.unclear >= ENOUGH_BY_HABIT)
    }

    /// The meetings that are proven by now, if any.
    pub(super) fn proofs(&mut self) -> Vec<Meeting> {
        self.news = false;
        if self.waiting.is_empty() {
            return Vec::new();
        }
        let (proven, waiting) = self.waiting.drain(..).collect::<Vec<_>>().into_iter().partition(|m| self.proven(m.clear));
        self.waiting = waiting;
        proven
    }

    /// Whether there is no proof to be found.
    pub(super) fn idle(&self) -> bool {
        !self.news || self.waiting.is_empty()
    }

    /// The meetings that were never proven: answers that came late.
    pub(super) fn rest(&mut self) -> Vec<Meeting> {
        std::mem::take(&mut self.waiting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meeting(txn: u64, clear: bool) -> Meeting {
        Meeting { txn, frame: 2 * txn, unit: 1, start: None, other: txn + 1, clear, origin: 0 }
    }

    #[test]
    fn one_meeting_is_none() {
        let mut masters = Masters::default();
        masters.met(meeting(5, true));
        assert!(masters.proofs().is_empty());
        masters.met(meeting(9, true));
        assert_eq!(masters.proofs().len(), 2, "the first one is told with hindsight");
        assert!(masters.rest().is_empty());
    }

    #[test]
    fn a_master_without_retries_and_a_slow_unit_are_no_second_master() {
        let mut masters = Masters::default();
        for txn in 0..40 {
            masters.unanswered(false);
            masters.met(meeting(3 * txn, false));
        }
        assert!(masters.proofs().is_empty());
        assert_eq!(masters.rest().len(), 40);
    }

    #[test]
    fn a_master_that_asks_again_does_not_go_on() {
        let mut masters = Masters::default();
        for _ in 0..8 {
            masters.unanswered(true);
        }
        masters.unanswered(false);
        (1..=2).for_each(|txn| masters.met(meeting(txn, false)));
        assert!(masters.proofs().is_empty());
        masters.met(meeting(3, false));
        assert_eq!(masters.proofs().len(), 3);
    }
}
