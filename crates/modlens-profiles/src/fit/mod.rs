//! Scores how well a profile fits a unit: by the addresses that were asked for, by the values that came, read with the
//! types and scales of the profile, and by relations among them.

mod evidence;
mod plausible;
mod relations;
mod seen;
mod series;

use std::collections::BTreeSet;

use crate::points::{CompiledPoint, Plan};
use crate::profile::{Point, Type};
use modlens_protocol::register_type::Space;

use evidence::{judge, Verdict};
use relations::AskedPoint;
pub use seen::SeenTable;
use series::Series;

/// How well a profile fits.
#[derive(Clone, Debug)]
pub struct Fit {
    /// 0 to 100: the share of what was asked for that the profile explains, less what speaks against it.
    pub percent: u32,
    /// The evidence of the values in bits: how much less likely they are in registers of another meaning.
    pub bits: f64,
    /// The share of the profile's points that were asked for.
    pub share: f64,
    /// Whether the profile probably belongs to the unit.
    pub fits: bool,
    /// The reasons as text.
    pub reasons: Vec<String>,
}

/// A profile fits from so many per cent on.
const MIN_PERCENT: f64 = 60.0;

/// Where values say less than this, in bits, addresses alone have to decide.
const MIN_BITS: f64 = 8.0;

/// Addresses alone decide only if the profile has nearly all of them.
const MIN_COVERAGE: f64 = 0.95;

/// Fewer addresses are in too many profiles.
const MIN_ADDRESSES: usize = 3;

/// What a point that the values contradict weighs against one that they fit.
const CONTRADICTION_WEIGHT: f64 = 3.0;

/// The contradictions that a relation counts which does not hold.
const BROKEN_WEIGHT: usize = 4;

/// The evidence of the values that shows a profile half, in bits; twice as much shows three quarters of it.
const HALF_SHOWN_BITS: f64 = 8.0;

/// The evidence of an edge of a block at an edge of the profile, and of all edges, in bits.
const EDGE_BITS: f64 = 1.5;
const MOST_EDGE_BITS: f64 = 8.0;

/// The names that a reason lists.
const MOST_NAMES: usize = 3;

