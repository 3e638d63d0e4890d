//! One explanation for all failures: the smallest set of claims that explains the symptoms, instead of each by itself.
//!
//! Each odd transaction has a symptom and a unit. A claim of a cause says how likely each symptom is (`symptoms` in
//! `dissectors/diagnoses.toml`), of its unit or of all units of the line. The claims chosen are those of the mixture that makes
//! the symptoms likely enough to pay for each further cause (Bayesian information criterion); weights by expectation
//! maximization. Two claims that explain the same failures do not both stay.

use crate::claim::{Claim, View};
use crate::contrast::Symptom;
use crate::table::{diagnosis, Diagnosis};

/// Causes that are told apart by how frames are damaged. The others are contrasts of circumstances, which no symptom shows.
pub const RIVALS: &[&str] = &["line_noise", "driver_enable", "duplicate_address", "two_masters", "wrong_line_settings"];

/// A cause that the order and the times of requests prove, which no symptom shows: it is given, and explains what it can.
const GIVEN: &str = "two_masters";

/// Symptoms that the rivals compete for.
const SYMPTOMS: &[Symptom] = &[
    Symptom::AnswerStart,
    Symptom::AnswerEnd,
    Symptom::AnswerBit,
    Symptom::AnswerInside,
    Symptom::AnswerWhole,
    Symptom::AnswerShifted,
    Symptom::RequestEnd,
    Symptom::RequestInside,
    Symptom::RequestCrossed,
    Symptom::Collision,
    Symptom::SecondAnswer,
    Symptom::OtherUnit,
    Symptom::OtherLength,
];

/// What no claim explains: any symptom of any unit, this much less likely than by a cause that shows all alike.
const UNEXPLAINED: f64 = 0.1;

/// A symptom of another unit than that of the claim.
const ELSEWHERE: f64 = 1e-4;

/// Steps of expectation maximization: the weights change little after these.
const STEPS: usize = 20;

/// The symptoms of one unit, counted.
struct Cell {
    symptom: Symptom,
    unit: Option<u8>,
    count: f64,
}

/// The symptoms of a bus, and how many units share them.
struct Evidence {
    cells: Vec<Cell>,
    units: f64,
}

impl Evidence {
    fn of(view: &View<'_>) -> Self {
        let all = view.bus.symptoms.all().filter(|(symptom, _, _)| SYMPTOMS.contains(symptom));
        let cells = all.map(|(symptom, unit, tally)| Cell { symptom, unit, count: tally.failed as f64 }).collect();
        Self { cells, units: view.units().count().max(1) as f64 }
    }

    /// How likely a claim makes a cell.
    fn likelihood(&self, claim: &Claim, cause: &Diagnosis, cell: &Cell) -> f64 {
        match claim.unit {
            Some(unit) if cell.unit != Some(unit) => ELSEWHERE,
            Some(_) => cause.rate(cell.symptom),
            None => cause.rate(cell.symptom) / self.units,
        }
    }

    /// The logarithm of the likelihood of all cells under the best mixture of these claims, and the failures that each explains.
    fn fit(&self, claims: &[&Claim]) -> (f64, Vec<f64>) {
        let unexplained = UNEXPLAINED / SYMPTOMS.len() as f64 / self.units;
        let causes: Vec<&Diagnosis> = claims.iter().filter_map(|claim| diagnosis(claim.code)).collect();
        let likelihoods = |cell: &Cell| -> Vec<f64> {
            let of_claims = claims.iter().zip(&causes).map(|(claim, cause)| self.likelihood(claim, cause, cell));
            of_claims.chain([unexplained]).collect()
        };
        let table: Vec<(f64, Vec<f64>)> = self.cells.iter().map(|cell| (cell.count, likelihoods(cell))).collect();
        let parts = claims.len() + 1;
        let mut weights = vec![1.0 / parts as f64; parts];
        let mut explained = vec![0.0; parts];
        let mut fit = 0.0;
        for _ in 0..STEPS {
            (fit, explained) = (0.0, vec![0.0; parts]);
            for (count, row) in &table {
                let sum: f64 = row.iter().zip(&weights).map(|(one, weight)| one * weight).sum();
                fit += count * sum.ln();
                for ((own, one), weight) in explained.iter_mut().zip(row).zip(&weights) {
                    *own += count * one * weight / sum;
                }
            }
            let all: f64 = explained.iter().sum::<f64>().max(1.0);
            weights = explained.iter().map(|own| own / all).collect();
        }
        (fit, explained)
    }
}

/// The claims without those rivals that explain nothing the others do not explain better.
pub fn smallest(view: &View<'_>, claims: Vec<Claim>) -> Vec<Claim> {
    let is_rival = |claim: &Claim| RIVALS.contains(&claim.code);
    if claims.iter().filter(|claim| is_rival(claim)).count() < 2 {
        return claims;
    }
    let evidence = Evidence::of(view);
    let rivals: Vec<&Claim> = claims.iter().filter(|claim| is_rival(claim)).collect();
    let total: f64 = evidence.cells.iter().map(|cell| cell.count).sum();
    let price = 2.0 + total.max(1.0).ln() / 2.0;
    let mut chosen: Vec<&Claim> = rivals.iter().filter(|claim| claim.code == GIVEN).copied().collect();
    let mut fit = evidence.fit(&chosen).0;
    loop {
        let rest = rivals.iter().filter(|claim| !chosen.iter().any(|one| std::ptr::eq(*one, **claim)));
        let tried = rest.map(|claim| (evidence.fit(&[chosen.as_slice(), &[*claim]].concat()).0, *claim));
        let Some((better, claim)) = tried.max_by(|one, other| one.0.total_cmp(&other.0)) else { break };
        if better < fit + price && !chosen.is_empty() {
            break;
        }
        chosen.push(claim);
        fit = better;
    }
    let kept: Vec<bool> =
        claims.iter().map(|claim| !is_rival(claim) || chosen.iter().any(|one| std::ptr::eq(*one, claim))).collect();
    claims.into_iter().zip(kept).filter_map(|(claim, kept)| kept.then_some(claim)).collect()
}
