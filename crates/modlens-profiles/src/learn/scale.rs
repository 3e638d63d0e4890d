//! Decides scale and quantity where something fixes the absolute size: the mains, cells of batteries, the time. What
//! only a habit suggests is not claimed.

use crate::learn::role::{is_rate, Course, Role};
use crate::profile::Type;

/// What a number stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The factor from the raw value to the unit.
    pub factor: f64,
    /// The unit.
    pub unit: Option<&'static str>,
    /// The quantity.
    pub quantity: Option<&'static str>,
    /// The evidence for the factor, in bits.
    pub bits: f64,
    /// The evidence for the quantity, in bits.
    pub quantity_bits: f64,
    /// The evidence as text.
    pub reason: &'static str,
}

impl Scale {
    pub(super) fn of(factor: f64, unit: &'static str, quantity: &'static str, bits: f64, reason: &'static str) -> Self {
        Self { factor, unit: Some(unit), quantity: Some(quantity), bits, quantity_bits: bits, reason }
    }
}

/// A range of values that fixes what a register is: its limits in units, the largest share by which it varies.
struct Anchor {
    unit: &'static str,
    quantity: &'static str,
    low: f64,
    high: f64,
    spread: f64,
    /// How many like it must stand beside each other.
    alike: usize,
    factors: &'static [f64],
    bits: f64,
    reason: &'static str,
}

const ANCHORS: [Anchor; 5] = [
    Anchor {
        unit: "Hz",
        quantity: "frequency",
        low: 49.5,
        high: 50.5,
        spread: 0.012,
        alike: 1,
        factors: &[0.01, 0.001, 1.0],
        bits: 8.0,
        reason: "the frequency of the mains",
    },
    Anchor {
        unit: "Hz",
        quantity: "frequency",
        low: 59.5,
        high: 60.5,
        spread: 0.012,
        alike: 1,
        factors: &[0.01, 0.001, 1.0],
        bits: 8.0,
        reason: "the frequency of the mains",
    },
    Anchor {
        unit: "V",
        quantity: "voltage",
        low: 216.0,
        high: 246.0,
        spread: 0.12,
        alike: 3,
        factors: &[0.1, 0.01, 0.001, 1.0],
        bits: 8.0,
        reason: "three voltages of the mains",
    },
    Anchor {
        unit: "V",
        quantity: "voltage",
        low: 375.0,
        high: 426.0,
        spread: 0.12,
        alike: 3,
        factors: &[0.1, 0.01, 0.001, 1.0],
        bits: 7.0,
        reason: "three voltages of the mains",
    },
    Anchor {
        unit: "V",
        quantity: "voltage",
        low: 2.6,
        high: 3.7,
        spread: 0.35,
        alike: 6,
        factors: &[0.001],
        bits: 8.0,
        reason: "cells of a battery",
    },
];

