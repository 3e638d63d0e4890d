//! How two clocks differ, from delays that cannot be negative.
//!
//! A gateway sends a request on the line after it received it, and returns a response after the line has carried it. With
//! `f` the time on the line's clock minus that on the network's clock for the requests, and `g` for the responses, the true
//! difference is at most every `f` and at least every `g`. As a function of time it is a straight line (offset and drift)
//! between the lower hull of all `f` and the upper hull of all `g`; the interval is what such lines reach.

use std::collections::VecDeque;

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

/// Matched pairs from which the difference right now is taken.
const RECENT: usize = 256;

/// By so much times of one recording may be late: USB adapters and drivers hold bytes back for up to 16 ms.
pub(super) const LATENESS: Ns = 20_000_000;

/// Corners of a hull that are kept; more would be a clock that does not run evenly.
const MAX_CORNERS: usize = 512;

/// Bounds of the difference of the two clocks.
#[derive(Debug, Default)]
pub(super) struct ClockPair {
    /// Lower hull of `f`, upper hull of `g`: time in seconds since the first pair, difference in seconds.
    upper: Vec<(f64, f64)>,
    lower: Vec<(f64, f64)>,
    /// `f` and `g` of the latest pairs.
    recent: VecDeque<(Ns, Ns)>,
    /// Time and difference from which hulls are counted, so that floats keep nanoseconds.
    origin: Option<(Ns, Ns)>,
    last: f64,
    offset: Ns,
}

impl ClockPair {
    /// Begins with a difference that is right to within the lateness of times.
    pub fn new(offset: Ns) -> Self {
        Self { offset, ..Self::default() }
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
        self.offset = least + (most - least) / 2;
        let (first, base) = *self.origin.get_or_insert((time, request));
        let at = (time - first) as f64 / 1e9;
        // Hulls grow at their end only.
        if at >= self.last {
            self.last = at;
            push(&mut self.upper, (at, (request - base) as f64 / 1e9), 1.0);
            push(&mut self.lower, (at, (response - base) as f64 / 1e9), -1.0);
        }
    }

    /// `{offset_s, offset_error_s, drift_ppm, drift_error_ppm, at_ns, is_straight}`; null without a pair.
    ///
    /// The offset is that in the middle of the recording. Where no straight line fits (clocks were set, or times are late),
    /// `is_straight` is false and the errors are what is missing.
    pub fn json(&self) -> Json {
        let Some((first, base)) = self.origin else { return Json::Null };
        let middle = self.last / 2.0;
        let drift = self.slopes();
        let here = self.values(middle);
        let (value, error) = (f64::midpoint(here.0, here.1), (here.1 - here.0).abs() / 2.0);
        let (slope, slope_error) = (f64::midpoint(drift.0, drift.1), (drift.1 - drift.0).abs() / 2.0);
        let known = |number: f64| if number.is_finite() { json!(number) } else { Json::Null };
        json!({
            "offset_s": base as f64 / 1e9 + value, "offset_error_s": error,
            "drift_ppm": known(slope * 1e6), "drift_error_ppm": known(slope_error * 1e6),
            "at_ns": first + (middle * 1e9) as Ns,
            "is_straight": here.0 <= here.1 && drift.0 <= drift.1,
        })
    }

    /// The least and the greatest drift of a line between the hulls.
    fn slopes(&self) -> (f64, f64) {
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        for (at, low) in &self.lower {
            for (other, high) in &self.upper {
                let slope = (high - low) / (other - at);
                if other > at {
                    most = most.min(slope);
                } else if other < at {
                    least = least.max(slope);
                }
            }
        }
        (least, most)
    }

    /// The least and the greatest difference that a line between the hulls has at a time.
    fn values(&self, at: f64) -> (f64, f64) {
        let least = beyond(&self.lower, &self.upper, at, -1.0);
        (-least, beyond(&self.upper, &self.lower, at, 1.0))
    }
}

/// The bound at a time from one hull: on its own line there, or on one that leans on a corner of the other hull.
/// With sign -1 everything is mirrored.
fn beyond(hull: &[(f64, f64)], other: &[(f64, f64)], at: f64, sign: f64) -> f64 {
    let mut bound = f64::INFINITY;
    for pair in hull.windows(2) {
        let [(x, y), (x2, y2)] = [pair[0], pair[1]];
        if (x..=x2).contains(&at) && x2 > x {
            bound = bound.min(sign * (y + (y2 - y) * (at - x) / (x2 - x)));
        }
    }
    for (x, y) in hull {
        if (x - at).abs() < 1e-9 {
            bound = bound.min(sign * y);
        }
        for (pivot, value) in other {
            // From a corner of the other hull past one of this hull, on to the time in question.
            if (pivot < x && *x < at) || (at < *x && x < pivot) {
                bound = bound.min(sign * (y + (y - value) * (at - x) / (x - pivot)));
            }
        }
    }
    bound
}

/// Appends a corner to the lower hull, or with sign -1 to the upper one.
fn push(hull: &mut Vec<(f64, f64)>, corner: (f64, f64), sign: f64) {
    if let Some(last) = hull.last().copied().filter(|last| last.0 >= corner.0) {
        if sign * (last.1 - corner.1) <= 0.0 {
            return;
        }
        hull.pop();
    }
    while let [.., a, b] = hull[..] {
        if sign * ((b.1 - a.1) * (corner.0 - a.0) - (corner.1 - a.1) * (b.0 - a.0)) < 0.0 {
            break;
        }
        hull.pop();
    }
    if hull.len() < MAX_CORNERS {
        hull.push(corner);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Requests arrive 1 to 9 ms later, responses 2 to 8 ms; the line's clock is 3 s ahead and gains 50 ppm.
    fn pair_of_clocks(count: i64) -> ClockPair {
        let mut clocks = ClockPair::new(3_000_000_000);
        for number in 0..count {
            let time = 1_700_000_000_000_000_000 + number * 100_000_000;
            let difference = 3_000_000_000 + number * 100_000_000 / 20_000;
            let delay = 1_000_000 + number * 7_919 % 8 * 1_000_000;
            let back = 2_000_000 + number * 104_729 % 7 * 1_000_000;
            clocks.add(time, difference + delay, difference - back);
        }
        clocks
    }

    #[test]
    fn the_true_line_lies_in_the_stated_interval() {
        let found = pair_of_clocks(36_000).json();
        let number = |key: &str| found[key].as_f64().unwrap();
        assert_eq!(found["is_straight"], true);
        // In the middle of the hour the drift has made 90 ms.
        assert!((number("offset_s") - 3.09).abs() <= number("offset_error_s"), "{found}");
        assert!(number("offset_error_s") < 0.002, "{found}");
        assert!((number("drift_ppm") - 50.0).abs() <= number("drift_error_ppm"), "{found}");
        assert!(number("drift_error_ppm") < 1.0, "{found}");
    }

    #[test]
    fn one_pair_bounds_the_offset_and_no_drift() {
        let found = pair_of_clocks(1).json();
        assert!((found["offset_s"].as_f64().unwrap() - 2.9995).abs() < 1e-6, "{found}");
        assert_eq!(found["drift_ppm"], Json::Null);
    }

    #[test]
    fn a_clock_that_was_set_is_not_straight() {
        let mut clocks = pair_of_clocks(1000);
        clocks.add(1_700_000_000_000_000_000 + 200_000_000_000, 4_000_000_000, 3_999_000_000);
        clocks.add(1_700_000_000_000_000_000 + 201_000_000_000, 2_000_000_000, 1_999_000_000);
        assert_eq!(clocks.json()["is_straight"], false);
    }
}
