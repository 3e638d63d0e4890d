//! Finds numbers by the regular places of a block: a run of floats, or pairs of which one register stays zero.

use std::collections::{BTreeMap, BTreeSet};

use crate::learn::layout_point::LayoutPoint;
use crate::learn::observed::{Counts, ObservedTable};
use crate::profile::{Order, Type};

/// The evidence of a place in a run, in bits.
const PLACE_BITS: f64 = 7.0;

/// Runs of fewer pairs are no pattern.
const LEAST_PAIRS: usize = 3;

/// Upper registers of small numbers.
const SMALL_UPPER: u16 = 0x100;

/// Magnitudes of floats that devices hold.
const MAGNITUDES: std::ops::Range<f32> = 1e-4..1e8;

/// Adds the points that follow from the places of others.
pub(super) fn fill(table: &ObservedTable, points: &mut Vec<LayoutPoint>) {
    let mut added = floats(table, points);
    let taken = |points: &[LayoutPoint]| -> BTreeSet<u16> {
        points.iter().filter(|point| point.is_certain).flat_map(|point| (0..point.count).map(|i| point.address + i)).collect()
    };
    let free = taken(points);
    added.retain(|point| (0..point.count).all(|i| !free.contains(&(point.address + i))));
    add(points, added);
    let taken = taken(points);
    let usual = usual_order(points);
    let mut runs = all_zero_pairs(table, &taken, usual);
    if usual.is_none() {
        // Clear runs show the order of the others.
        if let Some(order) = usual_order(&runs) {
            runs = all_zero_pairs(table, &taken, Some(order));
        }
    }
    if usual_order(&runs).is_some() {
        add(points, runs);
    }
}

/// The pairs of all runs in all blocks.
fn all_zero_pairs(table: &ObservedTable, taken: &BTreeSet<u16>, usual: Option<Order>) -> Vec<LayoutPoint> {
    let mut runs: BTreeMap<u16, LayoutPoint> = BTreeMap::new();
    for (first, count) in table.blocks.keys() {
        for point in zero_pairs(table, *first, *count, taken, usual) {
            runs.entry(point.address).or_insert(point);
        }
    }
    runs.into_values().collect()
}

/// Puts certain points in; guesses that overlap them go.
fn add(points: &mut Vec<LayoutPoint>, added: Vec<LayoutPoint>) {
    for point in added {
        let end = u32::from(point.address) + u32::from(point.count);
        let is_apart = |other: &LayoutPoint| {
            u32::from(other.address) >= end || u32::from(other.address) + u32::from(other.count) <= u32::from(point.address)
        };
        if points.iter().all(|other| is_apart(other) || !other.is_certain) {
            points.retain(is_apart);
            points.push(point);
        }
    }
    points.sort_by_key(|point| point.address);
}

/// The order of all certain integers of two registers, if there are some and they agree.
fn usual_order(points: &[LayoutPoint]) -> Option<Order> {
    let is_integer = |point: &&LayoutPoint| point.is_certain && matches!(point.kind, Type::U32 | Type::S32);
    let mut orders = points.iter().filter(is_integer).map(|point| point.order);
    let first = orders.next()?;
    orders.all(|order| order == first).then_some(first)
}

/// Numbers between and next to certain ones of the same order at the same parity of the same block. In a device of floats, a
/// block without any certain number is taken to begin with one.
fn floats(table: &ObservedTable, points: &[LayoutPoint]) -> Vec<LayoutPoint> {
    let mut found = Vec::new();
    for &(first, count) in table.blocks.keys() {
        let in_block = |point: &&LayoutPoint| point.is_certain && point.address >= first && point.address - first < count;
        let here: Vec<&LayoutPoint> = points.iter().filter(in_block).collect();
        for parity in 0..2u16 {
            for (order, is_float) in [(Order::Abcd, true), (Order::Cdab, true), (Order::Abcd, false), (Order::Cdab, false)] {
                let is_alike = |point: &&&LayoutPoint| {
                    is_pair(point, order, is_float) && (point.address - first).is_multiple_of(2) == (parity == 0)
                };
                let known: BTreeSet<u16> = here.iter().filter(is_alike).map(|point| point.address).collect();
                let is_like_others =
                    is_float && parity == 0 && here.iter().all(|point| is_alike(&point)) && is_device_of_floats(points, order);
                if known.len() >= LEAST_PAIRS || is_like_others {
                    let end = u32::from(first) + u32::from(count);
                    let places = Places { start: first + parity, end, order, is_float, is_like_others };
                    found.extend(neighbours(table, &places, &known));
                }
            }
        }
    }
    found
}

