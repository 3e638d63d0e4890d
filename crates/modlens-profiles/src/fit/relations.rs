//! Relations among the values of a profile: a power is voltage times current, a total is the sum of its phases.

use std::collections::BTreeMap;

use crate::fit::evidence::Verdict;
use crate::fit::series::Series;
use crate::points::CompiledPoint;
use crate::profile::Point;

/// The evidence of a relation that holds, and of one that does not, in bits.
const RELATION_BITS: f64 = 5.0;

/// Samples that a relation needs, and products below which currents are too small to say anything, in volt-amperes.
const LEAST_SAMPLES: usize = 3;
const LEAST_PRODUCT: f64 = 20.0;

/// By how much a sum may differ: the phases are not measured at the same moment.
const MOST_DIFFERENCE: f64 = 0.05;

/// By which factor the voltages of phases may differ.
const MOST_UNLIKE: f64 = 1.5;

/// The words of a name that tell phases and strings apart.
const PHASES: [&str; 17] =
    ["l1", "l2", "l3", "a", "b", "c", "r", "s", "t", "1", "2", "3", "pv1", "pv2", "phase1", "phase2", "phase3"];

/// A point of the profile that was asked for.
pub(super) struct AskedPoint<'a> {
    pub compiled: &'a CompiledPoint,
    pub point: &'a Point,
    pub series: Series,
    pub verdict: Verdict,
}

/// What relations say.
#[derive(Debug, Default)]
pub(super) struct Related {
    pub bits: f64,
    /// The relations that hold, as text.
    pub holding: Vec<String>,
    /// The relations that do not.
    pub broken: Vec<String>,
}

impl Related {
    fn add(&mut self, holds: bool, text: String) {
        self.bits += if holds { RELATION_BITS } else { -RELATION_BITS };
        if holds {
            self.holding.push(text);
        } else {
            self.broken.push(format!("not {text}"));
        }
    }
}

/// Tests the relations that the names and units of a profile promise.
pub(super) fn of(asked: &[AskedPoint<'_>]) -> Related {
    let mut phases: BTreeMap<&str, Vec<&AskedPoint<'_>>> = BTreeMap::new();
    let useful = |one: &&AskedPoint<'_>| !matches!(one.verdict, Verdict::Contradicts(_)) && one.compiled.factor.is_none();
    for one in asked.iter().filter(useful) {
        if let Some(phase) = phase(&one.point.name) {
            phases.entry(phase).or_default().push(one);
        }
    }
    let mut found = Related::default();
    for points in phases.values() {
        let [voltage, current, power] = ["V", "A", "W"].map(|unit| only(points, unit));
        if let (Some(voltage), Some(current), Some(power)) = (voltage, current, power) {
            product(&mut found, voltage, current, power);
        }
    }
    sum(&mut found, asked, &phases);
    alike(&mut found, asked);
    found
}

/// Tests whether the voltages of three phases are alike.
fn alike(found: &mut Related, asked: &[AskedPoint<'_>]) {
    let mut stems: BTreeMap<String, Vec<&AskedPoint<'_>>> = BTreeMap::new();
    for one in asked.iter().filter(|one| one.point.unit.as_deref() == Some("V") && one.compiled.factor.is_none()) {
        let words = one.point.name.split('_');
        let is_phase = |word: &&str| PHASES.iter().any(|phase| word.eq_ignore_ascii_case(phase));
        let (of_phase, rest): (Vec<&str>, Vec<&str>) = words.partition(is_phase);
        if !of_phase.is_empty() && !one.point.name.contains("pv") && !one.series.is_zero() {
            stems.entry(format!("{} {}", of_phase.len(), rest.join("_"))).or_default().push(one);
        }
    }
    for points in stems.values().filter(|points| points.len() == 3) {
        let mean = |one: &&AskedPoint<'_>| {
            let numbers: Vec<f64> = one.series.numbers(one.compiled).into_iter().flatten().collect();
            numbers.iter().sum::<f64>() / numbers.len().max(1) as f64
        };
        let mut means: Vec<f64> = points.iter().map(mean).collect();
        means.sort_by(f64::total_cmp);
        let names: Vec<&str> = points.iter().map(|one| one.compiled.name.as_str()).collect();
        found.add(means[0] * MOST_UNLIKE > means[2], format!("{} alike", names.join(", ")));
    }
}

/// The phase that a name ends or begins with, or has as a word.
fn phase(name: &str) -> Option<&'static str> {
    name.split('_').find_map(|word| PHASES.iter().find(|phase| word.eq_ignore_ascii_case(phase)).copied())
}

