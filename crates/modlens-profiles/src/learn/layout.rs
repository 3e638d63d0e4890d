//! Decides which registers belong together: texts, numbers of two and four registers, and the order of the device.

use std::collections::BTreeMap;

use crate::learn::evidence::MIN_MARGIN_BITS;
use crate::learn::habits::Habits;
use crate::learn::layout_point::LayoutPoint;
use crate::learn::observed::{Counts, ObservedTable, Samples};
use crate::learn::{rank_types, text};
use crate::profile::{Order, Type};

/// The bits of a text.
const TEXT_BITS: f64 = 40.0;

/// For each address and width, the block with the most samples that contains these registers.
pub(super) type BestBlocks<'a> = BTreeMap<(u16, u16), (&'a Samples, usize)>;

/// Finds the best block for each address and each width of one, two and four registers.
pub(super) fn best_blocks(table: &ObservedTable) -> BestBlocks<'_> {
    let mut best: BestBlocks<'_> = BTreeMap::new();
    for ((first, count), block) in &table.blocks {
        for width in [1u16, 2, 4] {
            for at in 0..(count + 1).saturating_sub(width) {
                let place = (first.wrapping_add(at), width);
                let here = (&block.samples, usize::from(at));
                let other = best.entry(place).or_insert(here);
                if other.0.len() < block.samples.len() {
                    *other = here;
                }
            }
        }
    }
    best
}

/// The best set of points that do not overlap. If it shows what the device does elsewhere, the choice is made again with
/// a preference for that; so it is from the beginning if the habits of the device are known.
pub(super) fn layout(table: &ObservedTable, best: &BestBlocks<'_>, known: Option<&Habits>) -> Vec<LayoutPoint> {
    let texts = texts(table);
    let choose_points = |habits: &Habits| {
        let mut all = texts.clone();
        for (&(address, width), (samples, at)) in best.iter().filter(|(place, _)| place.1 > 1) {
            let rows = samples.rows(*at, at + usize::from(width));
            all.extend(best_hypothesis(address, &rows, &samples.follows(), habits));
        }
        choose_non_overlapping(all)
    };
    let mut chosen = choose_points(known.unwrap_or(&Habits::default()));
    let habits = Habits::of(&chosen);
    if known.is_none() && habits.are_known() {
        chosen = choose_points(&habits);
    }
    for point in &mut chosen {
        point.is_certain &= !is_end_of_longer_number(table, point);
    }
    chosen
}

/// Whether a number may be the lower half of one of four registers: two registers that stay zero stand on its upper side,
/// and its upper register never changed, or a number like it follows or precedes it at a distance of four or eight.
fn is_end_of_longer_number(table: &ObservedTable, point: &LayoutPoint) -> bool {
    let counts = |at: i32| u16::try_from(at).ok().and_then(|at| table.registers.get(&at));
    let is_zero = |at: i32| counts(at).is_some_and(|counts| counts.changes() == 0 && counts.first == 0);
    // From the upper register of the pair: which way the zeros lie, and which way the lower register.
    let (upper, outward) = match point.order {
        Order::Abcd => (i32::from(point.address), -1),
        Order::Cdab => (i32::from(point.address) + 1, 1),
        _ => return false,
    };
    let has_zeros = |upper: i32| {
        is_zero(upper + outward)
            && is_zero(upper + 2 * outward)
            && counts(upper - outward).is_some_and(|lower| lower.changes() > 4 * counts(upper).map_or(0, Counts::changes))
    };
    let is_still = counts(upper).is_some_and(|counts| counts.changes() == 0);
    matches!(point.kind, Type::U32 | Type::S32)
        && has_zeros(upper)
        && (is_still || [-8, -4, 4, 8].iter().any(|distance| has_zeros(upper + distance)))
}

