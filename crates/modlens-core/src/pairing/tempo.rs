//! The tempo of a bus: how soon it answers, how long its master waits.

use crate::direction::Pause;
use crate::Ns;

/// However well a silence fits, it is worth no more bits than this.
const MOST_TEMPO: f64 = 20.0;

/// Answers scatter by a factor of about e to this: units differ, and so do their functions.
const ANSWERS: f64 = 0.7;

/// A master's time-out is a constant, but what is known of it is not; and clocks are late.
const LEAST_SPREAD: f64 = 0.12;
/// The same before it was seen.
const FIRST_SPREAD: f64 = 0.5;

/// How fast times are learned.
const RATE: f64 = 0.1;

/// Time-outs that were seen, before they decide anything.
const ENOUGH: u32 = 2;

/// A request is given up after so many of the master's own time-outs, or of the longest answers.
const PATIENCE: (f64, f64) = (1.5, 2.0);

/// The longest answer is forgotten by so much with every other one.
const FORGET: f64 = 0.999;

/// A typical time and its scatter, in natural logarithms.
#[derive(Clone, Copy, Debug)]
struct Typical {
    ns: f64,
    spread: f64,
    seen: u32,
}

impl Typical {
    fn learn(slot: &mut Option<Self>, ns: Ns) {
        let value = ns.max(1) as f64;
        let Some(known) = slot else {
            *slot = Some(Self { ns: value, spread: FIRST_SPREAD, seen: 1 });
            return;
        };
        let off = (value / known.ns).ln();
        known.spread += (off.abs().min(1.0) - known.spread) * RATE;
        known.ns *= (off * RATE).exp();
        known.seen = known.seen.saturating_add(1);
    }
}

/// What this bus has shown of its tempo.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tempo {
    answer: Option<Typical>,
    longest: f64,
    /// From the end of a request to the same request again.
    retry: Option<Typical>,
    /// From the end of an unanswered request to another one.
    moved_on: Option<Typical>,
}

impl Tempo {
    /// A request was answered after so long.
    pub(super) fn answered(&mut self, ns: Ns) {
        Typical::learn(&mut self.answer, ns);
        self.longest = (self.longest * FORGET).max(ns as f64);
    }

    /// A request was not answered, and the next one came after so long; it was the same one, or another.
    pub(super) fn unanswered(&mut self, ns: Ns, again: bool) {
        Typical::learn(if again { &mut self.retry } else { &mut self.moved_on }, ns);
    }

    fn timeout(&self) -> Option<Typical> {
        let enough = |slot: Option<Typical>| slot.filter(|typical| typical.seen >= ENOUGH);
        enough(self.retry).or(enough(self.moved_on)).or(self.retry)
    }

    /// How long this master waits for an answer, once its retries have shown it.
    pub(super) fn master_waits(&self) -> Option<Ns> {
        self.retry.filter(|typical| typical.seen >= ENOUGH).map(|typical| typical.ns as Ns)
    }

    /// When a request is given up; `None` until the master has shown how long it waits.
    pub(super) fn patience(&self) -> Option<Ns> {
        self.master_waits().map(|waits| (waits as f64 * PATIENCE.0).max(self.longest * PATIENCE.1) as Ns)
    }

    /// By how many bits a silence is more like a time-out than like an answer.
    pub fn judge(&self, gap: Option<Ns>) -> Pause {
        let (Some(gap), Some(answer)) = (gap.map(|ns| ns.max(1) as f64), self.answer) else { return 0.0 };
        if gap < answer.ns / 8.0 {
            // Too soon for either: an echo, or a silence that the clock has lost.
            return 0.0;
        }
        let likely = |typical: f64, spread: f64| {
            let off = (gap / typical).ln() / spread;
            -off * off / 2.0 * std::f64::consts::LOG2_E
        };
        let timeout = match self.timeout() {
            Some(timeout) => likely(timeout.ns, timeout.spread.max(LEAST_SPREAD)),
            // Until a time-out was seen, one is expected at 30 answers or more.
            None => likely((30.0 * answer.ns).max(gap.min(1e9)), FIRST_SPREAD),
        };
        (timeout - likely(answer.ns, ANSWERS)).clamp(-MOST_TEMPO, MOST_TEMPO) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    #[test]
    fn a_time_out_is_learned_from_retries() {
        let mut tempo = Tempo::default();
        assert_eq!(tempo.patience(), None);
        for _ in 0..20 {
            tempo.answered(10 * MS);
            tempo.unanswered(250 * MS, true);
        }
        assert_eq!((tempo.master_waits(), tempo.patience()), (Some(250 * MS), Some(375 * MS)));
        // A unit that takes longer than the master's patience is given more time, not called late for ever.
        tempo.answered(240 * MS);
        assert_eq!(tempo.patience(), Some(480 * MS));
    }

    #[test]
    fn silences_are_told_apart() {
        let mut tempo = Tempo::default();
        for _ in 0..20 {
            tempo.answered(10 * MS);
            tempo.unanswered(250 * MS, true);
        }
        assert!(tempo.judge(Some(250 * MS)) > 10.0);
        assert!(tempo.judge(Some(12 * MS)) < -10.0);
        // Long for an answer, but no time-out either: this master waits for just 250 ms.
        assert!(tempo.judge(Some(60 * MS)) < -5.0);
        assert!(tempo.judge(None) == 0.0 && tempo.judge(Some(MS / 2)) == 0.0);
    }
}