/// The only point with this unit.
fn only<'a, 'b>(points: &[&'a AskedPoint<'b>], unit: &str) -> Option<&'a AskedPoint<'b>> {
    let mut with = points.iter().filter(|one| one.point.unit.as_deref() == Some(unit));
    with.next().filter(|_| with.next().is_none()).copied()
}

/// Tests whether a power is at most voltage times current, and not far below.
fn product(found: &mut Related, voltage: &AskedPoint<'_>, current: &AskedPoint<'_>, power: &AskedPoint<'_>) {
    if voltage.series.times != current.series.times || voltage.series.times != power.series.times {
        return;
    }
    let [u, i, p] = [voltage, current, power].map(|one| one.series.numbers(one.compiled));
    let all = u.into_iter().zip(i).zip(p).filter_map(|((u, i), p)| Some(((u? * i?).abs(), p?.abs())));
    let rows: Vec<(f64, f64)> = all.filter(|(product, _)| *product >= LEAST_PRODUCT).collect();
    if rows.len() >= LEAST_SAMPLES {
        let share = |range: std::ops::Range<f64>| {
            rows.iter().filter(|(product, power)| range.contains(&(power / product))).count() as f64 / rows.len() as f64
        };
        let text = format!("{} = {} x {}", power.compiled.name, voltage.compiled.name, current.compiled.name);
        // With little load, much of a current is reactive.
        let (is_product, is_more) = (share(0.2..1.08) >= 0.9, share(1.15..f64::MAX) > 0.5);
        if is_product || is_more {
            found.add(is_product, text);
        }
    }
}

/// Tests whether a power that is called a total is the sum of those of three phases.
fn sum(found: &mut Related, asked: &[AskedPoint<'_>], phases: &BTreeMap<&str, Vec<&AskedPoint<'_>>>) {
    let parts: Vec<&AskedPoint<'_>> = phases.values().filter_map(|points| only(points, "W")).collect();
    let is_total = |one: &&AskedPoint<'_>| {
        let name = one.point.name.as_str();
        one.point.unit.as_deref() == Some("W")
            && phase(name).is_none()
            && name.split('_').any(|word| matches!(word, "total" | "sum" | "system"))
            && name.contains("power")
            && !name.contains("demand")
    };
    let mut totals = asked.iter().filter(is_total);
    let (Some(total), None) = (totals.next(), totals.next()) else { return };
    if parts.len() != 3 || parts.iter().any(|part| part.series.times != total.series.times) {
        return;
    }
    let numbers: Vec<Vec<Option<f64>>> = parts.iter().map(|part| part.series.numbers(part.compiled)).collect();
    let whole = total.series.numbers(total.compiled);
    let rows = whole.iter().enumerate().filter_map(|(row, whole)| {
        let sum: Option<f64> = numbers.iter().map(|part| part.get(row).copied().flatten()).sum();
        Some((sum?, (*whole)?))
    });
    let rows: Vec<(f64, f64)> = rows.filter(|(sum, _)| sum.abs() >= LEAST_PRODUCT).collect();
    if rows.len() >= LEAST_SAMPLES {
        let fitting = rows.iter().filter(|(sum, whole)| (sum - whole).abs() <= MOST_DIFFERENCE * sum.abs()).count();
        found.add(fitting * 10 >= rows.len() * 9, format!("{} = the sum of its phases", total.compiled.name));
    }
}
