//! What the values of points say of each other, as equations with their residuals; and how each point moved. It is for people
//! who look at it: nothing is concluded from it.

use crate::learn::conclude::{CourseReader, Learned};
use crate::learn::layout::best_blocks;
use crate::learn::observed::ObservedTable;
use crate::learn::relations::{integral_factor, steady_share};
use crate::learn::role::{Course, Role};

/// A point that others give.
#[derive(Clone, Debug, PartialEq)]
pub struct Equation {
    /// How: `sum`, `product` or `integral`.
    pub kind: &'static str,
    /// The address of the point.
    pub point: u16,
    /// The addresses of the others.
    pub of: Vec<u16>,
    /// What their sum, product or integral (over hours) is multiplied by, in raw numbers.
    pub factor: f64,
    /// What is left over, as a share.
    pub residual: f64,
}

/// The smallest and the largest number of a part of the time; `None` where nothing was kept.
pub type Span = Option<(f64, f64)>;

/// How a table moved, and the equations between its points.
#[derive(Clone, Debug, Default)]
pub struct Movements {
    /// Of each point, for each part of the time.
    pub spans: Vec<Vec<Span>>,
    /// The equations.
    pub equations: Vec<Equation>,
}

/// Points on either side among which others are looked for.
const REACH: usize = 12;

/// Sums and products may be wrong by this share.
const MOST_RESIDUAL: f64 = 0.02;

/// The movements of the points that were learnt of a table, in so many parts of the time.
pub fn movements(table: &ObservedTable, learned: &[Learned], parts: usize) -> Movements {
    let best = best_blocks(table);
    let mut reader = CourseReader::new(table, &best, learned.len());
    let courses: Vec<Course<'_>> = learned.iter().map(|one| reader.course(&one.layout)).collect();
    let spans = courses.iter().map(|course| spans(course, parts)).collect();
    let has_role = |role: Role| (0..learned.len()).filter(move |&i| learned[i].role.is_some_and(|known| known.0 == role));
    let moving: Vec<usize> = has_role(Role::Measurement).collect();
    let mut equations: Vec<Equation> = Vec::new();
    let equation = |kind, point: usize, of: &[usize], factor, residual| Equation {
        kind,
        point: learned[point].layout.address,
        of: of.iter().map(|&at| learned[at].layout.address).collect(),
        factor,
        residual,
    };
    for (n, &point) in moving.iter().enumerate() {
        let near = &moving[n.saturating_sub(REACH)..(n + REACH + 1).min(moving.len())];
        let sums = near.windows(3).filter(|three| !three.contains(&point)).filter_map(|three| {
            let (factor, residual) = sum(&courses[point], [0, 1, 2].map(|at| &courses[three[at]]))?;
            Some(equation("sum", point, three, factor, residual))
        });
        equations.extend(least(sums));
        if learned[point].scale.is_some_and(|scale| scale.quantity == Some("voltage")) {
            let others = || near.iter().copied().filter(|&other| other != point);
            let pairs = others().flat_map(|i| others().filter(move |&p| p != i).map(move |p| (i, p)));
            let products = pairs.filter_map(|(i, p)| {
                let (share, residual) = product([point, i, p].map(|at| &courses[at]))?;
                Some(equation("product", p, &[point, i], share, residual))
            });
            equations.extend(least(products));
        }
    }
    for total in has_role(Role::Counter) {
        let place = moving.partition_point(|&point| point < total);
        let near = &moving[place.saturating_sub(2 * REACH)..(place + 2 * REACH).min(moving.len())];
        let integrals = near.iter().filter_map(|&rate| {
            let (factor, residual) = integral_factor(&courses[total], &courses[rate])?;
            Some(equation("integral", total, &[rate], 1.0 / factor, residual))
        });
        equations.extend(least(integrals));
    }
    Movements { spans, equations }
}

/// The equation with the least residual.
fn least(equations: impl Iterator<Item = Equation>) -> Option<Equation> {
    equations.min_by(|one, other| one.residual.total_cmp(&other.residual))
}

