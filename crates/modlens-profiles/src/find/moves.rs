//! How well a reading explains that a value went up or down, changed, or stayed.

use crate::find::query::{Change, Move};
use crate::find::series::Column;

/// The samples from which the range of a series is taken.
const SAMPLES: usize = 256;

/// The log2 probability of all changes, if the reading is the value. Returns `None` if nothing was recorded at a time.
pub fn bits(column: &Column<'_>, moves: &[Move]) -> Option<f64> {
    let mut total = 0.0;
    let mut range = None;
    for one in moves {
        let block = column.block;
        if !block.covers(one.from) || !block.covers(one.to) {
            return None;
        }
        let change = column.get(block.at_or_before(one.to)) - column.get(block.at_or_before(one.from));
        // A display may be newer than the poll before it.
        let later = column.get(block.after(one.to)) - column.get(block.after(one.from));
        if change.is_nan() || later.is_nan() {
            return None;
        }
        let range = *range.get_or_insert_with(|| spread(column));
        let mut likelihood = 0.8 * chance(one.change, change, range) + 0.2 * chance(one.change, later, range);
        if one.change == Change::Same {
            likelihood *= 0.3 + 0.7 * stayed(column, one);
        }
        total += likelihood.log2();
    }
    Some(total)
}

/// The share of samples in between that have the value of the first time: who says that a value stayed has seen it.
fn stayed(column: &Column<'_>, one: &Move) -> f64 {
    let (first, last) = (column.block.at_or_before(one.from), column.block.at_or_before(one.to));
    let value = column.get(first);
    let stride = ((last - first) / SAMPLES).max(1);
    let (mut same, mut all) = (0, 0);
    for sample in (first..=last).step_by(stride) {
        same += u32::from(column.get(sample).to_bits() == value.to_bits());
        all += 1;
    }
    f64::from(same) / f64::from(all)
}

/// The probability that a person reports this change, given that the value changed by so much.
fn chance(reported: Change, change: f64, range: f64) -> f64 {
    let visible = (change.abs() / range.max(f64::MIN_POSITIVE) * 20.0).min(1.0);
    let seen = 0.4 + 0.6 * visible;
    match reported {
        Change::Up if change > 0.0 => seen,
        Change::Down if change < 0.0 => seen,
        Change::Changed if change != 0.0 => seen,
        Change::Same if change == 0.0 => 0.95,
        Change::Same => 0.12 * (1.0 - visible) + 0.002,
        _ if change == 0.0 => 0.01,
        _ => 0.03 * (1.0 - visible) + 0.002,
    }
}

/// The distance between the smallest and the largest number.
fn spread(column: &Column<'_>) -> f64 {
    let numbers = column.spread(SAMPLES);
    let (mut low, mut high) = (f64::MAX, f64::MIN);
    for number in numbers.into_iter().filter(|number| !number.is_nan()) {
        (low, high) = (low.min(number), high.max(number));
    }
    (high - low).max(0.0)
}
