//! Relations between points: a power is voltage times current, a total is the integral of a rate, a voltage is the sum of
//! cells. They carry a scale from one point to another, and say what a point is.

use std::collections::BTreeSet;

use crate::learn::role::{Course, Role};
use crate::learn::scale::{mains_factor, Scale};

/// The stretches of time in which a total is compared with an integral, and the steps of the total that each has at least.
const STRETCHES: std::ops::RangeInclusive<usize> = 3..=12;
const STRETCH_STEPS: usize = 8;

/// The least steps of a total: fewer are too coarse.
const LEAST_STEPS: f64 = 24.0;

/// By how much sums over the stretches may differ, as a share of all.
const MOST_RESIDUAL: f64 = 0.05;

/// By how much the rate has to vary from stretch to stretch: a constant one fits every total that rises evenly.
const LEAST_VARIATION: f64 = 0.08;

/// The pairs of points that are compared in one kind of relation. Of more, those are compared that lie near each other,
/// so the work is at most in proportion to the points.
const MOST_PAIRS: usize = 100_000;

/// The points that are always compared with another one.
const LEAST_NEAREST: usize = 8;

/// Points and what is known of each.
type Points<'a, 'b> = &'a [(Course<'b>, Option<Role>)];

/// Adds to scales and quantities what relations show; gives the points that relations show to be totals.
pub(super) fn relate(points: Points<'_, '_>, scales: &mut [Option<Scale>]) -> BTreeSet<usize> {
    sums_of_cells(points, scales);
    lone_voltages(points, scales);
    products(points, scales);
    integrals(points, scales)
}

/// The points that go up and down.
fn measurements<'a>(points: Points<'a, '_>) -> impl Iterator<Item = usize> + 'a {
    (0..points.len()).filter(|&i| points[i].1 == Some(Role::Measurement))
}

/// Of points in the order of their addresses, at most so many, nearest to another point; but never fewer than eight.
fn nearest(sorted: &[usize], point: usize, most: usize) -> &[usize] {
    let most = most.max(LEAST_NEAREST);
    let from = sorted.partition_point(|&other| other < point).saturating_sub(most / 2);
    let from = from.min(sorted.len().saturating_sub(most));
    &sorted[from..sorted.len().min(from + most)]
}

/// Voltages that are the sum of the cells of a battery.
fn sums_of_cells(points: Points<'_, '_>, scales: &mut [Option<Scale>]) {
    let is_cell = |i: &usize| scales[*i].is_some_and(|scale| scale.reason == "cells of a battery");
    let cells: Vec<usize> = (0..points.len()).filter(is_cell).collect();
    let Some(&first) = cells.first() else { return };
    if cells.iter().any(|&cell| !points[cell].0.is_in_step_with(&points[first].0)) {
        return;
    }
    let sum = |row: usize| cells.iter().map(|&cell| points[cell].0.numbers[row] * 0.001).sum::<f64>();
    for other in measurements(points).filter(|other| !cells.contains(other)) {
        let course = &points[other].0;
        for factor in [0.1, 0.01, 0.001] {
            let is_near = |(row, number): (usize, &f64)| (number * factor / sum(row) - 1.0).abs() < 0.01;
            if course.is_in_step_with(&points[first].0) && course.numbers.iter().enumerate().all(is_near) {
                scales[other] = Some(Scale::of(factor, "V", "voltage", 8.0, "the sum of the cells"));
            }
        }
    }
}

/// The points on either side of a voltage among which its current and power are looked for.
const REACH: usize = 12;

/// Numbers that would be a voltage of the mains, and that times another one are a third one.
fn lone_voltages(points: Points<'_, '_>, scales: &mut [Option<Scale>]) {
    let is_free = |i: &usize| scales[*i].is_none_or(|scale| scale.unit.is_none());
    let all: Vec<usize> = measurements(points).filter(is_free).collect();
    let found = all.iter().enumerate().filter_map(|(n, &voltage)| {
        let factor = mains_factor(&points[voltage].0, points[voltage].1)?;
        let near = &all[n.saturating_sub(REACH)..(n + REACH + 1).min(all.len())];
        let others = || near.iter().filter(|&&other| other != voltage);
        let mut pairs = others().flat_map(|i| others().filter(move |p| *p != i).map(move |p| (*i, *p)));
        let is_product = |(i, p): (usize, usize)| {
            let courses = [voltage, i, p].map(|at| &points[at].0);
            // The share is known but for a power of ten, if all three are integers.
            let share = steady_share(&courses).map(|share| share / factor);
            share.is_some_and(|share| (0.9..1.01).contains(&(share / 10f64.powf(share.log10().round()))))
                && better_than_in_proportion(&courses)
        };
        pairs.any(is_product).then_some((voltage, factor))
    });
    for (voltage, factor) in found.collect::<Vec<_>>() {
        scales[voltage] = Some(Scale::of(factor, "V", "voltage", 7.0, "a voltage of the mains: it gives a power with a current"));
    }
}

