//! A scale that a second source showed, such as a display: it holds for the point, for neighbours like it, and by
//! voltage times current for what belongs to it.

use crate::learn::relations::steady_share;
use crate::learn::role::{Course, Role};
use crate::learn::scale::Scale;

/// The scale of a point that is known from elsewhere.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    /// The address of the point.
    pub address: u16,
    /// The factor from the raw value to the unit.
    pub factor: f64,
    /// The evidence for it, in bits.
    pub bits: f64,
}

/// By which factor the means of neighbours may differ that have the same scale.
const MOST_UNLIKE: f64 = 1.5;

/// Points on either side of an anchored one that may be the others of voltage, current and power.
const REACH: usize = 16;

/// The evidence for a scale that follows from an anchored one, in bits, at most.
const MOST_BITS: f64 = 5.0;

/// The share of voltage times current that a power is.
const SHARES: std::ops::Range<f64> = 0.8..1.005;

type Points<'a, 'b> = &'a [(Course<'b>, Option<Role>)];

/// Sets the scale of an anchored point and of its group; gives the points whose scale was set.
pub(super) fn apply(points: Points<'_, '_>, at: usize, anchor: &Anchor, scales: &mut [Option<Scale>]) {
    let known = scales[at].filter(|scale| (scale.factor / anchor.factor - 1.0).abs() < 1e-6);
    scales[at] = Some(Scale {
        factor: anchor.factor,
        unit: known.and_then(|scale| scale.unit),
        quantity: known.and_then(|scale| scale.quantity),
        bits: anchor.bits,
        quantity_bits: known.map_or(0.0, |scale| scale.quantity_bits),
        reason: "a second source showed its value",
    });
    let follows = |reason| Scale {
        factor: anchor.factor,
        unit: None,
        quantity: None,
        bits: anchor.bits.min(MOST_BITS),
        quantity_bits: 0.0,
        reason,
    };
    let is_alike = |other: &usize| {
        let (one, other) = (&points[at], &points[*other]);
        let ratio = mean(&other.0) / mean(&one.0);
        other.0.kind == one.0.kind && other.1 == Some(Role::Measurement) && (1.0 / MOST_UNLIKE..MOST_UNLIKE).contains(&ratio)
    };
    let after = (at + 1..points.len()).take_while(is_alike);
    let before = (0..at).rev().take_while(is_alike);
    let group: Vec<usize> = after.chain(before).collect();
    for &other in &group {
        if scales[other].is_none_or(|scale| scale.unit.is_none()) {
            scales[other] = Some(follows("like its neighbour, which a second source showed"));
        }
    }
    for at in group.into_iter().chain([at]) {
        third_of_a_product(points, at, scales);
    }
}

/// Of voltage, current and power near an anchored point: where two scales are known, the third follows.
fn third_of_a_product(points: Points<'_, '_>, at: usize, scales: &mut [Option<Scale>]) {
    let range = at.saturating_sub(REACH)..(at + REACH + 1).min(points.len());
    let near: Vec<usize> = range.filter(|&i| points[i].1 == Some(Role::Measurement)).collect();
    let is_voltage = |i: &usize| scales[*i].is_some_and(|scale| scale.quantity == Some("voltage"));
    let voltages: Vec<usize> = near.iter().copied().filter(is_voltage).collect();
    for &voltage in &voltages {
        for &current in near.iter().filter(|&&i| i != voltage) {
            for &power in near.iter().filter(|&&p| p != voltage && p != current) {
                let (i, p) = (scales[current].map(|scale| scale.factor), scales[power].map(|scale| scale.factor));
                if (i.is_some() == p.is_some()) || (current != at && power != at) {
                    continue;
                }
                let courses = [voltage, current, power].map(|at| &points[at].0);
                let Some(share) = steady_share(&courses) else { continue };
                let volts = scales[voltage].map_or(1.0, |scale| scale.factor);
                let third = if i.is_some() { power } else { current };
                // The factor that makes the power a plausible share of voltage times current.
                let whole = i.map_or_else(|| p.map_or(0.0, |p| p * share / volts), |i| volts * i / share);
                let factor = (-4..=4).map(|power| 10f64.powi(power)).find(|factor| {
                    let share = if i.is_some() { factor / whole } else { whole / factor };
                    SHARES.contains(&share)
                });
                if let Some(factor) = factor {
                    let (unit, quantity) = if i.is_some() { ("W", "active power") } else { ("A", "current") };
                    scales[third] = Some(Scale::of(factor, unit, quantity, MOST_BITS, "voltage times current"));
                }
            }
        }
    }
}

fn mean(course: &Course<'_>) -> f64 {
    course.numbers.iter().sum::<f64>() / course.numbers.len().max(1) as f64
}
