//! The time at which the remaining candidates differ most: the next look at the display that decides.

use crate::find::candidate::Candidate;
use crate::find::series::{BlockSeries, Column, Variant};

/// The number of times that are tried, and of candidates that are compared.
const TIMES: i64 = 600;
const COMPARED: usize = 6;

/// Candidates with less than this probability are not worth a look.
const LEAST: f64 = 0.003;

/// A time at which candidates differ.
#[derive(Clone, Debug)]
pub struct Look {
    /// The time in nanoseconds since 1970.
    pub time: i64,
    /// The scaled value of each candidate at that time, best candidate first.
    pub values: Vec<f64>,
}

/// Returns the time in the recording at which the candidates differ most, or `None` if fewer than two are left or all
/// have the same values throughout.
pub fn best_time_to_look(blocks: &[BlockSeries], variants: &[Variant], candidates: &[Candidate]) -> Option<Look> {
    let compared: Vec<&Candidate> = candidates.iter().take(COMPARED).filter(|one| one.chance >= LEAST).collect();
    if compared.len() < 2 {
        return None;
    }
    let columns: Vec<Column<'_>> = compared.iter().map(|one| Column::new(blocks, variants, one.reading)).collect();
    let first = columns.iter().map(|column| column.block.times[0]).max()?;
    let last = columns.iter().map(|column| column.block.times[column.block.len() - 1]).min()?;
    let (mut best, mut found): (f64, Option<Look>) = (0.0, None);
    for step in 0..=TIMES {
        let time = first + (last - first) / TIMES * step;
        let numbers = |(column, one): (&Column<'_>, &&Candidate)| {
            let raw = column.get(column.block.at_or_before(time));
            raw * one.scale + one.offset
        };
        let values: Vec<f64> = columns.iter().zip(&compared).map(numbers).collect();
        let difference = difference(&values, &compared);
        if difference > best * 1.02 {
            (best, found) = (difference, Some(Look { time, values }));
        }
    }
    found
}

/// How well the values separate the candidates: pairs that differ, by their probabilities, more for larger differences.
fn difference(values: &[f64], candidates: &[&Candidate]) -> f64 {
    let mut total = 0.0;
    for (i, a) in values.iter().enumerate() {
        for (j, b) in values.iter().enumerate().skip(i + 1) {
            let size = a.abs().max(b.abs());
            let relative = if size > 0.0 { (a - b).abs() / size } else { 0.0 };
            if relative > 1e-3 {
                total += candidates[i].chance * candidates[j].chance * (0.5 + relative.min(1.0));
            }
        }
    }
    total
}
