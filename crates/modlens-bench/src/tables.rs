//! The tables that `accuracy` prints.

use std::fmt::Write as _;

use crate::accuracy::{NoiseRow, RunOutcome, RunPlan};
use crate::model::Label;
use crate::score::{Calibration, Score};

/// The table of one algorithm: a figure in percent for each scenario and tap mode.
pub fn by_mode(plan: &RunPlan, outcome: &RunOutcome, algorithm: usize, title: &str, of: fn(&Score) -> f64) -> String {
    let mut text = format!("\n{}: {title}, percent\n{:<15}", outcome.names[algorithm], "");
    for mode in &plan.modes {
        write!(text, "{:>9}", mode.text()).expect("text can grow");
    }
    text.push_str("     mean\n");
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (at, scenario) in plan.scenarios.iter().enumerate() {
        let cells: Option<Vec<f64>> = (0..plan.modes.len()).map(|mode| outcome.mean(at, algorithm, mode, of)).collect();
        if let Some(cells) = cells {
            row(&mut text, scenario.name, &cells);
            rows.push(cells);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let columns = (0..plan.modes.len()).map(|mode| mean(rows.iter().map(|row| row[mode])));
    row(&mut text, "mean", &columns.collect::<Vec<_>>());
    text
}

fn row(text: &mut String, name: &str, cells: &[f64]) {
    write!(text, "{name:<15}").expect("text can grow");
    for cell in cells {
        write!(text, "{cell:>9.2}").expect("text can grow");
    }
    writeln!(text, "{:>9.2}", mean(cells.iter().copied())).expect("text can grow");
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The table of totals over all scenarios and modes, one line per algorithm.
pub fn totals(outcome: &RunOutcome) -> String {
    let mut text = String::from(
        "\nall scenarios and modes, percent\n                recall  precision  direction  pair rec.  pair prec.    pair F1  located  loc.prec.  false/missed\n",
    );
    for (at, name) in outcome.names.iter().enumerate() {
        let score = outcome.total(at, None);
        if score.valid == 0 {
            continue;
        }
        let frames = score.frames();
        let direction = score.matched_with_direction as f64 / score.matched.max(1) as f64;
        let shares = [frames.recall(), frames.precision(), direction, score.pairs.recall(), score.pairs.precision()];
        let shares = shares.map(|share| format!("{:>10.3}", 100.0 * share)).join(" ");
        let rest = [score.pairs.f1(), score.damaged.recall(), score.damaged.precision()];
        let rest = rest.map(|share| format!("{:>9.2}", 100.0 * share)).join(" ");
        let (false_ones, missed) = (score.claimed - score.matched, score.valid - score.matched);
        writeln!(text, "{name:<12} {shares} {rest}   {false_ones} / {missed}").expect("text can grow");
    }
    text
}

/// The table of labels: precision and recall of each, by tap mode and in total.
pub fn labels(plan: &RunPlan, outcome: &RunOutcome) -> String {
    let mut text = String::new();
    for (at, name) in outcome.names.iter().enumerate().filter(|(at, _)| outcome.gives_labels[*at]) {
        write!(text, "\n{name}: what people act on, precision/recall, percent\n{:<14}", "").expect("text can grow");
        plan.modes.iter().for_each(|mode| write!(text, "{:>13}", mode.text()).expect("text can grow"));
        writeln!(text, "{:>13}{:>9}{:>9}", "all", "claimed", "wanted").expect("text can grow");
        let modes = (0..plan.modes.len()).map(Some).chain([None]);
        let totals: Vec<Score> = modes.map(|mode| outcome.total(at, mode)).collect();
        for label in Label::ALL {
            write!(text, "{:<14}", label.text()).expect("text can grow");
            for tally in totals.iter().map(|total| total.label(label).0) {
                let cell = format!("{:.1}/{:.1}", 100.0 * tally.precision(), 100.0 * tally.recall());
                write!(text, "{cell:>13}").expect("text can grow");
            }
            let all = totals.last().map(|total| total.label(label).0).unwrap_or_default();
            writeln!(text, "{:>9}{:>9}", all.claimed, all.wanted).expect("text can grow");
        }
    }
    text
}

/// The latency of live reports, one line per algorithm.
pub fn latencies(outcome: &RunOutcome) -> String {
    let mut text = String::new();
    for (at, name) in outcome.names.iter().enumerate() {
        let latency = outcome.total(at, None).latency;
        if !latency.is_empty() {
            let [p50, p95, p99, longest] = latency.percentiles();
            writeln!(text, "\n{name}: latency ms  p50 {p50:.2}  p95 {p95:.2}  p99 {p99:.2}  max {longest:.2}")
                .expect("text can grow");
        }
    }
    text
}

/// The table of false frames per MB of noise.
pub fn noise(names: &[&str], rows: &[NoiseRow]) -> String {
    let mut text = String::from("\nfalse frames per MB of noise (unconfirmed ones in brackets)\n");
    write!(text, "{:<17}", "").expect("text can grow");
    for name in names {
        write!(text, "{name:>20}").expect("text can grow");
    }
    for row in rows {
        if row.algorithm == 0 {
            let name = format!("{} {}", row.pattern.text(), if row.warm { "warm" } else { "cold" });
            write!(text, "\n{name:<17}").expect("text can grow");
        }
        let cell = format!("{:.2} ({:.2})", row.facts, row.unconfirmed);
        write!(text, "{cell:>20}").expect("text can grow");
    }
    text.push('\n');
    text
}

/// Stated odds against counted errors of all algorithms that state any.
pub fn calibration(outcome: &RunOutcome) -> String {
    let mut counted = Calibration::default();
    let states_odds = (0..outcome.names.len()).filter(|&at| outcome.gives_labels[at]);
    states_odds.for_each(|at| counted.add(&outcome.total(at, None).calibration));
    odds(&counted)
}

/// Stated odds against counted errors: one row per value of the confidence, then one per decade of the odds.
pub fn odds(counted: &Calibration) -> String {
    let mut text = String::from("\nconfidence         rows  unconfirmed   wrong  counted log2 odds\n");
    let mut decades: Vec<(u64, u64, f64)> = Vec::new();
    for (bits, (&(firm, firm_wrong), &(open, open_wrong))) in counted.rows.iter().zip(&counted.unconfirmed).enumerate() {
        let (all, wrong) = (firm + open, firm_wrong + open_wrong);
        let decade = (bits as f64 * std::f64::consts::LOG10_2) as usize;
        decades.resize(decades.len().max(decade + 1), (0, 0, 0.0));
        let sums = &mut decades[decade];
        *sums = (sums.0 + all, sums.1 + wrong, sums.2 + all as f64 * chance_of_error(bits));
        if all > 0 {
            let odds = ((all - wrong).max(1) as f64 / wrong.max(1) as f64).log2();
            writeln!(text, "{bits:>10} {all:>12} {open:>12} {wrong:>7} {odds:>18.1}").expect("text can grow");
        }
    }
    text.push_str("\nstated odds              rows  errors stated  errors counted\n");
    for (decade, (all, wrong, expected)) in decades.into_iter().enumerate().filter(|(_, sums)| sums.0 > 0) {
        let from = 10u64.pow(decade as u32);
        let odds = format!("{from} to 1 up to {}", 10 * from);
        writeln!(text, "{odds:<22} {all:>7} {expected:>13.0} {wrong:>15}").expect("text can grow");
    }
    text
}

/// The probability that a row of this confidence is wrong, as it states it.
fn chance_of_error(bits: usize) -> f64 {
    1.0 / (1.0 + (bits as f64).exp2())
}
