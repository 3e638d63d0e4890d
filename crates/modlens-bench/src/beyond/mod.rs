//! Lines beyond the scenarios of the simulator, and their figures: habits that nothing in the engine was set by.
//!
//! Generators and choices are others than those of `sim`. The same is done with recordings of others (`recorded`).

mod kinds;
mod line;
mod recorded;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use crate::accuracy::{Makers, RunPlan};
use crate::score::{score, Calibration, Score};
use crate::sim::case::Case;
use crate::tables;

/// The cases of the plan: all kinds by its seeds and tap modes, or the recordings of a folder.
pub fn cases(plan: &RunPlan, folder: Option<&str>, only: Option<&str>) -> Result<Vec<Case>, String> {
    if let Some(folder) = folder {
        let all = recorded::cases(Path::new(folder))?;
        return Ok(all.into_iter().filter(|case| only.is_none_or(|only| case.name.contains(only))).collect());
    }
    let mut cases = Vec::new();
    for &(name, make) in kinds::KINDS.iter().filter(|(name, _)| only.is_none_or(|only| name.contains(only))) {
        for &seed in &plan.seeds {
            let mut line = line::Line::new(name, seed);
            make(&mut line);
            cases.extend(plan.modes.iter().map(|&mode| line.tap(mode)));
        }
    }
    Ok(cases)
}

/// The figures of all cases: a row for each kind, then stated odds against counted errors.
pub fn table(plan: &RunPlan, makers: Makers, cases: &[Case]) -> String {
    let mut scores: BTreeMap<&str, Score> = BTreeMap::new();
    for case in cases {
        for mut algorithm in plan.chosen_algorithms(makers) {
            scores.entry(&case.name).or_default().add(&score(case, &algorithm.run(case)));
        }
    }
    let mut text = String::from(
        "line                       frames  F1 with direction  pair recall  pair precision  damaged  wrong at 10 bits and more\n",
    );
    let mut calibration = Calibration::default();
    for (name, score) in &scores {
        let (frames, pairs) = (score.frames_with_direction().f1(), score.pairs);
        let (found, right, damaged) = (pairs.recall(), pairs.precision(), score.damaged.recall());
        let sure: [u64; 2] = score.calibration.at_least(10).into();
        let percent = [frames, found, right, damaged].map(|share| format!("{:.2}", 100.0 * share));
        let [frames, found, right, damaged] = percent;
        writeln!(
            text,
            "{name:<38} {:>6} {frames:>8} {found:>8} {right:>8} {damaged:>8} {:>6} of {}",
            score.valid, sure[1], sure[0]
        )
        .expect("text can grow");
        if *name != kinds::CHOSEN_BY_CHECKSUM {
            calibration.add(&score.calibration);
        }
    }
    text + &tables::odds(&calibration)
}
