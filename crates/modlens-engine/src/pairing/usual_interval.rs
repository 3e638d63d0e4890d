//! How long a master usually waits from a request to the next one, where the first was answered.
//!
//! A master that asks in a fixed cycle asks the same again after a response that the tap has missed, just as after one that it
//! has seen. Where that is sooner than any master gives up, it is no retry. A unit that is dead is silent to every request, so
//! that only a few such requests in a row are explained like this.

use crate::pairing::interval::interval;
use modlens_protocol::Ns;

/// Intervals differ by at most one part in so many.
const MAX_DIFFERENCE_PART: Ns = 20;

/// So many intervals in a row are a cycle.
const MIN_INTERVALS: u32 = 3;

/// A tap that misses a third of the responses misses so many in a row about once in 1000 requests.
const MAX_MISSED_IN_A_ROW: u32 = 5;

/// A tap that has heard so many responses in a row misses none: of one that misses one in twenty, one in 200 has such a row.
const HEARD_BY_GOOD_TAP: u32 = 100;

/// The intervals from answered requests to the next ones.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct UsualInterval {
    last_request_end: Option<Ns>,
    interval: Ns,
    /// How many intervals in a row were about the same.
    count: u32,
    /// How many intervals there were.
    seen: u32,
    /// How many requests in a row had no response and were followed after the usual interval.
    missed: u32,
    /// How many requests in a row had a response, up to now.
    heard: u32,
}

impl UsualInterval {
    /// Learns from a request that begins and ends at these times; `follows_response` says that the one before was answered.
    #[inline]
    pub fn add_request(&mut self, start: Option<Ns>, end: Option<Ns>, follows_response: bool) {
        if follows_response {
            self.missed = 0;
            self.heard = self.heard.saturating_add(1);
            if let Some(interval) = interval(self.last_request_end, start) {
                self.count = if self.is_about(interval) { self.count + 1 } else { 1 };
                self.seen = self.seen.saturating_add(1);
                self.interval = interval;
            }
        }
        self.last_request_end = end;
    }

    /// Counts a request without response, and returns whether the next one came after the usual time. `waited` is from its end
    /// to the start of the next one, sooner than a master gives up.
    pub fn is_missed_response(&mut self, waited: Option<Ns>) -> bool {
        self.missed += 1;
        let hears_all = std::mem::take(&mut self.heard) >= HEARD_BY_GOOD_TAP;
        let is_cycle = self.count >= MIN_INTERVALS && self.missed <= MAX_MISSED_IN_A_ROW && !hears_all;
        waited.is_some_and(|waited| is_cycle && self.is_about(waited))
    }

    /// Whether the line has shown enough intervals to tell a timeout as short as one of them from a response that was missed.
    pub fn is_known(&self) -> bool {
        self.seen >= MIN_INTERVALS
    }

    fn is_about(&self, interval: Ns) -> bool {
        (interval - self.interval).abs() <= self.interval / MAX_DIFFERENCE_PART
    }
}
