//! The times from a request to the next one like it, as long as all goes well, and beside failures.

use modlens_engine::durations::Durations;
use modlens_protocol::Ns;

/// When a request was sent, and whether it was answered at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sent {
    start: Ns,
    is_clean: bool,
}

/// Times between requests of the same content that went well.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycles {
    /// To the one after the next.
    pub two: Durations,
    /// To the next one: the last before each run of failures, and the first after it.
    pub beside_failures: Durations,
    /// The first two: what comes after them depends on nothing before.
    first: [Option<Sent>; 2],
    last: Option<Sent>,
    /// The time to the last one, if it and the one before it went well.
    last_time: Option<Ns>,
    /// Something failed since there was such a time.
    is_behind_failure: bool,
}

impl Cycles {
    /// Counts a request; one that was sent again is not clean.
    pub(super) fn count(&mut self, start: Ns, is_clean: bool) {
        let sent = Sent { start, is_clean };
        if let Some(place) = self.first.iter_mut().find(|place| place.is_none()) {
            *place = Some(sent);
        }
        self.follow(sent);
    }

    fn follow(&mut self, sent: Sent) {
        let last = self.last.replace(sent);
        if !sent.is_clean {
            if let Some(time) = self.last_time.take() {
                self.beside_failures.add(time);
            }
            self.is_behind_failure = true;
            return;
        }
        let time = last.filter(|last| last.is_clean && last.start < sent.start).map(|last| sent.start - last.start);
        if let (Some(time), Some(before)) = (time, self.last_time) {
            self.two.add(time + before);
        }
        if let Some(time) = time.filter(|_| std::mem::take(&mut self.is_behind_failure)) {
            self.beside_failures.add(time);
        }
        self.last_time = time;
    }

    /// Adds those of a later part of the recording.
    pub(super) fn merge(&mut self, later: &Self) {
        let [first, second] = later.first;
        for sent in [first, second].into_iter().flatten() {
            self.count(sent.start, sent.is_clean);
        }
        if second.is_some() {
            (self.last, self.last_time, self.is_behind_failure) = (later.last, later.last_time, later.is_behind_failure);
        }
        self.two.merge(&later.two);
        self.beside_failures.merge(&later.beside_failures);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cycles(all: &[(Ns, bool)]) -> Cycles {
        let mut cycles = Cycles::default();
        for (start, is_clean) in all {
            cycles.count(*start, *is_clean);
        }
        cycles
    }

    #[test]
    fn times_beside_failures_are_those_between_good_ones() {
        // Every 10, and every 10 again from 3 on; the one at 23 fails, and its master asks again 1 later.
        let all = [(0, true), (3, true), (10, true), (13, true), (20, true), (23, false), (24, true), (30, true), (33, true)];
        let whole = cycles(&all);
        assert_eq!(whole.two.range(), Some((9, 10)));
        // 13 to 20 before the failure; after it, 24 to 30.
        assert_eq!((whole.beside_failures.count, whole.beside_failures.range()), (2, Some((6, 7))));
        for cut in 0..=all.len() {
            let mut merged = cycles(&all[..cut]);
            merged.merge(&cycles(&all[cut..]));
            assert_eq!(merged, whole, "cut at {cut}");
        }
    }
}
