//! The tempo of a bus: how soon it answers, how long its master waits.

use crate::direction::Pause;
use crate::Ns;

/// However well a silence fits, it is worth no more bits than this.
const MOST_TEMPO: f64 = 20.0;
/// What this bus has shown of its tempo.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tempo {
    /// Typical time to answer.
    pub(super) answer: Option<f64>,
    /// Typical time until the master asks again.
    pub(super) timeout: Option<f64>,
}

impl Tempo {
    pub(super) fn learn(slot: &mut Option<f64>, ns: Ns) {
        let value = (ns.max(1)) as f64;
        *slot = Some(slot.map_or(value, |old| old * 0.9 + value * 0.1));
    }

    /// By how many bits a silence is more like a time-out than like an answer.
    pub fn judge(&self, gap: Option<Ns>) -> Pause {
        let (Some(gap), Some(answer)) = (gap.map(|ns| ns.max(1) as f64), self.answer) else { return 0.0 };
        if gap < answer / 8.0 {
            // Too soon for either: an echo, or a silence that the clock has lost.
            return 0.0;
        }
        // Both scatter by a factor of about e^(1/2); until a time-out was seen, one is expected at 30 answers or more.
        let likely = |typical: f64| -(gap / typical).ln().powi(2) * 2.0 * std::f64::consts::LOG2_E;
        let timeout = self.timeout.unwrap_or_else(|| (30.0 * answer).max(gap.min(1e9)));
        (likely(timeout) - likely(answer)).clamp(-MOST_TEMPO, MOST_TEMPO) as f32
    }
}
