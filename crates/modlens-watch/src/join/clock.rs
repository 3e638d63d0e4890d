//! How two clocks differ, from delays that cannot be negative.
//!
//! A gateway sends a request on the line after it received it, and returns a response after the line has carried it. With
//! `f` the time on the line's clock minus that on the network's clock for the requests, and `g` for the responses, the true
//! difference is at most every `f` and at least every `g`, as far as the recordings' own times are right. They are not: a tap
//! notes when a read returned, which is late by up to [`LATENESS`]. So the interval is made of what most exchanges say:
//!
//! - the drift is the slope of the lowest `f`, and of `g`, of each few exchanges (`envelope`); a line between the lower hull of
//!   all `f` and the upper hull of all `g`, both moved by the lateness, has to have it as well (`hull`);
//! - the offset is at most the lowest `f` and at least the lowest quarter of `g`: three exchanges of four may be late by more
//!   than the gateway takes.

use std::collections::VecDeque;

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use super::envelope::Envelope;
use super::hull::Hulls;

/// Matched pairs from which the difference right now is taken.
const RECENT: usize = 256;

/// With fewer pairs the first difference is kept as far as they permit: two that a busy gateway held back for long say little.
const SETTLED: usize = 16;

/// By so much times of one recording may be late: USB adapters and drivers hold bytes back for up to 16 ms.
pub(super) const LATENESS: Ns = 20_000_000;

/// Of 16 sorted `g`, which one is taken.
const LOW_QUARTER: usize = 3;

/// Bounds of the difference of the two clocks.
#[derive(Debug)]
pub(super) struct ClockPair {
    /// Of all `f` and `g`: time in seconds since the first pair, difference in seconds.
    hulls: Hulls,
    requests: Envelope,
    responses: Envelope,
    /// `f` and `g` of the latest pairs.
    recent: VecDeque<(Ns, Ns)>,
    /// Time and difference from which seconds are counted, so that floats keep nanoseconds.
    origin: Option<(Ns, Ns)>,
    last: f64,
    offset: Ns,
}

impl Default for ClockPair {
    fn default() -> Self {
        Self::new(0)
    }
}

impl ClockPair {
    /// Begins with a difference that is right to within the lateness of times.
    pub fn new(offset: Ns) -> Self {
        Self {
            hulls: Hulls::default(),
            requests: Envelope::new(0),
            responses: Envelope::new(LOW_QUARTER),
            recent: VecDeque::new(),
            origin: None,
            last: 0.0,
            offset,
        }
    }

    /// The difference right now: time on the line's clock minus time on the network's clock.
    pub fn offset(&self) -> Ns {
        self.offset
    }

    /// Adds a pair that is certain: the differences of its request and of its response, and its time on the network.
    pub fn add(&mut self, time: Ns, request: Ns, response: Ns) {
        self.recent.push_back((request, response));
        if self.recent.len() > RECENT {
            self.recent.pop_front();
        }
        let most = self.recent.iter().map(|pair| pair.0).min().unwrap_or(request);
        let least = self.recent.iter().map(|pair| pair.1).max().unwrap_or(response);
        self.offset = if self.recent.len() < SETTLED && least <= most {
            self.offset.clamp(least, most)
        } else {
            least + (most - least) / 2
        };
        let (first, base) = *self.origin.get_or_insert((time, request));
        let at = (time - first) as f64 / 1e9;
        let [request, response] = [request, response].map(|difference| (difference - base) as f64 / 1e9);
        self.requests.add(at, request);
        self.responses.add(at, response);
        // Hulls grow at their end only.
        if at >= self.last {
            self.last = at;
            self.hulls.add(at, request, response);
        }
    }

    /// `{offset_s, offset_error_s, drift_ppm, drift_error_ppm, at_ns, is_straight}`; null without a pair.
    ///
    /// The offset is that in the middle of the recording. The drift is null where the pairs are too few. `is_straight` is false
    /// where no straight line fits: one of the clocks was set.
    pub fn json(&self) -> Json {
        let Some((first, base)) = self.origin else { return Json::Null };
        let middle = self.last / 2.0;
        let bounds = self.hulls.slopes(LATENESS as f64 / 1e9);
        let drift = self.drift(bounds);
        let slope = drift.map_or(0.0, |(least, most)| f64::midpoint(least, most));
        let (value, error) = self.difference(middle, slope);
        json!({
            "offset_s": base as f64 / 1e9 + value, "offset_error_s": error,
            "drift_ppm": drift.map(|_| slope * 1e6), "drift_error_ppm": drift.map(|(least, most)| (most - least) / 2.0 * 1e6),
            "at_ns": first + (middle * 1e9) as Ns,
            "is_straight": bounds.0 <= bounds.1,
        })
    }

