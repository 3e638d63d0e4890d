//! The timing of a bus: how soon its units respond, and how long its master waits before it gives up.
//!
//! All statistics are kept over the natural logarithm of times, because response times scatter by factors.

use modlens_protocol::direction::TimeoutLogOdds;
use modlens_protocol::Ns;

/// However well a silence fits a timeout or a response, it never counts for more than this.
const MAX_TIMING_EVIDENCE_BITS: f64 = 20.0;

/// Before any response time was seen, it is expected to be this ...
const PRIOR_RESPONSE_NS: f64 = 12e6;
/// ... with this standard deviation of its logarithm.
const PRIOR_RESPONSE_LOG_SPREAD: f64 = 1.2;

/// A response that comes in one read with its request is taken to have come after this time: adapters hold bytes back for at
/// most 10 to 16 ms.
const HIDDEN_RESPONSE_NS: Ns = 6_000_000;

/// Before any was seen, the silence between a response and the next request is expected to be this ...
const PRIOR_POLL_NS: f64 = 100e6;
/// ... with this standard deviation of its logarithm.
const PRIOR_POLL_LOG_SPREAD: f64 = 1.5;

/// Standard deviation of the logarithm of the silence before requests, once some were seen.
const POLL_LOG_SPREAD: f64 = 0.7;

/// A response that equals its request teaches response times only where the silence before it says by so many bits that it is
/// one. A weaker claim might teach what it claims.
const CLEAR_RESPONSE_BITS: f32 = -3.0;

/// Standard deviation of the logarithm of response times: units differ by a factor of about two, and so do functions.
const RESPONSE_LOG_SPREAD: f64 = 0.7;

/// Least standard deviation of the logarithm of the master's timeout. It is a constant, but the times it is learned
/// from are late by what the adapter holds bytes back.
const MIN_TIMEOUT_LOG_SPREAD: f64 = 0.12;

/// Standard deviation of the logarithm of the timeout before it was seen; the greatest one later.
const PRIOR_TIMEOUT_LOG_SPREAD: f64 = 0.5;

/// The natural logarithm of eight: silences of less than an eighth of the typical response time are no evidence.
const LN_8: f64 = 2.079;

/// Before any timeout was seen, it is expected to take at least so many typical response times.
const PRIOR_TIMEOUT_IN_RESPONSE_TIMES: f64 = 30.0;

/// The expected timeout before any was seen is at most this, unless the silence at hand is shorter.
const MAX_PRIOR_TIMEOUT_NS: f64 = 1e9;

/// Weight of the newest response time in the running mean.
const LEARNING_RATE: f64 = 0.1;

/// Timeouts over which the median is taken.
const KEPT_TIMEOUTS: usize = 9;

/// Timeouts that must have been seen before the median is used.
const MIN_TIMEOUTS: usize = 2;

/// Greatest typical distance from the median, in natural logarithms, with which the master's timeout counts as known.
const MAX_TIMEOUT_LOG_SCATTER: f64 = 0.3;

/// A request is given up after so many times the master's own timeout ...
const TIMEOUT_FACTOR: f64 = 1.5;
/// ... or so many times the longest response time, whichever is longer.
const LONGEST_RESPONSE_FACTOR: f64 = 2.0;

/// The longest response time decays by this factor with every response.
const LONGEST_DECAY: f64 = 0.999;

/// How much earlier than its request a response may be seen, where two lines are read by adapters that hold bytes back:
/// before anything was observed, and at most. Latency timers take 16 ms, schedulers and serial servers far more.
const PRIOR_SKEW_NS: f64 = 60e6;
const MAX_SKEW_NS: f64 = 150e6;

/// The bound on the skew is so many times the greatest one observed.
const SKEW_MARGIN: f64 = 2.0;

/// That bound decays by this factor with every transaction.
const SKEW_DECAY: f64 = 0.996;

/// Moves a running mean of the logarithm of a time towards a further observation.
fn update_log_mean(mean: &mut Option<f64>, ns: Ns) {
    let log = log_of(ns);
    match mean {
        Some(mean) => *mean += (log - *mean) * LEARNING_RATE,
        None => *mean = Some(log),
    }
}

/// A time that is constant but for accidents: the median of the last few observations, which accidents do not move.
#[derive(Clone, Copy, Debug, Default)]
struct LogMedian {
    last: [f64; KEPT_TIMEOUTS],
    observations: usize,
    median: f64,
    /// Median distance from the median.
    scatter: f64,
}

