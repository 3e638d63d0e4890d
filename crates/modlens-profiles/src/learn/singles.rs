//! Registers that belong to no certain number: a point for each, or for a register with the sign of the one beside it.

use std::collections::BTreeSet;

use crate::learn::layout::BestBlocks;
use crate::learn::layout_point::LayoutPoint;
use crate::learn::observed::{Counts, ObservedTable};
use crate::profile::{Order, Type};

/// The evidence that a register is signed because its value crosses zero, in bits.
const CROSSING_BITS: f64 = 5.0;

/// The evidence that a register holds the sign of the one beside it, in bits.
const SIGN_BITS: f64 = 7.0;

/// A signed quantity stays away from the ends of its range; the lower half of a longer number does not.
const NOT_SIGNED: std::ops::Range<u16> = 0x5000..0xB000;

/// Adds a point for each register that belongs to no certain point.
pub(super) fn add(table: &ObservedTable, best: &BestBlocks<'_>, points: &mut Vec<LayoutPoint>) {
    points.retain(|point| point.is_certain);
    let mut taken: BTreeSet<u16> =
        points.iter().flat_map(|point| (0..point.count).map(|i| point.address.wrapping_add(i))).collect();
    let free = |taken: &BTreeSet<u16>, at: u16| table.registers.contains_key(&at) && !taken.contains(&at);
    for (&address, _) in table.registers.iter().filter(|(_, counts)| is_signed(counts)) {
        let sides = [(address.checked_sub(1), Order::Abcd), (address.checked_add(1), Order::Cdab)];
        let signs = sides.iter().filter_map(|&(at, order)| at.filter(|&at| free(&taken, at)).map(|at| (at, order)));
        let signs: Vec<_> = signs.filter(|&(at, _)| is_sign(best, at, address)).collect();
        if let (true, [(at, order)]) = (free(&taken, address), &signs[..]) {
            let reason = "one register holds the sign of the other";
            points.push(point(address.min(*at), 2, Type::S32, *order, SIGN_BITS, reason));
            taken.extend([address, *at]);
        }
    }
    for (&address, counts) in table.registers.iter().filter(|(address, _)| !taken.contains(address)) {
        let is_signed = is_signed(counts) && is_around_zero(best, address);
        points.push(if is_signed {
            point(address, 1, Type::S16, Order::Abcd, CROSSING_BITS, "the sign changes where the value crosses zero")
        } else {
            point(address, 1, Type::U16, Order::Abcd, 0.0, "")
        });
    }
    points.sort_by_key(|point| point.address);
}

/// A point; one of several registers is certain.
fn point(address: u16, count: u16, kind: Type, order: Order, bits: f64, reason: &str) -> LayoutPoint {
    let (is_certain, reason) = (count > 1, reason.to_owned());
    LayoutPoint { address, count, kind, order, bits, is_certain, is_rising: false, reason, rivals: Vec::new() }
}

/// Whether the values of a register may be negative: they cross zero, or stay just below it.
fn is_signed(counts: &Counts) -> bool {
    // A signed quantity that crosses zero jumps between 65535 and 0.
    let crosses = counts.max >= 0xFF00 && counts.min < 0x0100;
    let below = counts.min >= 0xF000 && counts.max < 0xFFFF;
    (crosses || below) && counts.reversals > 0 && counts.changes() > 2
}

/// Whether a register is never far from zero.
fn is_around_zero(best: &BestBlocks<'_>, address: u16) -> bool {
    let rows = best.get(&(address, 1)).map(|(samples, at)| samples.rows(*at, at + 1)).unwrap_or_default();
    rows.iter().all(|row| !NOT_SIGNED.contains(&row[0]))
}

/// Whether a register is 65535 whenever the one beside it is negative, and 0 otherwise.
fn is_sign(best: &BestBlocks<'_>, sign: u16, address: u16) -> bool {
    let Some((samples, at)) = best.get(&(sign.min(address), 2)) else { return false };
    let (upper, lower) = if sign < address { (0, 1) } else { (1, 0) };
    let rows = samples.rows(*at, at + 2);
    rows.iter().all(|row| row[upper] == if row[lower] >= 0x8000 { 0xFFFF } else { 0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::layout::best_blocks;

    /// What is said of registers that hold these rows, polled each second.
    fn said(rows: impl Iterator<Item = Vec<u16>>) -> Vec<(u16, Type, Order)> {
        let mut table = ObservedTable::default();
        for (second, row) in rows.enumerate() {
            table.put(0, &row, second as i64 * 1_000_000_000, false);
        }
        let mut points = Vec::new();
        add(&table, &best_blocks(&table), &mut points);
        points.iter().map(|point| (point.address, point.kind, point.order)).collect()
    }

    /// A value that wanders between -40 and 40.
    fn wave(at: i32) -> i32 {
        (at * 7 % 81) - 40
    }

    #[test]
    fn a_sign_register_makes_a_number_of_both() {
        let halves = |at: i32| ((wave(at) >> 16) as u16, wave(at) as u16);
        let after = said((0..90).map(|at| vec![230, halves(at).1, halves(at).0, 500]));
        assert_eq!(after[1], (1, Type::S32, Order::Cdab));
        let before = said((0..90).map(|at| vec![230, halves(at).0, halves(at).1, 500]));
        assert_eq!(before[1], (1, Type::S32, Order::Abcd));
    }

    #[test]
    fn one_signed_register_beside_others() {
        let alone = said((0..90).map(|at| vec![230, wave(at) as u16, 500]));
        assert_eq!(alone[1], (1, Type::S16, Order::Abcd));
        // The lower half of a longer number takes all values.
        let wild = said((0..90u16).map(|at| vec![at.wrapping_mul(40_503)]));
        assert_eq!(wild[0].1, Type::U16);
    }
}