/// Whether a product varies less in proportion to the product of both than in proportion to the second one alone.
fn better_than_in_proportion([one, other, product]: &[&Course<'_>; 3]) -> bool {
    let spread = |of: &dyn Fn(usize) -> f64| {
        let ratios: Vec<f64> = (0..one.numbers.len()).map(of).filter(|ratio| ratio.is_finite() && *ratio > 0.0).collect();
        let mean = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
        ratios.iter().map(|ratio| (ratio / mean - 1.0).powi(2)).sum::<f64>() / ratios.len().max(1) as f64
    };
    let alone = spread(&|i| product.numbers[i] / other.numbers[i]);
    spread(&|i| product.numbers[i] / (one.numbers[i] * other.numbers[i])) < alone / 4.0
}

/// Powers that are a voltage of the mains times a current. Both must be floats: of integers, only the ratio is known.
fn products(points: Points<'_, '_>, scales: &mut [Option<Scale>]) {
    let is_voltage = |i: &usize| scales[*i].is_some_and(|scale| scale.quantity == Some("voltage"));
    let voltages: Vec<usize> = measurements(points).filter(is_voltage).collect();
    let is_plain = |i: &usize| scales[*i].is_some_and(|scale| scale.quantity.is_none());
    let plain: Vec<usize> = measurements(points).filter(is_plain).collect();
    // Pairs of a current and a power: their number is the square of the points.
    let most = (MOST_PAIRS / voltages.len().max(1)).isqrt();
    for (&voltage, near) in voltages.iter().map(|voltage| (voltage, nearest(&plain, *voltage, most))) {
        for (&current, &power) in near.iter().flat_map(|i| near.iter().map(move |p| (i, p))).filter(|(i, p)| i != p) {
            let courses = [voltage, current, power].map(|at| &points[at].0);
            let Some(share) = steady_share(&courses) else { continue };
            let share = share / scales[voltage].map_or(1.0, |scale| scale.factor);
            let quantity = match share {
                0.995..1.005 => ("VA", "apparent power"),
                0.8..0.995 => ("W", "active power"),
                _ => continue,
            };
            scales[current] = Some(Scale::of(1.0, "A", "current", 7.0, "with a voltage, it gives a power"));
            if scales[power].is_some_and(|scale| scale.quantity.is_none()) {
                scales[power] = Some(Scale::of(1.0, quantity.0, quantity.1, 7.0, "voltage times current"));
            }
        }
    }
}

/// The share that the third number is of the product of the first two, if it is steady while they move.
pub(super) fn steady_share([one, other, product]: &[&Course<'_>; 3]) -> Option<f64> {
    if one.numbers.len() < 16 || !one.is_in_step_with(other) || !one.is_in_step_with(product) {
        return None;
    }
    let (low, high) = other.range();
    let rows = one.numbers.iter().zip(&other.numbers).zip(&product.numbers);
    let mut shares: Vec<f64> =
        rows.filter(|((_, other), _)| **other > high / 20.0).map(|((one, other), product)| product / (one * other)).collect();
    shares.sort_by(f64::total_cmp);
    let at = |part: usize| shares.get(shares.len() * part / 10).copied().unwrap_or(f64::NAN);
    let is_steady = shares.len() >= 16 && (at(9) - at(1)).abs() < 0.04 * at(5).abs();
    (is_steady && high > 0.0 && low < 0.7 * high).then(|| at(5))
}

/// Totals that are the integral of a measurement: their scale follows where that of the measurement is known. What only
/// rises is a total if it is one; gives those.
fn integrals(points: Points<'_, '_>, scales: &mut [Option<Scale>]) -> BTreeSet<usize> {
    let is_free = |i: &usize| scales[*i].is_none_or(|scale| scale.unit.is_none());
    let may_be_total = |i: &usize| match points[*i].1 {
        None => points[*i].0.only_rises(),
        role => role == Some(Role::Counter),
    };
    let totals: Vec<usize> = (0..points.len()).filter(may_be_total).filter(is_free).collect();
    let is_no_rate = |i: &usize| {
        scales[*i].is_some_and(|scale| matches!(scale.quantity, Some("voltage" | "current" | "frequency" | "duration")))
    };
    let (rates, others): (Vec<usize>, Vec<usize>) =
        measurements(points).filter(|i| !is_no_rate(i)).partition(|i| scales[*i].is_some());
    let most = MOST_PAIRS / totals.len().max(1) / 2;
    // What a battery holds is the integral of its current, too, and may rise for hours.
    let has_battery = scales.iter().flatten().any(|scale| scale.reason == "cells of a battery");
    let mut found = BTreeSet::new();
    for total in totals {
        let of_unknown = nearest(&others, total, most).iter();
        let mut all = of_unknown.chain(nearest(&rates, total, most));
        if !has_battery && all.any(|&rate| integral_factor(&points[total].0, &points[rate].0).is_some()) {
            found.insert(total);
        }
        let near = nearest(&rates, total, most).iter();
        let fits = near.filter_map(|&rate| integral_factor(&points[total].0, &points[rate].0).map(|fit| (fit, rate)));
        let mut fits: Vec<((f64, f64), usize)> = fits.collect();
        fits.sort_by(|a, b| a.0 .1.total_cmp(&b.0 .1));
        // Several powers fit where phases are alike; they must say the same.
        let Some(&((factor, _), rate)) = fits.first() else { continue };
        if fits.iter().any(|((other, _), _)| (other / factor - 1.0).abs() > 1e-6) {
            continue;
        }
        let (unit, quantity) = match scales[rate].and_then(|scale| scale.quantity) {
            Some("active power") => (Some("Wh"), Some("energy")),
            Some("apparent power") => (Some("VAh"), Some("apparent energy")),
            _ => (None, None),
        };
        let factor = factor * scales[rate].map_or(1.0, |scale| scale.factor);
        let reason = "the integral of a measurement";
        scales[total] = Some(Scale { factor, unit, quantity, bits: 7.0, quantity_bits: 7.0, reason });
    }
    found
}

/// The power of ten that makes a total the integral of a rate over hours, and the residual as a share.
pub(super) fn integral_factor(total: &Course<'_>, rate: &Course<'_>) -> Option<(f64, f64)> {
    let (first, last) = (total.seconds.first()?.max(*rate.seconds.first()?), total.seconds.last()?.min(*rate.seconds.last()?));
    let mut integral = vec![0.0];
    for (times, numbers) in rate.seconds.windows(2).zip(rate.numbers.windows(2)) {
        let hours = (times[1] - times[0]) / 3600.0;
        integral.push(integral[integral.len() - 1] + hours * (numbers[0].max(0.0) + numbers[1].max(0.0)) / 2.0);
    }
    let mut different = total.numbers.clone();
    different.dedup();
    let stretches = (different.len() / STRETCH_STEPS).clamp(*STRETCHES.start(), *STRETCHES.end());
    let at = |i: usize| first + (last - first) * i as f64 / stretches as f64;
    let steps = |seconds: &[f64], numbers: &[f64]| -> Vec<f64> {
        (0..stretches).map(|i| value_at(seconds, numbers, at(i + 1)) - value_at(seconds, numbers, at(i))).collect()
    };
    let (parts, rises) = (steps(&rate.seconds, &integral), steps(&total.seconds, &total.numbers));
    let (sum, rise) = (parts.iter().sum::<f64>(), rises.iter().sum::<f64>());
    if last <= first || sum <= 0.0 || rise <= 0.0 || (different.len() as f64) < LEAST_STEPS {
        return None;
    }
    let ratio = sum / rise;
    let factor = 10f64.powf(ratio.log10().round());
    let residual = parts.iter().zip(&rises).map(|(part, rise)| (part - ratio * rise).abs()).sum::<f64>() / sum;
    let mean = sum / stretches as f64;
    let variation = parts.iter().map(|part| (part - mean).abs()).sum::<f64>() / sum;
    let fits = (ratio / factor - 1.0).abs() < 0.03 && residual < MOST_RESIDUAL && variation > LEAST_VARIATION;
    (fits && residual < variation / 3.0).then_some((factor, residual))
}

/// The number at a time, between two samples in proportion.
fn value_at(seconds: &[f64], numbers: &[f64], time: f64) -> f64 {
    let after = seconds.partition_point(|&second| second < time).clamp(1, seconds.len() - 1);
    let (from, to) = (seconds[after - 1], seconds[after]);
    let share = if to > from { ((time - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
    numbers[after - 1] + share * (numbers[after] - numbers[after - 1])
}