impl LogMedian {
    fn add(&mut self, ns: Ns) {
        self.last[self.observations % KEPT_TIMEOUTS] = (ns.max(1) as f64).ln();
        self.observations += 1;
        let kept = self.observations.min(KEPT_TIMEOUTS);
        let median_of = |mut values: [f64; KEPT_TIMEOUTS]| {
            values[..kept].sort_by(f64::total_cmp);
            values[kept / 2]
        };
        self.median = median_of(self.last);
        self.scatter = median_of(self.last.map(|log| (log - self.median).abs()));
    }

    /// Median and scatter, once there are so many observations.
    fn known_after(&self, observations: usize) -> Option<(f64, f64)> {
        (self.observations >= observations).then_some((self.median, self.scatter))
    }
}

/// The response times and timeouts that a bus has shown.
#[derive(Clone, Copy, Debug, Default)]
pub struct TimingModel {
    /// Running mean of the logarithm of the response time.
    response_log_mean: Option<f64>,
    /// Running mean of the logarithm of the silence between a response and the next request, if that is a write which its
    /// response repeats: there it is needed.
    poll_log_mean: Option<f64>,
    /// The longest response time in ns, decaying.
    longest_response: f64,
    /// From the end of an unanswered request to its retry.
    retry_after: LogMedian,
    /// From the end of an unanswered request to another request.
    skip_after: LogMedian,
    /// How much earlier than its request a response may be seen, in ns.
    max_skew: Option<f64>,
}

impl TimingModel {
    /// Learns from a response time.
    pub(crate) fn record_response_time(&mut self, ns: Ns) {
        update_log_mean(&mut self.response_log_mean, ns);
        self.longest_response = (self.longest_response * LONGEST_DECAY).max(ns as f64);
    }

    /// Learns from the time to a response that equals its request, if it cannot be a retry.
    pub(crate) fn record_mirrored_response_time(&mut self, ns: Ns) {
        if self.timeout_log_odds(Some(ns)) <= CLEAR_RESPONSE_BITS {
            self.record_response_time(ns);
        }
    }

    /// Learns from a response that equals its request and came in the same read: the adapter hides so short a time.
    pub(crate) fn record_hidden_response_time(&mut self) {
        update_log_mean(&mut self.response_log_mean, HIDDEN_RESPONSE_NS);
    }

    /// Learns from the silence before a write that its response repeats, while nothing was outstanding.
    pub(crate) fn record_poll_pause(&mut self, ns: Ns) {
        update_log_mean(&mut self.poll_log_mean, ns);
    }

    /// Learns how far the clocks of two lines are apart, from the end of a request and the start of its response.
    pub(super) fn record_skew(&mut self, request_end: Ns, response_start: Ns) {
        let known = self.max_skew.unwrap_or(PRIOR_SKEW_NS) * SKEW_DECAY;
        self.max_skew = Some(known.max(SKEW_MARGIN * (request_end - response_start) as f64).min(MAX_SKEW_NS));
    }

    /// How much earlier than its request a response may be seen.
    pub fn max_skew(&self) -> Ns {
        self.max_skew.unwrap_or(PRIOR_SKEW_NS) as Ns
    }

    /// Learns from an unanswered request: the time until the next one, and whether that was the same.
    pub(super) fn record_timeout(&mut self, ns: Ns, was_retried: bool) {
        if was_retried { &mut self.retry_after } else { &mut self.skip_after }.add(ns);
    }

    /// How long the master waits for a response, once its retries have shown it.
    pub(super) fn master_timeout(&self) -> Option<Ns> {
        let (median, _) = self.retry_after.known_after(MIN_TIMEOUTS).filter(|(_, scatter)| *scatter < MAX_TIMEOUT_LOG_SCATTER)?;
        Some(median.exp() as Ns)
    }

    /// After how long pairing gives a request up; `None` until the master's own timeout is known.
    ///
    /// It is longer than the master's timeout: a response that is a little late for the master is still paired.
    pub(super) fn learned_request_timeout(&self) -> Option<Ns> {
        let timeout = self.master_timeout()?;
        Some((timeout as f64 * TIMEOUT_FACTOR).max(self.longest_response * LONGEST_RESPONSE_FACTOR) as Ns)
    }

    /// Twice the longest response time, in ns; 0 before any was seen.
    pub(super) fn twice_the_longest_response(&self) -> Ns {
        (self.longest_response * LONGEST_RESPONSE_FACTOR) as Ns
    }

