//! Whether the adapter of a line echoes its own transmissions, so that every request appears twice.

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
/// If the adapter echoes its own transmissions, it is close to 1; if the master merely retries after time-outs, it is far
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

    /// The share, the last request included as it is now: a plain mean at first, a running mean later.
    fn share_with_last(self) -> f32 {
        let last = self.last_appeared_twice.map_or(self.share, |twice| f32::from(u8::from(twice)));
        // A division for every request would be measurable, so there is none once the rate is constant.
        let is_constant = self.requests >= 1.0 / ECHO_LEARNING_RATE;
        let rate = if is_constant { ECHO_LEARNING_RATE } else { (1.0 / (self.requests + 1.0)).max(ECHO_LEARNING_RATE) };
        self.share + (last - self.share) * rate
    }

    /// Whether the line has echo; `None` while that is undecided.
    pub(super) fn has_echo(self) -> Option<bool> {
        let share = self.share_with_last();
        (share > MIN_SHARE_WITH_ECHO).then_some(true).or((share < MAX_SHARE_WITHOUT_ECHO).then_some(false))
    }
}
