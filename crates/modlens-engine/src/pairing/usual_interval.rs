//! How long a master usually waits from a request to the next one, where the first was answered.
//!
//! A master that asks in a fixed cycle, or so long after each response, asks the same again after a response that the tap has
//! missed, just as after one that it has seen. Where that is sooner than nearly all masters give up, it is no retry: timeouts
//! are spread over two powers of ten, so that hardly one in twenty is within the few milliseconds of a cycle. A unit that is
//! dead is silent to every request, so that only some such requests in a row are explained like this: fewer than one in
//! 10,000 rows of a tap that misses as many as this one does.

use crate::pairing::interval::interval;
use modlens_protocol::Ns;

/// Intervals that are kept.
const KEPT: usize = 8;

/// Intervals that differ by more than one part in so many of their mean are no cycle.
const MAX_SPREAD_PART: Ns = 2;

/// Further ones may lie outside of those that are kept by half of what these differ by, and by one part in so many.
const MARGIN_PART: Ns = 10;

/// The same of intervals that are nearly equal.
const MAX_EXACT_SPREAD_PART: Ns = 20;
const EXACT_MARGIN_PART: Ns = 50;

/// So many intervals tell how long the master waits.
const MIN_INTERVALS: u32 = 3;

/// A row of missed responses is believed while a tap that misses this line's share has it more often than this.
const LEAST_ODDS_OF_ROW: f64 = 1e-4;

/// The least and the greatest number of responses in a row that may be missed, whatever their share.
const MAX_MISSED_IN_A_ROW: [u32; 2] = [5, 16];

/// A tap that has heard so many responses in a row misses none: of one that misses one in twenty, one in 200 has such a row.
const HEARD_BY_GOOD_TAP: u32 = 100;

/// The intervals from answered requests to the next ones.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct UsualInterval {
    last_request_end: Option<Ns>,
    /// The last intervals, the newest at `seen - 1`, modulo their number.
    last: [Ns; KEPT],
    /// How many intervals there were.
    seen: u32,
    /// How many requests in a row had no response and were followed after the usual interval.
    missed: u32,
    /// How many such requests were followed by one with a response.
    missed_before: u32,
    /// How many requests had a response.
    answered: u32,
    /// How many requests in a row had a response, up to now.
    heard: u32,
}

impl UsualInterval {
    /// Learns from a request that begins and ends at these times; `follows_response` says that the one before was answered.
    #[inline]
    pub fn add_request(&mut self, start: Option<Ns>, end: Option<Ns>, follows_response: bool) {
        if follows_response {
            self.missed_before = self.missed_before.saturating_add(std::mem::take(&mut self.missed));
            self.answered = self.answered.saturating_add(1);
            self.heard = self.heard.saturating_add(1);
            if let Some(interval) = interval(self.last_request_end, start) {
                self.last[self.seen as usize % KEPT] = interval;
                self.seen = self.seen.saturating_add(1);
            }
        }
        self.last_request_end = end;
    }

    /// Counts a request without response, and returns whether the next one came after the usual time. `waited` is from its end
    /// to the start of the next one, sooner than a master gives up.
    pub fn is_missed_response(&mut self, waited: Ns) -> bool {
        self.missed += 1;
        let hears_all = std::mem::take(&mut self.heard) >= HEARD_BY_GOOD_TAP;
        self.may_go_on() && !hears_all && self.is_usual(waited)
    }

    /// Whether as many responses in a row may be missed as have not been heard now.
    pub fn may_go_on(&self) -> bool {
        self.missed <= self.most_missed()
    }

    /// Whether the line has shown enough intervals to tell a timeout as short as one of them from a response that was missed.
    pub fn is_known(&self) -> bool {
        self.seen >= MIN_INTERVALS
    }

    /// Whether the master waits as long as this after a response.
    pub fn is_usual(&self, waited: Ns) -> bool {
        self.is_among(waited, MAX_SPREAD_PART, MARGIN_PART)
    }

    /// Whether it always waits for nearly the same time, and for this one.
    pub fn is_exactly_usual(&self, waited: Ns) -> bool {
        self.is_among(waited, MAX_EXACT_SPREAD_PART, EXACT_MARGIN_PART)
    }

    /// Whether a wait is among the intervals that are kept, given the parts of their mean that they may differ by, and by which it
    /// may lie outside.
    fn is_among(&self, waited: Ns, spread_part: Ns, margin_part: Ns) -> bool {
        let mut kept = self.last;
        let kept = &mut kept[..KEPT.min(self.seen as usize)];
        kept.sort_unstable();
        // Where a request was not heard either, an interval is twice as long.
        let (Some(&least), Some(&most)) = (kept.first(), kept.get(3 * kept.len() / 4)) else { return false };
        let (middle, spread) = (least.midpoint(most), most - least);
        let margin = spread / 2 + middle / margin_part;
        spread <= middle / spread_part && (least - margin..=most + margin).contains(&waited)
    }

    /// How many responses in a row this tap may miss. The row that has not ended yet does not count: the unit may have died.
    fn most_missed(&self) -> u32 {
        let share = f64::from(self.missed_before + 1) / f64::from(self.missed_before + self.answered + 2);
        let [least, most] = MAX_MISSED_IN_A_ROW;
        ((LEAST_ODDS_OF_ROW.ln() / share.ln()) as u32).clamp(least, most)
    }
}