    /// Log-odds in bits that a silence after a request is the master's timeout rather than a unit's response time.
    /// Positive for a timeout, negative for a response, 0 where there is no evidence.
    ///
    /// Both times are log-normal. For example, with typical response times of 10 ms and a timeout of 250 ms, 250 ms of
    /// silence give more than 10 bits, and 12 ms less than -10.
    pub fn timeout_log_odds(&self, silence: Option<Ns>) -> TimeoutLogOdds {
        let Some(silence) = silence.map(log_of) else { return 0.0 };
        let (response, response_spread) = self.expected_response();
        if silence < response - LN_8 {
            // Too short for either: an echo, or a silence shorter than the clock resolves.
            return 0.0;
        }
        let retry = self.retry_after.known_after(MIN_TIMEOUTS);
        let observed = retry.or(self.skip_after.known_after(MIN_TIMEOUTS)).or(self.retry_after.known_after(1));
        let (timeout, spread) = if let Some((median, scatter)) = observed {
            (median, scatter.clamp(MIN_TIMEOUT_LOG_SPREAD, PRIOR_TIMEOUT_LOG_SPREAD))
        } else {
            let expected = PRIOR_TIMEOUT_IN_RESPONSE_TIMES.ln() + response;
            (expected.max(silence.min(MAX_PRIOR_TIMEOUT_NS.ln())), PRIOR_TIMEOUT_LOG_SPREAD)
        };
        clamped(log2_likelihood(silence, timeout, spread) - log2_likelihood(silence, response, response_spread))
    }

    /// Log-odds in bits that a silence is before a new request rather than before a response. 0 where there is no
    /// evidence.
    pub fn poll_log_odds(&self, silence: Option<Ns>) -> f32 {
        let Some(silence) = silence.map(log_of) else { return 0.0 };
        let (response, response_spread) = self.expected_response();
        if silence < response - LN_8 {
            return 0.0;
        }
        let known = self.poll_log_mean.map(|mean| (mean, POLL_LOG_SPREAD));
        let (poll, spread) = known.unwrap_or((PRIOR_POLL_NS.ln(), PRIOR_POLL_LOG_SPREAD));
        clamped(log2_likelihood(silence, poll, spread) - log2_likelihood(silence, response, response_spread))
    }

    /// Mean and standard deviation of the logarithm of response times, as far as they are known.
    fn expected_response(&self) -> (f64, f64) {
        let known = self.response_log_mean.map(|mean| (mean, RESPONSE_LOG_SPREAD));
        known.unwrap_or((PRIOR_RESPONSE_NS.ln(), PRIOR_RESPONSE_LOG_SPREAD))
    }
}

fn log_of(ns: Ns) -> f64 {
    (ns.max(1) as f64).ln()
}

/// The logarithm to base 2 of a normal density, without its constant factor.
fn log2_likelihood(value: f64, mean: f64, spread: f64) -> f64 {
    let deviation = (value - mean) / spread;
    -(deviation * deviation / 2.0 + spread.ln()) * std::f64::consts::LOG2_E
}

fn clamped(evidence: f64) -> f32 {
    evidence.clamp(-MAX_TIMING_EVIDENCE_BITS, MAX_TIMING_EVIDENCE_BITS) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    #[test]
    fn the_master_timeout_is_learned_from_retries() {
        let mut timing = TimingModel::default();
        assert_eq!(timing.learned_request_timeout(), None);
        for _ in 0..20 {
            timing.record_response_time(10 * MS);
            timing.record_timeout(250 * MS, true);
        }
        let about = |time: Option<Ns>, ms: Ns| time.is_some_and(|time| (time - ms * MS).abs() < MS);
        assert!(about(timing.master_timeout(), 250) && about(timing.learned_request_timeout(), 375));
        // A unit that takes nearly as long as the master waits is given more time, or every response of it were late.
        timing.record_response_time(240 * MS);
        assert!(about(timing.learned_request_timeout(), 480));
        // One accident among the timeouts changes nothing.
        timing.record_timeout(3 * MS, true);
        assert!(about(timing.master_timeout(), 250));
    }

    #[test]
    fn the_skew_of_two_lines_is_learned_from_responses_seen_before_their_requests() {
        let mut timing = TimingModel::default();
        assert_eq!(timing.max_skew(), 60 * MS);
        (0..1200).for_each(|_| timing.record_skew(0, 10 * MS));
        assert!(timing.max_skew() < MS);
        timing.record_skew(9 * MS, 0);
        assert_eq!(timing.max_skew(), 18 * MS);
    }

    #[test]
    fn timeouts_and_response_times_are_told_apart() {
        let mut timing = TimingModel::default();
        for _ in 0..20 {
            timing.record_response_time(10 * MS);
            timing.record_timeout(250 * MS, true);
        }
        assert!(timing.timeout_log_odds(Some(250 * MS)) > 10.0);
        assert!(timing.timeout_log_odds(Some(12 * MS)) < -10.0);
        // 60 ms are long for a response, but no timeout either: this master waits for just 250 ms.
        assert!(timing.timeout_log_odds(Some(60 * MS)) < -5.0);
        assert!(timing.timeout_log_odds(None) == 0.0 && timing.timeout_log_odds(Some(MS / 2)) == 0.0);
    }
}