/// Places of a block that are likely to hold a number of two registers, with its order: they are at the parity of others of
/// one order, and their upper register has not been used. Nothing is claimed of them.
pub fn likely_pairs(table: &ObservedTable, points: &[&LayoutPoint]) -> Vec<(u16, Order)> {
    let certain = || points.iter().filter(|point| point.is_certain);
    let taken: BTreeSet<u16> = certain().flat_map(|point| (0..point.count).map(|i| point.address.wrapping_add(i))).collect();
    let mut found = Vec::new();
    for &(first, count) in table.blocks.keys() {
        let pairs = || {
            certain().filter(|point| (u32::from(first)..u32::from(first) + u32::from(count)).contains(&u32::from(point.address)))
        };
        for (order, parity) in [(Order::Abcd, 0), (Order::Abcd, 1), (Order::Cdab, 0), (Order::Cdab, 1)] {
            let is_alike = |point: &&&LayoutPoint| is_pair(point, order, false) && (point.address - first) % 2 == parity;
            let (alike, all) = (pairs().filter(is_alike).count(), pairs().filter(|point| point.count > 1).count());
            if alike >= LEAST_PAIRS && alike == all {
                let places = (first + parity..first + count.saturating_sub(1)).step_by(2);
                let is_free = |at: &u16| !taken.contains(at) && !taken.contains(&(at + 1)) && is_small(table, *at, order);
                found.extend(places.filter(is_free).map(|at| (at, order)));
            }
        }
    }
    found.sort_unstable_by_key(|place| place.0);
    found.dedup();
    found
}

/// Whether a point is a float, or an integer, of two registers in this order.
fn is_pair(point: &LayoutPoint, order: Order, is_float: bool) -> bool {
    point.order == order && (point.kind == Type::F32) == is_float && matches!(point.kind, Type::F32 | Type::U32 | Type::S32)
}

/// Whether nearly all numbers of several registers are floats of this order.
fn is_device_of_floats(points: &[LayoutPoint], order: Order) -> bool {
    let numbers = || points.iter().filter(|point| point.is_certain && point.count > 1 && point.kind != Type::Str);
    let floats = numbers().filter(|point| is_pair(point, order, true)).count();
    floats >= 2 * LEAST_PAIRS && floats * 10 >= numbers().count() * 9
}

/// The places of a grid that hold a plausible number, next to known ones. Pairs that stay zero are part of a run, but
/// nothing is said of them.
fn neighbours(table: &ObservedTable, of: &Places, known: &BTreeSet<u16>) -> Vec<LayoutPoint> {
    let places: Vec<u16> = (u32::from(of.start)..of.end.saturating_sub(1)).step_by(2).map(|at| at as u16).collect();
    let fits = |at: u16| if of.is_float { is_float(table, at, of.order) } else { is_small(table, at, of.order) };
    let is_zero = |at: u16| {
        halves(table, at, of.order)
            .is_some_and(|(high, low)| [high, low].iter().all(|counts| counts.changes() == 0 && counts.first == 0))
    };
    let plausible: Vec<bool> = places.iter().map(|&at| known.contains(&at) || fits(at) || is_zero(at)).collect();
    let (kind, reason) = if of.is_float {
        (Type::F32, "a float like its neighbours")
    } else {
        (Type::U32, "a number of two registers like its neighbours")
    };
    let mut found = Vec::new();
    for run in plausible.iter().enumerate().collect::<Vec<_>>().chunk_by(|a, b| a.1 == b.1).filter(|run| *run[0].1) {
        let of_run: Vec<u16> = run.iter().map(|(i, _)| places[*i]).filter(|&at| !is_zero(at)).collect();
        let known_here = of_run.iter().filter(|at| known.contains(at)).count();
        let is_enough = known_here >= LEAST_PAIRS && known_here * 3 >= of_run.len();
        if is_enough || (of.is_like_others && of_run.len() >= LEAST_PAIRS) {
            let new = of_run.into_iter().filter(|at| !known.contains(at));
            found.extend(new.map(|at| point(at, kind, of.order, reason)));
        }
    }
    found
}

/// The places of a run: where it starts, where its block ends, what its numbers are, and whether all numbers of the
/// device are.
struct Places {
    start: u16,
    end: u32,
    order: Order,
    is_float: bool,
    is_like_others: bool,
}

