//! Whether the adapter of a line echoes its own transmissions, so that every request appears twice.

use crate::ones::add_ones;

/// A line has echo if more than this share of its requests appears twice, and has none if the share is below the other.
const MIN_SHARE_WITH_ECHO: f32 = 0.65;
const MAX_SHARE_WITHOUT_ECHO: f32 = 0.5;

/// The share of requests that appear twice: the prior, and the weight of the newest request once many were seen.
const PRIOR_ECHO_SHARE: f32 = 0.1;
const ECHO_LEARNING_RATE: f32 = 0.05;

/// A smaller share is set to 0: arithmetic on denormal numbers takes a processor a hundred times as long.
const MIN_NORMAL_SHARE: f32 = 1e-12;

/// Estimates the share of requests that appear twice in a row on this line.
///
/// If the adapter echoes its own transmissions, it is close to 1; if the master merely retries after timeouts, it is far
/// lower. Requests whose response is identical to the request are not counted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EchoStatistics {
    /// The share, without the last request.
    share: f32,
    requests: f32,
    /// Whether the last request has appeared twice by now; `None` before the first one.
    pub(super) last_appeared_twice: Option<bool>,
}

impl Default for EchoStatistics {
    fn default() -> Self {
        Self { share: PRIOR_ECHO_SHARE, requests: 1.0, last_appeared_twice: None }
    }
}

impl EchoStatistics {
    /// Counts a new request. The one before it is final now: it will not appear again.
    #[inline]
    pub(crate) fn add_request(&mut self) {
        let share = self.share_with_last();
        self.share = if share < MIN_NORMAL_SHARE { 0.0 } else { share };
        self.requests += f32::from(u8::from(self.last_appeared_twice.is_some()));
        self.last_appeared_twice = Some(false);
    }

    /// Counts as many new requests.
    pub(crate) fn add_requests(&mut self, mut requests: u32) {
        while requests > 0 && !self.is_settled() {
            self.add_request();
            requests -= 1;
        }
        add_ones(&mut self.requests, requests);
    }

    /// Whether one more request changes nothing but the number of requests: no request has appeared twice for so long that the
    /// share has become 0.
    fn is_settled(self) -> bool {
        self.share == 0.0 && self.last_appeared_twice == Some(false) && self.has_constant_rate()
    }

    fn has_constant_rate(self) -> bool {
        self.requests >= 1.0 / ECHO_LEARNING_RATE
    }

    /// The share, the last request included as it is now: a plain mean at first, a running mean later.
    fn share_with_last(self) -> f32 {
        let last = self.last_appeared_twice.map_or(self.share, |twice| f32::from(u8::from(twice)));
        // A division for every request would be measurable, so there is none once the rate is constant.
        let rate =
            if self.has_constant_rate() { ECHO_LEARNING_RATE } else { (1.0 / (self.requests + 1.0)).max(ECHO_LEARNING_RATE) };
        self.share + (last - self.share) * rate
    }

    /// Whether the line has echo; `None` while that is undecided.
    pub(super) fn has_echo(self) -> Option<bool> {
        let share = self.share_with_last();
        (share > MIN_SHARE_WITH_ECHO).then_some(true).or((share < MAX_SHARE_WITHOUT_ECHO).then_some(false))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn requests_are_added_as_one_by_one(runs in prop::collection::vec((0u32..2000, any::<bool>()), 1..6)) {
            let (mut at_once, mut one_by_one) = (EchoStatistics::default(), EchoStatistics::default());
            for (requests, appears_twice) in runs {
                at_once.add_requests(requests);
                (0..requests).for_each(|_| one_by_one.add_request());
                let bits = |share: EchoStatistics| (share.share.to_bits(), share.requests.to_bits(), share.last_appeared_twice);
                prop_assert_eq!(bits(at_once), bits(one_by_one));
                if appears_twice {
                    (at_once.last_appeared_twice, one_by_one.last_appeared_twice) = (Some(true), Some(true));
                }
            }
        }
    }
}