/// The texts in registers that never change.
fn texts(table: &ObservedTable) -> Vec<LayoutPoint> {
    let is_constant = |counts: &&Counts| counts.changes() == 0;
    let constant: BTreeMap<u16, u16> =
        table.registers.iter().filter(|(_, counts)| is_constant(counts)).map(|(at, counts)| (*at, counts.first)).collect();
    text::runs(&constant)
        .into_iter()
        .map(|run| LayoutPoint {
            address: run.address,
            count: run.count,
            kind: Type::Str,
            order: if run.swapped { Order::Badc } else { Order::Abcd },
            bits: TEXT_BITS,
            is_certain: true,
            is_rising: false,
            reason: format!("constant text {:?}", run.text),
            rivals: Vec::new(),
        })
        .collect()
}

/// The best hypothesis for the registers of these rows.
fn best_hypothesis(address: u16, rows: &[&[u16]], follows: &[bool], habits: &Habits) -> Option<LayoutPoint> {
    let count = rows.first()?.len() as u16;
    let hypotheses = rank_types(rows, follows, habits);
    let best = hypotheses.first()?;
    Some(LayoutPoint {
        address,
        count,
        kind: best.kind,
        order: best.order,
        bits: best.bits,
        is_certain: best.is_certain,
        is_rising: best.is_rising,
        reason: best.reason.clone(),
        rivals: hypotheses.iter().skip(1).take(2).map(|other| (other.kind, other.order)).collect(),
    })
}

/// Chooses the non-overlapping points with the largest total weight (weighted interval scheduling). A chosen point is
/// not certain if some set without it, containing a point that overlaps it, has nearly the same total.
fn choose_non_overlapping(mut all: Vec<LayoutPoint>) -> Vec<LayoutPoint> {
    all.sort_by_key(|point| (point.end(), point.address));
    let ends: Vec<u32> = all.iter().map(LayoutPoint::end).collect();
    let last_before: Vec<usize> = all.iter().map(|point| ends.partition_point(|&end| end <= u32::from(point.address))).collect();
    // best_of_first[i]: the best total of the first i points, sorted by their end.
    let mut best_of_first = vec![0.0f64; all.len() + 1];
    for (i, point) in all.iter().enumerate() {
        best_of_first[i + 1] = best_of_first[i].max(best_of_first[last_before[i]] + point.weight());
    }
    let best_total_with = totals_with(&all, &last_before, &best_of_first);
    let longest = all.iter().map(|point| u32::from(point.count)).max().unwrap_or(0);
    let (mut chosen, mut remaining) = (Vec::new(), all.len());
    while remaining > 0 {
        let i = remaining - 1;
        if best_of_first[remaining] > best_of_first[i] {
            let mut point = all[i].clone();
            let from = ends.partition_point(|&end| end <= u32::from(point.address));
            let to = ends.partition_point(|&end| end < point.end() + longest);
            let rivals = (from..to).filter(|&other| all[other].overlaps(&point)).map(|other| best_total_with[other]);
            point.is_certain &= rivals.fold(0.0, f64::max) + MIN_MARGIN_BITS <= best_total_with[i];
            chosen.push(point);
            remaining = last_before[i];
        } else {
            remaining = i;
        }
    }
    chosen.reverse();
    chosen
}

/// The best total of a set that contains each point.
fn totals_with(all: &[LayoutPoint], last_before: &[usize], best_of_first: &[f64]) -> Vec<f64> {
    // best_from[address]: the best total of the points that begin at this address or later.
    let mut best_from: BTreeMap<u32, f64> = BTreeMap::new();
    let mut by_start: Vec<&LayoutPoint> = all.iter().collect();
    by_start.sort_by_key(|point| std::cmp::Reverse(point.address));
    let from = |best_from: &BTreeMap<u32, f64>, address: u32| best_from.range(address..).next().map_or(0.0, |(_, bits)| *bits);
    for point in by_start {
        let with = point.weight() + from(&best_from, point.end());
        let best = from(&best_from, u32::from(point.address)).max(with);
        best_from.insert(u32::from(point.address), best);
    }
    all.iter()
        .zip(last_before)
        .map(|(point, before)| best_of_first[*before] + point.weight() + from(&best_from, point.end()))
        .collect()
}