/// The smallest and the largest number in each part of the time.
fn spans(course: &Course<'_>, parts: usize) -> Vec<Span> {
    let mut found = vec![None; parts];
    let (Some(&first), Some(&last)) = (course.seconds.first(), course.seconds.last()) else { return found };
    for (&second, &number) in course.seconds.iter().zip(&course.numbers) {
        let share = if last > first { (second - first) / (last - first) } else { 0.0 };
        let span = &mut found[((share * parts as f64) as usize).min(parts - 1)];
        *span = Some(span.map_or((number, number), |(low, high): (f64, f64)| (low.min(number), high.max(number))));
    }
    found
}

/// The power of ten that makes a point the sum of three, and the residual, if it is one and the three vary on their own.
fn sum(total: &Course<'_>, parts: [&Course<'_>; 3]) -> Option<(f64, f64)> {
    if parts.iter().any(|part| part.kind != parts[0].kind || !part.is_in_step_with(total)) {
        return None;
    }
    let sums: Vec<f64> = (0..total.numbers.len()).map(|row| parts.iter().map(|part| part.numbers[row]).sum()).collect();
    let (factor, residual) = in_proportion(&total.numbers, &sums)?;
    let alone = parts.iter().filter_map(|part| in_proportion(&total.numbers, &part.numbers)).map(|fit| fit.1);
    let power = 10f64.powf(factor.log10().round());
    let is_power = (factor / power - 1.0).abs() < MOST_RESIDUAL;
    (is_power && residual < alone.fold(f64::MAX, f64::min) / 3.0).then_some((power, residual))
}

/// The share of a product of two that a third is, and the residual, if the product explains it better than one alone.
fn product([one, other, third]: [&Course<'_>; 3]) -> Option<(f64, f64)> {
    steady_share(&[one, other, third])?;
    let products: Vec<f64> = one.numbers.iter().zip(&other.numbers).map(|(one, other)| one * other).collect();
    let (share, residual) = in_proportion(&third.numbers, &products)?;
    let (_, alone) = in_proportion(&third.numbers, &other.numbers)?;
    (residual < alone).then_some((share, residual))
}

/// The factor between two rows of numbers, and the mean difference as a share of the mean.
fn in_proportion(numbers: &[f64], of: &[f64]) -> Option<(f64, f64)> {
    let (whole, sum): (f64, f64) = (numbers.iter().sum(), of.iter().sum());
    let factor = whole / sum;
    let left: f64 = numbers.iter().zip(of).map(|(number, of)| (number - factor * of).abs()).sum();
    let residual = left / whole.abs();
    (numbers.len() >= 16 && factor > 0.0 && residual < MOST_RESIDUAL).then_some((factor, residual))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::conclude;

    /// Three phases of the mains with currents and powers, and their sum: an hour, polled each ten seconds.
    #[test]
    fn sums_and_products_are_found_with_what_is_left_over() {
        let mut table = ObservedTable::default();
        for i in 0..360i64 {
            let wave = |phase: f64, slow: f64| (i as f64 / slow + phase).sin();
            let volts = [0, 1, 2].map(|phase| 230.0 + 3.0 * wave(f64::from(phase) * 1.9, 17.0));
            let amps = [0, 1, 2].map(|phase| 6.0 + 3.0 * wave(f64::from(phase) * 2.3, 31.0 + 5.0 * f64::from(phase)));
            let watts = [0, 1, 2].map(|phase| 0.95 * volts[phase] * amps[phase]);
            let words: Vec<u16> = volts.iter().map(|volt| (volt * 10.0) as u16).collect();
            let words = words.into_iter().chain(amps.iter().map(|amp| (amp * 100.0) as u16));
            let words = words.chain(watts.iter().map(|watt| *watt as u16)).chain([watts.iter().sum::<f64>() as u16]);
            table.put(0, &words.collect::<Vec<u16>>(), i * 10_000_000_000, false);
        }
        let found = movements(&table, &conclude(&table, &[]), 12);
        assert!(found.equations.iter().any(|one| one.kind == "sum" && one.point == 9 && one.of == [6, 7, 8]), "{found:?}");
        let product = found.equations.iter().find(|one| one.of == [0, 3]).unwrap();
        assert!(product.point == 6 && (product.factor / 0.000_95 - 1.0).abs() < 0.01 && product.residual < 0.01);
        assert_eq!(found.spans[0].len(), 12);
        let (low, high) = found.spans[0][0].unwrap();
        assert!(low < high && low >= 2270.0 && high <= 2330.0);
    }
}
