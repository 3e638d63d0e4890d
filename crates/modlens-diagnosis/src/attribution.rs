//! Which failures each claim explains, what no claim explains, and how much better a claim is than its best rival.
//!
//! Each odd transaction has a symptom and a unit. A cause shows each symptom in a share of its failures (`symptoms` in
//! `dissectors/diagnoses.toml`), of its unit or of all units of the line. The failures are divided among the claims as the most
//! likely mixture divides them; the weights are found by expectation maximization and begin with what each claim has counted.
//!
//! **Odds.** The symptoms alone cannot tell a unit that is off from one that is asked too soon: both do not answer. What separates
//! them is the contrast, so its chance counts too: a chance p speaks for a cause at most by 1 to -e p ln p (Sellke,
//! Bayarri and Berger, 2001). The odds of a claim are its symptoms and its contrast against those of the best other cause; a cause
//! whose contrast shows nothing has its symptoms alone.

use crate::claim::{Certainty, Claim, View};
use crate::contrast::{Seen, Symptom};
use crate::odd::Odd;
use crate::table::{diagnoses, diagnosis, Diagnosis};

/// What no claim explains: any symptom of any unit, this much less likely than by a cause that shows all alike.
const UNEXPLAINED: f64 = 0.1;
/// A symptom of another unit than that of the claim.
const ELSEWHERE: f64 = 1e-4;
/// Steps of expectation maximization: the weights change little after these.
const STEPS: usize = 20;
/// More failures with one symptom than these add no certainty: they may share a reason.
const MOST_COUNTED: f64 = 4.0;
/// Greater odds are not stated.
pub const MOST_ODDS: f64 = 1e6;

/// The symptoms of one unit, counted.
struct Cell {
    symptom: Symptom,
    unit: Option<u8>,
    count: f64,
    /// The part of them that are failed requests.
    failing: f64,
}

/// What is odd on a bus, and how much of it no claim explains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rest {
    /// Odd transactions and bytes.
    pub odd: Odd,
    /// Those that no claim explains.
    pub unexplained: Odd,
}

/// Divides what is odd among the claims, and weighs each against its best rival. `all` are the claims of all kinds, those
/// that others explain among them.
pub fn attribute(view: &View<'_>, claims: &mut [Claim], all: &[Claim]) -> Rest {
    let cell = |(symptom, unit, seen): (Symptom, Option<u8>, &Seen)| {
        let count = seen.all.failed as f64;
        Cell { symptom, unit, count, failing: seen.failed_requests as f64 / count.max(1.0) }
    };
    let cells: Vec<Cell> = view.bus.symptoms.all().map(cell).collect();
    let units = view.units().count().max(1) as f64;
    let (shares, rest) = divide(&cells, claims, units);
    for (claim, share) in claims.iter_mut().zip(shares) {
        let explains: f64 = share.iter().sum();
        let cause = diagnosis(claim.code).expect("each kind has a row");
        if cause.symptoms.is_empty() || explains < 0.5 {
            continue;
        }
        claim.explains = Some(sum(cells.iter().zip(share.iter().copied())));
        if claim.certainty == Certainty::Diagnosed || claim.undecided.is_some() {
            let seen: Vec<(Symptom, f64)> = cells.iter().zip(share).map(|(cell, count)| (cell.symptom, count)).collect();
            claim.odds = odds(claim, cause, &seen, all);
        }
    }
    let odd = sum(cells.iter().map(|cell| (cell, cell.count)));
    // A failed request that looks like nothing of the table is one that no cause explains.
    let failed = view.bus.requests_seen.failed.max(odd.failed);
    let mut unexplained = sum(cells.iter().zip(rest));
    unexplained.failed += failed - odd.failed;
    Rest { odd: Odd { failed, ..odd }, unexplained }
}

/// Sums up shares of cells.
fn sum<'a>(cells: impl Iterator<Item = (&'a Cell, f64)>) -> Odd {
    let (mut failed, mut refused, mut other) = (0.0, 0.0, 0.0);
    for (cell, count) in cells {
        failed += count * cell.failing;
        *(if cell.symptom.is_refusal() { &mut refused } else { &mut other }) += count * (1.0 - cell.failing);
    }
    Odd { failed: failed.round() as u64, refused: refused.round() as u64, other: other.round() as u64 }
}

