//! The tempo of a bus: how soon it answers, how long its master waits.

use modlens_protocol::direction::Pause;
use modlens_protocol::Ns;

/// However well a silence fits, it is worth no more bits than this.
const MOST_TEMPO: f64 = 20.0;

/// Answers scatter by a factor of about e to this: units differ, and so do their functions.
const ANSWERS: f64 = 0.7;

/// A master's time-out is a constant, but what is known of it is not; and clocks are late.
const LEAST_SPREAD: f64 = 0.12;
/// The same before it was seen.
const FIRST_SPREAD: f64 = 0.5;

/// The logarithm of eight.
const EIGHTH: f64 = 2.079;

/// How fast times to answer are learned.
const RATE: f64 = 0.1;

/// Time-outs kept.
const KEPT: usize = 9;

/// Time-outs that were seen, and how much they may differ, before they decide anything.
const ENOUGH: usize = 2;
const STEADY: f64 = 0.3;

/// A request is given up after so many of the master's own time-outs, or of the longest answers.
const PATIENCE: (f64, f64) = (1.5, 2.0);

/// The longest answer is forgotten by so much with every other one.
const FORGET: f64 = 0.999;

/// An answer may be seen so much earlier than its request where two lines are read by adapters that hold bytes back:
/// before anything was seen, and at most. Latency timers take 16 ms, schedulers and serial servers far more.
const FIRST_SKEW: f64 = 60e6;
const MOST_SKEW: f64 = 150e6;

/// How far it may go beyond what was seen, and how fast it is forgotten, a pair.
const SKEW_MARGIN: f64 = 2.0;
const SKEW_FORGET: f64 = 0.996;

/// A typical time and its scatter, in natural logarithms.
#[derive(Clone, Copy, Debug)]
struct Typical {
    log: f64,
    seen: u32,
}

impl Typical {
    fn learn(slot: &mut Option<Self>, ns: Ns) {
        let log = (ns.max(1) as f64).ln();
        match slot {
            Some(known) => {
                known.log += (log - known.log) * RATE;
                known.seen = known.seen.saturating_add(1);
            }
            None => *slot = Some(Self { log, seen: 1 }),
        }
    }
}

/// A time that somebody keeps to: the median of the last few, so that accidents among them do not matter.
#[derive(Clone, Copy, Debug, Default)]
struct Constant {
    last: [f64; KEPT],
    seen: usize,
    /// Median and typical distance from it.
    typical: (f64, f64),
}

impl Constant {
    fn learn(&mut self, ns: Ns) {
        self.last[self.seen % KEPT] = (ns.max(1) as f64).ln();
        self.seen += 1;
        let kept = self.seen.min(KEPT);
        let median = |mut values: [f64; KEPT]| {
            values[..kept].sort_by(f64::total_cmp);
            values[kept / 2]
        };
        let middle = median(self.last);
        self.typical = (middle, median(self.last.map(|log| (log - middle).abs())));
    }

    /// Median and typical distance from it, once enough was seen.
    fn known(&self, enough: usize) -> Option<(f64, f64)> {
        (self.seen >= enough).then_some(self.typical)
    }
}

/// What this bus has shown of its tempo.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tempo {
    answer: Option<Typical>,
    longest: f64,
    /// From the end of a request to the same request again.
    retry: Constant,
    /// From the end of an unanswered request to another one.
    moved_on: Constant,
    /// How much earlier than its request an answer may be seen.
    skew: Option<f64>,
}

impl Tempo {
    /// A request was answered after so long.
    pub(super) fn answered(&mut self, ns: Ns) {
        Typical::learn(&mut self.answer, ns);
        self.longest = (self.longest * FORGET).max(ns as f64);
    }

    /// A request was seen to end, and its answer to begin.
    pub(super) fn saw(&mut self, asked: Ns, told: Ns) {
        let known = self.skew.unwrap_or(FIRST_SKEW) * SKEW_FORGET;
        self.skew = Some(known.max(SKEW_MARGIN * (asked - told) as f64).min(MOST_SKEW));
    }

    /// How much earlier than its request an answer may be seen.
    pub fn skew(&self) -> Ns {
        self.skew.unwrap_or(FIRST_SKEW) as Ns
    }

    /// A request was not answered, and the next one came after so long; it was the same one, or another.
    pub(super) fn unanswered(&mut self, ns: Ns, again: bool) {
        if again { &mut self.retry } else { &mut self.moved_on }.learn(ns);
    }

    /// How long this master waits for an answer, once its retries have shown it.
    pub(super) fn master_waits(&self) -> Option<Ns> {
        self.retry.known(ENOUGH).filter(|(_, spread)| *spread < STEADY).map(|(log, _)| log.exp() as Ns)
    }

    /// When a request is given up; `None` until the master has shown how long it waits.
    pub(super) fn patience(&self) -> Option<Ns> {
        self.master_waits().map(|waits| (waits as f64 * PATIENCE.0).max(self.longest * PATIENCE.1) as Ns)
    }

    /// By how many bits a silence is more like a time-out than like an answer.
    pub fn judge(&self, gap: Option<Ns>) -> Pause {
        let (Some(gap), Some(answer)) = (gap.map(|ns| (ns.max(1) as f64).ln()), self.answer.map(|answer| answer.log)) else {
            return 0.0;
        };
        if gap < answer - EIGHTH {
            // Too soon for either: an echo, or a silence that the clock has lost.
            return 0.0;
        }
        let likely = |typical: f64, spread: f64| {
            let off = (gap - typical) / spread;
            -(off * off / 2.0 + spread.ln()) * std::f64::consts::LOG2_E
        };
        let timeout = match self.retry.known(ENOUGH).or(self.moved_on.known(ENOUGH)).or(self.retry.known(1)) {
            Some((log, spread)) => likely(log, spread.clamp(LEAST_SPREAD, FIRST_SPREAD)),
            // Until a time-out was seen, one is expected at 30 answers or more.
            None => likely((30f64.ln() + answer).max(gap.min(1e9f64.ln())), FIRST_SPREAD),
        };
        (timeout - likely(answer, ANSWERS)).clamp(-MOST_TEMPO, MOST_TEMPO) as f32
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
        let about = |time: Option<Ns>, ms: Ns| time.is_some_and(|time| (time - ms * MS).abs() < MS);
        assert!(about(tempo.master_waits(), 250) && about(tempo.patience(), 375));
        // A unit that takes longer than the master's patience is given more time, not called late for ever.
        tempo.answered(240 * MS);
        assert!(about(tempo.patience(), 480));
        // An accident among the time-outs changes nothing.
        tempo.unanswered(3 * MS, true);
        assert!(about(tempo.master_waits(), 250));
    }

    #[test]
    fn how_far_two_lines_may_be_apart_is_learned_from_answers_before_their_requests() {
        let mut tempo = Tempo::default();
        assert_eq!(tempo.skew(), 60 * MS);
        (0..1200).for_each(|_| tempo.saw(0, 10 * MS));
        assert!(tempo.skew() < MS);
        tempo.saw(9 * MS, 0);
        assert_eq!(tempo.skew(), 18 * MS);
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