    /// The least and the greatest drift: those of both envelopes, within the bounds.
    fn drift(&self, bounds: (f64, f64)) -> Option<(f64, f64)> {
        let (requests, responses) = (self.requests.slope()?, self.responses.slope()?);
        let (least, most) = (requests.0.min(responses.0), requests.2.max(responses.2));
        let bounded = (least.max(bounds.0), most.min(bounds.1));
        Some(if bounded.0 <= bounded.1 { bounded } else { (least, most) })
    }

    /// The difference at a time, and by how much it can be otherwise.
    fn difference(&self, at: f64, slope: f64) -> (f64, f64) {
        let most = self.requests.value_at(at, slope).unwrap_or(0.0);
        let least = self.responses.value_at(at, slope).unwrap_or(most);
        // Responses that were back before the line had them: its times are late.
        let least = if least <= most { least } else { most - LATENESS as f64 / 1e9 };
        (f64::midpoint(least, most), (most - least) / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Ns = 1_700_000_000_000_000_000;
    const SHIFT: Ns = 3_000_000_000;

    /// Numbers that look random, each below a bound.
    struct Chance(u64);

    impl Chance {
        fn below(&mut self, bound: Ns) -> Ns {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) as Ns) % bound.max(1)
        }
    }

    /// Ten requests a second through a gateway whose delays grow by up to `queue`, for both ways, and a tap whose times are late
    /// by up to `late`; the line's clock is 3 s ahead and gains 50 ppm.
    fn pair_of_clocks(count: i64, queue: Ns, late: Ns, seed: u64) -> ClockPair {
        let (mut clocks, mut chance) = (ClockPair::new(SHIFT), Chance(seed));
        for number in 0..count {
            let since = number * 100_000_000;
            let difference = SHIFT + since / 20_000;
            let request = difference + 1_000_000 + chance.below(queue) + chance.below(late);
            let response = difference - 2_000_000 - chance.below(queue) + chance.below(late);
            clocks.add(START + since, request, response);
        }
        clocks
    }

    fn number(found: &Json, key: &str) -> f64 {
        found[key].as_f64().unwrap_or_else(|| panic!("{key}: {found}"))
    }

    #[test]
    fn the_truth_lies_in_the_stated_interval() {
        for (seed, count) in (1..40).zip([600, 6_000, 36_000].into_iter().cycle()) {
            for late in [0, 1_000_000, 16_000_000] {
                let found = pair_of_clocks(count, 8_000_000, late, seed).json();
                let middle = 3.0 + count as f64 * 0.1 / 2.0 * 50e-6;
                assert_eq!(found["is_straight"], true);
                assert!((number(&found, "offset_s") - middle).abs() <= number(&found, "offset_error_s"), "{late}: {found}");
                assert!((number(&found, "drift_ppm") - 50.0).abs() <= number(&found, "drift_error_ppm"), "{late}: {found}");
            }
        }
    }

    #[test]
    fn an_hour_says_the_drift_to_a_few_millionths() {
        let found = pair_of_clocks(36_000, 8_000_000, 1_000_000, 1).json();
        // Requests take 1 ms, three quarters of the responses at most 8 ms.
        assert!(number(&found, "offset_error_s") < 0.005, "{found}");
        assert!(number(&found, "drift_error_ppm") < 1.0, "{found}");
    }

    #[test]
    fn one_pair_bounds_the_offset_and_no_drift() {
        let found = pair_of_clocks(1, 1, 1, 1).json();
        assert!((number(&found, "offset_s") - 2.9995).abs() < 1e-6, "{found}");
        assert!((number(&found, "offset_error_s") - 0.0015).abs() < 1e-6, "{found}");
        assert_eq!(found["drift_ppm"], Json::Null);
    }

    #[test]
    fn the_first_pairs_of_a_busy_gateway_move_nothing() {
        let mut clocks = ClockPair::new(SHIFT);
        clocks.add(START, SHIFT + 139_000_000, SHIFT - 71_000_000);
        clocks.add(START + 100_000_000, SHIFT + 67_000_000, SHIFT - 10_000_000);
        assert_eq!(clocks.offset(), SHIFT);
        // What cannot be is given up.
        clocks.add(START + 200_000_000, SHIFT - 5_000_000, SHIFT - 9_000_000);
        assert_eq!(clocks.offset(), SHIFT - 5_000_000);
    }

    #[test]
    fn a_clock_that_was_set_is_not_straight() {
        let mut clocks = pair_of_clocks(1000, 8_000_000, 0, 1);
        clocks.add(START + 200_000_000_000, 4_000_000_000, 3_999_000_000);
        clocks.add(START + 201_000_000_000, 2_000_000_000, 1_999_000_000);
        assert_eq!(clocks.json()["is_straight"], false);
    }
}