/// Of each cell, how many each claim explains; and how many none does.
fn divide(cells: &[Cell], claims: &[Claim], units: f64) -> (Vec<Vec<f64>>, Vec<f64>) {
    let unexplained = UNEXPLAINED / Symptom::ALL.len() as f64 / units;
    let likelihood = |claim: &Claim, cell: &Cell| match (claim.spoiled_unit(), diagnosis(claim.code)) {
        (Some(unit), _) if cell.unit.is_some_and(|other| other != unit) => ELSEWHERE,
        (unit, Some(cause)) => cause.rate(cell.symptom) / if unit.is_some() { 1.0 } else { units },
        (_, None) => 0.0,
    };
    let table: Vec<Vec<f64>> =
        cells.iter().map(|cell| claims.iter().map(|claim| likelihood(claim, cell)).chain([unexplained]).collect()).collect();
    // Two claims with the same symptoms keep the ratio of what they have counted.
    let mut weights: Vec<f64> = claims.iter().map(|claim| claim.harm as f64).chain([1.0]).collect();
    let mut shares = vec![vec![0.0; cells.len()]; claims.len() + 1];
    for _ in 0..STEPS {
        for (at, (cell, row)) in cells.iter().zip(&table).enumerate() {
            let sum: f64 = row.iter().zip(&weights).map(|(one, weight)| one * weight).sum();
            for ((share, one), weight) in shares.iter_mut().zip(row).zip(&weights) {
                share[at] = cell.count * one * weight / sum.max(f64::MIN_POSITIVE);
            }
        }
        weights = shares.iter().map(|share| share.iter().sum::<f64>().max(1e-9)).collect();
    }
    let rest = shares.pop().unwrap_or_default();
    (shares, rest)
}

/// The odds of a claim against its best rival, by the failures that it explains.
fn odds(claim: &Claim, cause: &Diagnosis, seen: &[(Symptom, f64)], all: &[Claim]) -> Option<(f64, &'static str)> {
    let fit = |cause: &Diagnosis| -> f64 {
        cause.met.ln() + seen.iter().map(|(symptom, count)| count.min(MOST_COUNTED) * cause.rate(*symptom).ln()).sum::<f64>()
    };
    if let Some(rival) = claim.undecided.and_then(diagnosis) {
        // All its failures have one reason: the most frequent symptom counts once.
        let (symptom, _) = seen.iter().max_by(|one, other| one.1.total_cmp(&other.1))?;
        let fit = |cause: &Diagnosis| cause.met * cause.rate(*symptom);
        return Some((fit(cause) / fit(rival), rival.code.as_str()));
    }
    let is_rival = |other: &&Claim, code: &str| {
        other.code == code && (other.unit.is_none() || claim.unit.is_none() || other.unit == claim.unit)
    };
    let contrast =
        |code: &str| all.iter().filter(|other| is_rival(other, code)).map(|other| contrast(other.chance)).fold(0.0, f64::max);
    let rivals = diagnoses().iter().filter(|other| other.code != claim.code && !other.symptoms.is_empty());
    let rivals = rivals.map(|other| (fit(other) + contrast(&other.code), other.code.as_str()));
    let (best, code) = rivals.max_by(|one, other| one.0.total_cmp(&other.0))?;
    let odds = (fit(cause) + self::contrast(claim.chance) - best).exp();
    Some((odds.min(MOST_ODDS), code))
}

/// The logarithm of how much a contrast of this chance speaks for its cause at most.
fn contrast(chance: f64) -> f64 {
    let chance = chance.clamp(1e-300, 1.0);
    if chance >= (-1.0f64).exp() {
        return 0.0;
    }
    -(std::f64::consts::E * chance * -chance.ln()).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contrast_speaks_as_published() {
        // Sellke, Bayarri and Berger, table 1: p = 0.05 is 2.456 to 1, p = 0.001 is 53 to 1.
        assert!((contrast(0.05).exp() - 2.456).abs() < 0.01 && (contrast(0.001).exp() - 53.26).abs() < 0.1);
        assert!(contrast(0.5).abs() < 1e-12);
    }
}