/// The scale of each point, given with its address.
pub(super) fn scales(courses: &[(Course<'_>, Option<Role>)], addresses: &[u16]) -> Vec<Option<Scale>> {
    let mut found: Vec<Option<Scale>> = courses.iter().map(|(course, role)| by_itself(course, *role)).collect();
    for anchor in &ANCHORS {
        for &factor in anchor.factors {
            // Upper halves that stay zero may lie between registers that are alike.
            let moving = courses.iter().enumerate().filter(|(_, (course, _))| !course.is_constant());
            let fits: Vec<(usize, bool)> = moving.map(|(i, (course, role))| (i, fits(anchor, factor, course, *role))).collect();
            for run in fits.chunk_by(|a, b| a.1 == b.1) {
                if !run[0].1 {
                    continue;
                }
                let run = alike(courses, run.iter().map(|(i, _)| *i).collect());
                if run.len() >= anchor.alike && (anchor.alike > 1 || run.len() <= 2) {
                    for i in &run {
                        found[*i] = Some(Scale::of(factor, anchor.unit, anchor.quantity, anchor.bits, anchor.reason));
                    }
                }
            }
            if anchor.alike == PHASES {
                let fitting: Vec<usize> = fits.iter().filter(|(_, fits)| *fits).map(|(i, _)| *i).collect();
                for i in alike(courses, at_equal_distances(courses, addresses, &fitting)) {
                    found[i] = found[i].or(Some(Scale::of(factor, anchor.unit, anchor.quantity, anchor.bits, anchor.reason)));
                }
            }
        }
    }
    found
}

/// Voltages of the mains are three.
const PHASES: usize = 3;

/// The registers from one phase to the next, at most.
const MOST_DISTANCE: u16 = 40;

/// Of points in the order of their addresses, those that are one of three of a type at equal distances: the voltages of
/// phases whose other values are in between.
fn at_equal_distances(courses: &[(Course<'_>, Option<Role>)], addresses: &[u16], fitting: &[usize]) -> Vec<usize> {
    let mut found = Vec::new();
    for (n, &first) in fitting.iter().enumerate() {
        let near = |other: usize| addresses[other] - addresses[first] <= MOST_DISTANCE;
        for &second in fitting[n + 1..].iter().take_while(|other| near(**other)) {
            let third = addresses[second].checked_add(addresses[second] - addresses[first]);
            let third = third.and_then(|third| addresses.binary_search(&third).ok()).filter(|third| fitting.contains(third));
            let kind = |at: usize| courses[at].0.kind;
            if let Some(third) = third.filter(|third| kind(first) == kind(second) && kind(first) == kind(*third)) {
                found.extend([first, second, third]);
            }
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}

/// By what share cells, or phases, may differ from the middle one.
const MOST_UNLIKE: f64 = 0.08;

/// The points whose middle is near that of all.
fn alike(courses: &[(Course<'_>, Option<Role>)], run: Vec<usize>) -> Vec<usize> {
    let middle = |at: usize| {
        let (low, high) = courses[at].0.range();
        f64::midpoint(low, high)
    };
    let mut middles: Vec<f64> = run.iter().map(|&at| middle(at)).collect();
    middles.sort_by(f64::total_cmp);
    let median = middles.get(middles.len() / 2).copied().unwrap_or(f64::NAN);
    run.into_iter().filter(|&at| (middle(at) / median - 1.0).abs() <= MOST_UNLIKE).collect()
}

/// A factor that makes a point a voltage of the mains by its range alone.
pub(super) fn mains_factor(course: &Course<'_>, role: Option<Role>) -> Option<f64> {
    let voltages = ANCHORS.iter().filter(|anchor| anchor.alike == PHASES);
    let mut factors = voltages.flat_map(|anchor| anchor.factors.iter().map(move |factor| (anchor, *factor)));
    factors.find(|(anchor, factor)| fits(anchor, *factor, course, role)).map(|(_, factor)| factor)
}

/// Whether a point moves in the range of an anchor.
fn fits(anchor: &Anchor, factor: f64, course: &Course<'_>, role: Option<Role>) -> bool {
    let is_float = matches!(course.kind, Type::F32 | Type::F64);
    if role != Some(Role::Measurement) || (is_float && (factor - 1.0).abs() > 1e-9) {
        return false;
    }
    let (low, high) = course.range();
    let (low, high) = (low * factor, high * factor);
    // An integer without decimals has too few digits: it may be a temperature or a share.
    let is_fine = is_float || factor < 1.0;
    is_fine && anchor.low <= low && high <= anchor.high && high > low && (high - low) / high <= anchor.spread
}

/// What the point alone says: floats are in their unit, and what rises by one a second is a time.
fn by_itself(course: &Course<'_>, role: Option<Role>) -> Option<Scale> {
    let plain = |factor, unit, quantity, reason| Scale { factor, unit, quantity, bits: 7.0, quantity_bits: 7.0, reason };
    match (course.kind, role?) {
        (_, Role::Counter) if !course.is_constant() && course.numbers.len() >= 8 && is_rate(course.rate(), 1.0) => {
            Some(plain(1.0, Some("s"), Some("duration"), "rises by one a second"))
        }
        (_, Role::Counter) if course.rises_evenly() => {
            let hours = [1.0, 0.1, 0.01].into_iter().find(|hours| is_rate(course.rate() * 3600.0, 1.0 / hours));
            hours.map(|hours| plain(hours, Some("h"), Some("duration"), "rises evenly, by hours"))
        }
        (Type::F32 | Type::F64, Role::Measurement) => Some(plain(1.0, None, None, "a float, which needs no scale")),
        _ => None,
    }
}