/// Scores a profile for what was seen of a unit.
pub fn fit(plan: &Plan, seen: &[SeenTable<'_>]) -> Fit {
    let values = || plan.compiled_points().iter().map(|compiled| (compiled, plan.point(compiled)));
    let known: BTreeSet<(Space, u16)> =
        values().flat_map(|(compiled, point)| addresses(compiled).map(move |at| (point.space, at))).collect();
    let requested: BTreeSet<(Space, u16)> = seen.iter().flat_map(requested_of).collect();
    if requested.is_empty() || known.is_empty() {
        return Fit { percent: 0, bits: 0.0, share: 0.0, fits: false, reasons: vec!["nothing to compare".to_owned()] };
    }
    let covered = requested.intersection(&known).count();
    let asked: Vec<AskedPoint<'_>> = values()
        .filter_map(|(compiled, point)| {
            let table = seen.iter().find(|table| table.space == point.space)?;
            let is_asked = addresses(compiled).all(|at| requested.contains(&(point.space, at)));
            is_asked.then(|| {
                let series = Series::of(table.table, compiled);
                let verdict = judge(table, compiled, point, &series);
                AskedPoint { compiled, point, series, verdict }
            })
        })
        .collect();
    let share = asked.len() as f64 / plan.compiled_points().len() as f64;
    let coverage = covered as f64 / requested.len() as f64;
    let mut reasons = vec![format!("{covered} of {} requested addresses are in this profile", requested.len())];
    let accepted = 1.0 - refused_share(seen, &known, &mut reasons);
    let split = split_points(values(), seen);
    let related = relations::of(&asked);
    let bits = asked.iter().map(|one| one.verdict.bits()).sum::<f64>() + related.bits + edge_bits(seen, &known);
    let fitting = asked.iter().filter(|one| matches!(one.verdict, Verdict::Fits(..))).count() + related.holding.len();
    let against = asked.iter().filter(|one| matches!(one.verdict, Verdict::Contradicts(_))).count();
    let contradictions = (against + split.len() + BROKEN_WEIGHT * related.broken.len()) as f64;
    let quality = (fitting as f64 + 1.0) / (fitting as f64 + 1.0 + CONTRADICTION_WEIGHT * contradictions);
    // Masters read blocks with holes: what the values show of the whole profile counts as well as the addresses.
    let shown = share * (1.0 - (-bits.max(0.0) / HALF_SHOWN_BITS).exp2());
    let percent = 100.0 * coverage.max(f64::midpoint(coverage, share)).max(shown) * accepted * quality;
    add_reasons(&mut reasons, &asked, &split, &related, fitting);
    let is_exact = coverage >= MIN_COVERAGE && contradictions == 0.0;
    let is_convincing = covered >= MIN_ADDRESSES && (bits >= MIN_BITS || is_exact);
    let fits = percent.round() >= MIN_PERCENT && is_convincing;
    if !is_convincing && percent.round() >= MIN_PERCENT {
        reasons.push("the values say too little".to_owned());
    }
    Fit { percent: percent.round() as u32, bits, share, fits, reasons }
}

/// The addresses of a value.
fn addresses(compiled: &CompiledPoint) -> impl Iterator<Item = u16> + use<> {
    let first = compiled.address;
    (0..compiled.width).map(move |i| first.wrapping_add(i))
}

/// The addresses that were asked for in a table.
fn requested_of<'a>(seen: &'a SeenTable<'_>) -> impl Iterator<Item = (Space, u16)> + 'a {
    let space = seen.space;
    seen.table.blocks.keys().flat_map(move |(first, count)| (0..*count).map(move |i| (space, first.wrapping_add(i))))
}

/// The share of requests for addresses of the profile that got an exception.
fn refused_share(seen: &[SeenTable<'_>], known: &BTreeSet<(Space, u16)>, reasons: &mut Vec<String>) -> f64 {
    let (mut refused, mut all) = (0, 0);
    for table in seen {
        for ((first, count), block) in &table.table.blocks {
            if (0..*count).any(|i| known.contains(&(table.space, first.wrapping_add(i)))) {
                refused += block.exceptions.values().sum::<u64>();
                all += block.reads + block.writes;
            }
        }
    }
    if refused > 0 {
        reasons.push(format!("{refused} of {all} requests for them got an exception"));
    }
    refused as f64 / all.max(1) as f64
}

/// The names of the numbers of which requests covered parts, and none ever the whole: masters do not cut numbers.
fn split_points<'a>(values: impl Iterator<Item = (&'a CompiledPoint, &'a Point)>, seen: &[SeenTable<'_>]) -> Vec<&'a str> {
    let is_split = |(compiled, point): &(&CompiledPoint, &Point)| {
        let (first, end) = (u32::from(compiled.address), u32::from(compiled.address) + u32::from(compiled.width));
        let tables = seen.iter().filter(|table| table.space == point.space);
        let blocks = tables.flat_map(|table| table.table.blocks.keys());
        let ranges = blocks.map(|(from, count)| (u32::from(*from), u32::from(*from) + u32::from(*count)));
        let parts: Vec<bool> =
            ranges.filter(|(from, to)| *from < end && first < *to).map(|(from, to)| from <= first && end <= to).collect();
        compiled.width > 1 && compiled.width <= Type::F64.registers() && !parts.is_empty() && !parts.contains(&true)
    };
    values.filter(is_split).map(|(compiled, _)| compiled.name.as_str()).collect()
}

/// The evidence of blocks that begin and end where a run of points of the profile does.
fn edge_bits(seen: &[SeenTable<'_>], known: &BTreeSet<(Space, u16)>) -> f64 {
    let mut edges = BTreeSet::new();
    for table in seen {
        let is_known = |at: u32| u16::try_from(at).is_ok_and(|at| known.contains(&(table.space, at)));
        for (first, count) in table.table.blocks.keys() {
            let (first, end) = (u32::from(*first), u32::from(*first) + u32::from(*count));
            // Anything may begin at 0.
            if first > 0 && is_known(first) && !is_known(first - 1) {
                edges.insert((table.space, first, true));
            }
            if is_known(end - 1) && !is_known(end) {
                edges.insert((table.space, end, false));
            }
        }
    }
    (edges.len() as f64 * EDGE_BITS).min(MOST_EDGE_BITS)
}

/// Adds what speaks for and against the profile.
fn add_reasons(
    reasons: &mut Vec<String>,
    asked: &[AskedPoint<'_>],
    split: &[&str],
    related: &relations::Related,
    fitting: usize,
) {
    if fitting > 0 {
        reasons.push(format!("{fitting} {} as such quantities are", if fitting == 1 { "value is" } else { "values are" }));
    }
    reasons.extend(related.holding.first().cloned());
    let mut list = |names: &[&str], words: &str| {
        if !names.is_empty() {
            let rest = if names.len() > MOST_NAMES { format!(" and {} more", names.len() - MOST_NAMES) } else { String::new() };
            reasons.push(format!("{}{rest} {words}", names[..names.len().min(MOST_NAMES)].join(", ")));
        }
    };
    list(split, "only partly covered by requests");
    let mut words: Vec<&str> = asked.iter().filter_map(|one| one.verdict.words()).collect();
    words.sort_unstable();
    words.dedup();
    for words in words {
        let with = asked.iter().filter(|one| one.verdict.words() == Some(words));
        list(&with.map(|one| one.compiled.name.as_str()).collect::<Vec<_>>(), words);
    }
    reasons.extend(related.broken.first().cloned());
}
