//! How long a request waits for its response, and how soon a master may have given up.
//!
//! The time-out is the user's (`--timeout`), else the one that the master's retries have shown (`timing` learns it), else
//! [`DEFAULT_TIMEOUT`].

use crate::pairing::Pairing;
use modlens_protocol::Ns;

/// A request is given up after this time at the latest where the master has shown no other.
pub const DEFAULT_TIMEOUT: Ns = 1_000_000_000;

/// No master gives up sooner than this, as long as it has not shown its time-out (serial line specification, 2.4.1: one
/// second is typical).
pub(super) const MIN_MASTER_TIMEOUT_NS: Ns = 50_000_000;

/// A master whose time-out is known never gives up before this share of it: recorded times are late by at most the rest.
const MIN_TIMEOUT_FRACTION: f64 = 0.4;

impl Pairing {
    /// How long an open request waits for its response: as the user has set it, or the learned time, or the default.
    pub fn request_timeout(&self) -> Ns {
        let learned = || self.timing.learned_request_timeout().map_or(DEFAULT_TIMEOUT, |learned| learned.min(DEFAULT_TIMEOUT));
        self.timeout.unwrap_or_else(learned)
    }

    /// Whether a master that has waited so long for a response cannot have given up yet.
    pub(super) fn is_before_timeout(&self, waited: Ns) -> bool {
        let learned = self.timing.master_timeout().map(|timeout| (timeout as f64 * MIN_TIMEOUT_FRACTION) as Ns);
        waited < learned.unwrap_or(MIN_MASTER_TIMEOUT_NS)
    }
}

/// From the end of one frame to the start of another, where both are known.
pub(super) fn interval(end: Option<Ns>, start: Option<Ns>) -> Option<Ns> {
    Some(start? - end?)
}
