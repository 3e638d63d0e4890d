//! How long a request waits for its response, and how soon a master may have given up.
//!
//! A request stays open until its response, until its master asks again, or until its waiting time is over:
//!
//! | the waiting time | where |
//! |--|--|
//! | the user's (`--timeout`) | everywhere, if it is given |
//! | the one that the master's retries have shown (`timing` learns it) | where there is no transaction identifier |
//! | [`LIVE_WAIT_NS`] | live, where neither is known: somebody waits for the row |
//! | [`IDENTIFIED_WAIT_NS`] | in a recording, with a transaction identifier: further requests close nothing, and rows wait for it |
//! | none | in a recording, without an identifier: the next request closes it |

use crate::pairing::Pairing;
use modlens_protocol::Ns;

/// A request that was silent for so long was probably given up, where the line has shown no other time: a first guess
/// (serial line specification, 2.4.1: one second is typical) for what the end of a recording means. It closes nothing.
const TYPICAL_TIMEOUT_NS: Ns = 1_000_000_000;

/// Live, a request without a response gets its row after this time at the latest.
pub const LIVE_WAIT_NS: Ns = 10_000_000_000;

/// In a recording, a request with a transaction identifier holds back the rows after it for this time at the most.
pub const IDENTIFIED_WAIT_NS: Ns = 30_000_000_000;

/// No master gives up sooner than this, as long as it has not shown its timeout (serial line specification, 2.4.1: one
/// second is typical).
pub(super) const MIN_MASTER_TIMEOUT_NS: Ns = 50_000_000;

/// A master whose timeout is known never gives up before this share of it: recorded times are late by at most the rest.
const MIN_TIMEOUT_FRACTION: f64 = 0.4;

impl Pairing {
    /// How long an open request waits for its response; `Ns::MAX` if only the next request closes it.
    pub fn request_timeout(&self, has_identifier: bool) -> Ns {
        let bound = match (self.live, has_identifier) {
            (true, _) => LIVE_WAIT_NS,
            (false, true) => IDENTIFIED_WAIT_NS,
            (false, false) => Ns::MAX,
        };
        let learned = || if has_identifier { None } else { self.timing.learned_request_timeout() };
        self.timeout.unwrap_or_else(|| learned().map_or(bound, |learned| learned.min(bound)))
    }

    /// Whether a request that was silent for so long at the end of the recording was given up, as far as can be reported.
    pub(super) fn is_probably_given_up(&self, waited: Ns) -> bool {
        let shown = self.timeout.or_else(|| self.timing.learned_request_timeout());
        waited >= shown.unwrap_or_else(|| self.timing.twice_the_longest_response().max(TYPICAL_TIMEOUT_NS))
    }

    /// Whether a master that has waited so long for a response cannot have given up yet.
    pub(crate) fn is_before_timeout(&self, waited: Ns) -> bool {
        let learned = self.timing.master_timeout().map(|timeout| (timeout as f64 * MIN_TIMEOUT_FRACTION) as Ns);
        waited < learned.unwrap_or(MIN_MASTER_TIMEOUT_NS)
    }
}
