//! Runs algorithms over scenarios, tap modes and seeds, and collects their scores.

use std::collections::BTreeMap;

use crate::reported::Algorithm;
use crate::score::{false_frames, score, Score};
use crate::sim::case::Traffic;
use crate::sim::noise::{NoiseCase, Pattern};
use crate::sim::scenario::Scenario;
use crate::sim::tap::TapMode;

/// A function that makes the algorithms of a run; each thread has its own.
pub type Makers = fn() -> Vec<Box<dyn Algorithm>>;

/// The scenarios, tap modes, seeds and algorithms of a run.
#[derive(Clone, Debug)]
pub struct RunPlan {
    /// Scenarios, in the order of the table.
    pub scenarios: Vec<&'static Scenario>,
    /// Tap modes, in the order of the table.
    pub modes: Vec<TapMode>,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// The number of frames of a scenario whose default is 3000; the numbers of other scenarios are scaled in proportion.
    pub frames: usize,
    /// Names of algorithms; empty for all.
    pub algorithms: Vec<String>,
    /// Threads.
    pub threads: usize,
}

/// The scores of one scenario by (algorithm, mode), one per seed.
pub type Cells = BTreeMap<(usize, usize), Vec<Score>>;

/// The scores of a run.
pub struct RunOutcome {
    /// Names of the algorithms.
    pub names: Vec<&'static str>,
    /// Which algorithms give labels.
    pub gives_labels: Vec<bool>,
    /// The scores of each scenario of the plan.
    pub scenarios: Vec<Cells>,
}

impl RunPlan {
    /// The algorithms of the plan.
    pub fn chosen_algorithms(&self, makers: Makers) -> Vec<Box<dyn Algorithm>> {
        let wanted = |name: &str| self.algorithms.is_empty() || self.algorithms.iter().any(|other| other == name);
        makers().into_iter().filter(|algorithm| wanted(algorithm.name())).collect()
    }

    /// A plan for each group of scenarios, whose figures are printed together.
    pub fn groups(&self) -> Vec<Self> {
        let groups = self.scenarios.chunk_by(|a, b| a.group() == b.group());
        groups.map(|scenarios| Self { scenarios: scenarios.to_vec(), ..self.clone() }).collect()
    }

    /// Runs all scenarios, on several threads.
    pub fn run(&self, makers: Makers) -> RunOutcome {
        let next = std::sync::atomic::AtomicUsize::new(0);
        let done = std::sync::Mutex::new(vec![Cells::new(); self.scenarios.len()]);
        std::thread::scope(|scope| {
            for _ in 0..self.threads.max(1) {
                scope.spawn(|| loop {
                    let at = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    let Some(scenario) = self.scenarios.get(at) else { break };
                    let cells = self.scenario(scenario, makers);
                    done.lock().expect("no other thread panicked")[at] = cells;
                });
            }
        });
        let algorithms = self.chosen_algorithms(makers);
        RunOutcome {
            names: algorithms.iter().map(|algorithm| algorithm.name()).collect(),
            gives_labels: algorithms.iter().map(|algorithm| algorithm.labels()).collect(),
            scenarios: done.into_inner().expect("no thread panicked"),
        }
    }

    /// Runs all algorithms on a scenario, in all tap modes and with all seeds.
    fn scenario(&self, scenario: &Scenario, makers: Makers) -> Cells {
        let mut cells = Cells::new();
        for &seed in &self.seeds {
            let frames = (scenario.frames * self.frames).div_ceil(3000);
            let traffic = Traffic::new(scenario, seed, frames);
            let cases: Vec<_> = self.modes.iter().map(|&mode| traffic.tap(mode)).collect();
            for (at, algorithm) in self.chosen_algorithms(makers).iter_mut().enumerate() {
                let mut score_without_times: Option<Score> = None;
                for (mode, case) in cases.iter().enumerate() {
                    if !algorithm.reads(case) {
                        continue;
                    }
                    let result = match &score_without_times {
                        Some(score) => score.clone(),
                        None => score(case, &algorithm.run(case)),
                    };
                    if !algorithm.uses_times() {
                        score_without_times = Some(result.clone());
                    }
                    cells.entry((at, mode)).or_default().push(result);
                }
            }
        }
        cells
    }
}

impl RunOutcome {
    /// The mean over the seeds of a figure, in percent; `None` if the algorithm cannot process the scenario.
    pub fn mean(&self, scenario: usize, algorithm: usize, mode: usize, of: fn(&Score) -> f64) -> Option<f64> {
        let scores = self.scenarios[scenario].get(&(algorithm, mode))?;
        Some(100.0 * scores.iter().map(of).sum::<f64>() / scores.len() as f64)
    }

    /// The sum of an algorithm's scores in one tap mode, or in all.
    pub fn total(&self, algorithm: usize, mode: Option<usize>) -> Score {
        let mut total = Score::default();
        for cells in &self.scenarios {
            let mine = cells.iter().filter(|((other, tap), _)| *other == algorithm && mode.is_none_or(|mode| mode == *tap));
            mine.flat_map(|(_, scores)| scores).for_each(|score| total.add(score));
        }
        total
    }
}

/// The false frames that an algorithm finds in noise.
#[derive(Clone, Copy, Debug)]
pub struct NoiseRow {
    /// The kind of noise.
    pub pattern: Pattern,
    /// Whether clean traffic comes before the noise.
    pub warm: bool,
    /// Index of the algorithm in the plan.
    pub algorithm: usize,
    /// False frames per MB that are reported as certain.
    pub facts: f64,
    /// False frames per MB that are marked as unconfirmed.
    pub unconfirmed: f64,
}

/// The noise to run.
#[derive(Clone, Debug)]
pub struct NoisePlan {
    /// The kinds of noise.
    pub patterns: Vec<Pattern>,
    /// The number of bytes of each kind.
    pub bytes: usize,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// How the noise is tapped.
    pub mode: TapMode,
}

impl NoisePlan {
    /// Counts false frames in noise alone and after clean traffic.
    pub fn run(&self, plan: &RunPlan, makers: Makers) -> Vec<NoiseRow> {
        let mut rows = Vec::new();
        for &pattern in &self.patterns {
            for warm in [false, true] {
                let mut counts = vec![(0, 0); plan.chosen_algorithms(makers).len()];
                for &seed in &self.seeds {
                    let noise = NoiseCase::new(pattern, seed, self.bytes, self.mode, warm);
                    for (count, algorithm) in counts.iter_mut().zip(plan.chosen_algorithms(makers)) {
                        let mut algorithm = algorithm;
                        if algorithm.reads(&noise.case) {
                            let (facts, unconfirmed) = false_frames(&algorithm.run(&noise.case), noise.from);
                            *count = (count.0 + facts, count.1 + unconfirmed);
                        }
                    }
                }
                let megabytes = (self.bytes * self.seeds.len()) as f64 / 1e6;
                rows.extend(counts.into_iter().enumerate().map(|(algorithm, (facts, unconfirmed))| NoiseRow {
                    pattern,
                    warm,
                    algorithm,
                    facts: facts as f64 / megabytes,
                    unconfirmed: unconfirmed as f64 / megabytes,
                }));
            }
        }
        rows
    }
}