/// Whether two registers are a number that moves and has not used its upper register but for the sign.
fn is_small(table: &ObservedTable, at: u16, order: Order) -> bool {
    let Some((high, low)) = halves(table, at, order) else { return false };
    let is_sign = high.set & high.clear == 0xFFFF;
    low.changes() > 0 && (high.max < SMALL_UPPER || is_sign)
}

/// Whether first and last values of two registers, and the range of the upper one, are those of a float that is not zero.
fn is_float(table: &ObservedTable, at: u16, order: Order) -> bool {
    let Some((high, low)) = halves(table, at, order) else { return false };
    let float = |high: u16, low: u16| f32::from_bits(u32::from(high) << 16 | u32::from(low)).abs();
    let fits = |number: f32| number == 0.0 || MAGNITUDES.contains(&number);
    let ends = [float(high.first, low.first), float(high.last, low.last)];
    ends.iter().all(|&number| fits(number)) && ends.iter().any(|&number| number != 0.0)
}

/// The registers with the upper and the lower half.
fn halves(table: &ObservedTable, at: u16, order: Order) -> Option<(&Counts, &Counts)> {
    let (first, second) = (table.registers.get(&at)?, table.registers.get(&at.checked_add(1)?)?);
    Some(if order == Order::Cdab { (second, first) } else { (first, second) })
}

/// Pairs of a register that stays zero and one that moves, one after the other: numbers of two registers that have been
/// small so far.
fn zero_pairs(table: &ObservedTable, first: u16, count: u16, taken: &BTreeSet<u16>, usual: Option<Order>) -> Vec<LayoutPoint> {
    #[derive(Clone, Copy, PartialEq)]
    enum Cell {
        Zero,
        Moves,
        Other,
    }
    let cell = |at: u16| match table.registers.get(&at) {
        _ if taken.contains(&at) => Cell::Other,
        Some(counts) if counts.changes() == 0 && counts.first == 0 => Cell::Zero,
        Some(counts) if counts.changes() > 0 => Cell::Moves,
        _ => Cell::Other,
    };
    let cells: Vec<Cell> = (0..count).map(|i| cell(first.wrapping_add(i))).collect();
    let mut found = Vec::new();
    let mut at = 0;
    while at < cells.len() {
        let mut end = at + 1;
        while end < cells.len() && cells[end] != Cell::Other && cells[end - 1] != Cell::Other && cells[end] != cells[end - 1] {
            end += 1;
        }
        if let Some((start, order)) = pairs_of_run(at..end, cells[at] == Cell::Zero, usual) {
            let pairs = (start..end).step_by(2).take((end - start) / 2);
            let reason = "one of a run of pairs with an upper register of zero";
            found.extend(pairs.map(|i| point(first.wrapping_add(i as u16), Type::U32, order, reason)));
        }
        at = end;
    }
    found
}

/// Where the pairs of a run of alternating registers begin, and their order; the run is given by its places in the block.
/// Pairs begin at an even place: blocks begin with a number. Where a run begins at an odd place, or ends there, a register
/// of its own stands beside it, and more pairs have to show that. Other numbers of the device may say otherwise.
fn pairs_of_run(run: std::ops::Range<usize>, begins_with_zero: bool, usual: Option<Order>) -> Option<(usize, Order)> {
    let order_from = |start: usize| if begins_with_zero == (start == run.start) { Order::Abcd } else { Order::Cdab };
    let even = run.start.next_multiple_of(2);
    let start = match usual {
        Some(order) if order_from(run.start) == order => run.start,
        Some(order) if order_from(run.start + 1) == order => run.start + 1,
        Some(_) => return None,
        None => even,
    };
    let order = order_from(start);
    let pairs = run.end.saturating_sub(start) / 2;
    let is_whole = start == run.start && run.len().is_multiple_of(2);
    let is_clear = usual.is_some() || is_whole || (order == Order::Abcd && start == 0);
    (pairs >= if is_clear { LEAST_PAIRS } else { 2 * LEAST_PAIRS }).then_some((start, order))
}

fn point(address: u16, kind: Type, order: Order, reason: &str) -> LayoutPoint {
    let (bits, reason) = (PLACE_BITS, reason.to_owned());
    LayoutPoint { address, count: 2, kind, order, bits, is_certain: true, is_rising: false, reason, rivals: Vec::new() }
}
