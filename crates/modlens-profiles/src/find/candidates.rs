//! All readings of all registers, their priors, and the odds of those that remain.

use std::collections::{BTreeMap, BTreeSet};

use crate::find::candidate::Candidate;
use crate::find::history::Comparison;
use crate::find::query::Query;
use crate::find::series::{variants, BlockSeries, Column, Reading, Variant};
use crate::find::shown::{digits_bits, scalings, Scaling, Window};
use crate::find::{best_time_to_look, moves, Look};
use crate::profile::{Order, Type};
use modlens_protocol::register_type::Space;

/// What `learn` reports about the layout of some registers.
#[derive(Clone, Copy, Debug)]
pub struct LayoutHint {
    /// The unit.
    pub unit: u8,
    /// The table of the unit.
    pub space: Space,
    /// Address of the first register.
    pub address: u16,
    /// The number of registers.
    pub count: u16,
    /// The type.
    pub kind: Type,
    /// The order of registers and bytes.
    pub order: Order,
    /// Whether `learn` says so; else it is likely because of the places of other numbers.
    pub is_certain: bool,
}

/// The candidates of a query.
#[derive(Debug)]
pub struct Found {
    /// The number of readings that were tried.
    pub readings: usize,
    /// The number of registers that were tried.
    pub registers: usize,
    /// The candidates, best first.
    pub candidates: Vec<Candidate>,
    /// The time at which the candidates differ most.
    pub look: Option<Look>,
    /// The types and orders that the readings refer to.
    pub variants: Vec<Variant>,
}

/// The most candidates that are returned.
const MOST: usize = 50;

/// Stated odds are cut off here: with a thousand tasks, a bench can show no more.
const MOST_BITS: f64 = 10.0;

/// Candidates that are worse than the best by so many bits are no candidates.
const FAR_BITS: f64 = 16.0;

/// The prior odds that the value was on the line at all.
const PRESENT: f64 = 4.0;

/// Finds the readings that fit.
pub fn find(blocks: &[BlockSeries], hints: &[LayoutHint], query: &Query) -> Found {
    let variants = variants();
    let readings = readings(blocks, &variants);
    let layout = Layout::new(hints);
    let registers = readings.iter().filter(|reading| reading.variant == 0 && reading.bit.is_none()).count();
    let mut all = Vec::new();
    let chosen = choose_by_history(blocks, &variants, &readings, query);
    let comparison = query.history.as_ref().map(Comparison::new);
    for &reading in &chosen {
        let column = Column::new(blocks, &variants, reading);
        let Some(moved) = moves::bits(&column, &query.moves) else { continue };
        // Each report that a wrong register meets by chance costs it a bit and more; one that meets few is out.
        if moved < -6.0 - 2.0 * query.moves.len() as f64 {
            continue;
        }
        let Some(mut one) = explain(&column, reading, query, comparison.as_ref()) else { continue };
        one.bits += moved + layout.bits(blocks, &variants, reading) + behaviour_bits(&column, &variants, reading);
        all.push(one);
    }
    let all = one_per_register(all, blocks, &variants);
    let mut candidates = with_odds(all, none_bits(query, registers));
    candidates.truncate(MOST);
    let look = best_time_to_look(blocks, &variants, &candidates);
    Found { readings: readings.len(), registers, candidates, look, variants }
}

/// Every reading: each type and order at each address, from the block with the most samples; and each bit that moved.
fn readings(blocks: &[BlockSeries], variants: &[Variant]) -> Vec<Reading> {
    let mut found = Vec::new();
    for words in [1usize, 2, 4] {
        let mut best: BTreeMap<(u8, Space, u16), Reading> = BTreeMap::new();
        for (index, block) in blocks.iter().enumerate().filter(|(_, block)| !block.is_empty()) {
            if words > 1 && block.space.is_bits() {
                continue;
            }
            for at in 0..(block.width + 1).saturating_sub(words) {
                let key = (block.unit, block.space, block.first.wrapping_add(at as u16));
                let reading = Reading { block: index as u32, at: at as u16, variant: 0, bit: None };
                let place = best.entry(key).or_insert(reading);
                if blocks[place.block as usize].len() < block.len() {
                    *place = reading;
                }
            }
        }
        for reading in best.into_values() {
            let of_width = variants.iter().enumerate().filter(|(_, variant)| variant.words == words);
            let is_bits = blocks[reading.block as usize].space.is_bits();
            let limit = if is_bits { 1 } else { usize::MAX };
            found.extend(of_width.take(limit).map(|(variant, _)| Reading { variant: variant as u8, ..reading }));
            if words == 1 && !is_bits {
                let moved = moved_bits(&blocks[reading.block as usize], usize::from(reading.at));
                found.extend((0..16).filter(|bit| moved >> bit & 1 == 1).map(|bit| Reading { bit: Some(bit), ..reading }));
            }
        }
    }
    found
}

/// The bits of a register that were set at some times and clear at others, if few enough of them were to be flags.
fn moved_bits(block: &BlockSeries, at: usize) -> u16 {
    let (mut set, mut clear) = (0u16, 0u16);
    for row in block.cells.chunks_exact(block.width) {
        set |= row[at];
        clear |= !row[at];
    }
    let moved = set & clear;
    if moved.count_ones() <= 8 {
        moved
    } else {
        0
    }
}

/// Where there is a history, the readings that follow it at least roughly.
fn choose_by_history(blocks: &[BlockSeries], variants: &[Variant], readings: &[Reading], query: &Query) -> Vec<Reading> {
    const KEPT: usize = 400;
    let Some(history) = &query.history else { return readings.to_vec() };
    let comparison = Comparison::new(history);
    let points = if readings.len() > 20_000 || !history.has_zone { 48 } else { 120 };
    let mut scored: Vec<(f64, Reading)> = readings
        .iter()
        .filter_map(|&reading| {
            let column = Column::new(blocks, variants, reading);
            let numbers = column.spread(24);
            let moved = numbers.iter().any(|number| number.to_bits() != numbers[0].to_bits());
            let rough = if moved { comparison.rough(&column, points) } else { 0.0 };
            (rough > 0.2).then_some((rough, reading))
        })
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(KEPT);
    scored.into_iter().map(|(_, reading)| reading).collect()
}

/// The scale under which a reading explains values and history best; `None` if it explains them under none.
fn explain(column: &Column<'_>, reading: Reading, query: &Query, comparison: Option<&Comparison<'_>>) -> Option<Candidate> {
    let mut found = Candidate { reading, scale: 1.0, offset: 0.0, chance: 0.0, odds_bits: 0.0, fit: None, bits: 0.0 };
    if let Some(comparison) = comparison {
        let fit = comparison.fit(column)?;
        (found.scale, found.offset, found.fit, found.bits) = (fit.scale, fit.offset, Some((fit.r2, fit.lag)), fit.bits);
    }
    if query.shown.is_empty() {
        return Some(found);
    }
    let windows = query.shown.iter().map(|shown| Window::new(column, shown)).collect::<Option<Vec<_>>>()?;
    let is_bit = reading.bit.is_some();
    let best = scalings(column.is_float())
        .into_iter()
        .filter(|scaling| !is_bit || scaling.prior == 0.0)
        .map(|scaling| {
            let chances =
                windows.iter().zip(&query.shown).map(|(window, shown)| window.chance(shown, &scaling, column.is_float()).log2());
            let fit: f64 = chances.sum();
            (fit + scaling.prior + digits_bits(&query.shown, &scaling, column.is_float()), fit, scaling)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let (bits, fit, Scaling { scale, offset, .. }) = best?;
    // At most a third of the values may be missed.
    let limit = -9.0 - 4.0 * (query.shown.len() - 1) as f64;
    (fit > limit).then_some(Candidate { scale, offset, bits: found.bits + bits, ..found })
}

/// The layout that `learn` finds, as a prior.
struct Layout {
    by_register: BTreeMap<(u8, Space, u16), LayoutHint>,
}

impl Layout {
    fn new(hints: &[LayoutHint]) -> Self {
        let places = |hint: &LayoutHint| {
            (0..hint.count).map({
                let hint = *hint;
                move |i| ((hint.unit, hint.space, hint.address.wrapping_add(i)), hint)
            })
        };
        Self { by_register: hints.iter().flat_map(places).collect() }
    }

    /// The prior of a reading in bits.
    fn bits(&self, blocks: &[BlockSeries], variants: &[Variant], reading: Reading) -> f64 {
        let block = &blocks[reading.block as usize];
        let variant = &variants[usize::from(reading.variant)];
        let first = block.first.wrapping_add(reading.at);
        let hint_at = |offset: usize| self.by_register.get(&(block.unit, block.space, first.wrapping_add(offset as u16)));
        let bit = if reading.bit.is_some() { -3.0 } else { 0.0 };
        let rarity = match (variant.words, variant.kind) {
            (1, _) => 0.0,
            (2, _) => -4.0,
            (_, Type::F64) => -7.0,
            _ => -8.0,
        };
        let bytes = if matches!(variant.order, Order::Badc | Order::Dcba) { -5.0 } else { 0.0 };
        match hint_at(0) {
            _ if (0..variant.words).any(|offset| hint_at(offset).is_some_and(|hint| !hint.is_certain)) => {
                let hint = hint_at(0).filter(|hint| hint.address == first && usize::from(hint.count) == variant.words);
                match hint {
                    Some(hint) if hint.order == variant.order && hint.kind == variant.kind => 1.0,
                    _ => rarity + bytes + bit,
                }
            }
            Some(hint) if hint.address == first && usize::from(hint.count) == variant.words => {
                let same = hint.kind == variant.kind && hint.order == variant.order;
                if same || variant.words == 1 {
                    4.0 + bit
                } else {
                    -6.0
                }
            }
            None if (0..variant.words).all(|offset| hint_at(offset).is_none()) => rarity + bytes + bit,
            _ => -9.0 + rarity,
        }
    }
}

/// What the whole series reports about a reading: constants are seldom what is asked for, and a sign must be one.
fn behaviour_bits(column: &Column<'_>, variants: &[Variant], reading: Reading) -> f64 {
    let numbers = column.spread(96);
    let kind = variants[usize::from(reading.variant)].kind;
    if numbers.iter().any(|number| number.is_nan()) {
        return -12.0;
    }
    let constant = numbers.iter().all(|number| number.to_bits() == numbers[0].to_bits());
    let mut bits = if constant { -3.0 } else { 0.0 };
    if kind.is_signed() && !column.is_float() {
        let negative = numbers.iter().any(|&number| number < 0.0);
        bits += if negative { 1.0 } else { -1.5 };
    } else if !column.is_float() && reading.bit.is_none() {
        // An unsigned number near its end is a negative one.
        let end = 2f64.powi(16 * variants[usize::from(reading.variant)].words as i32);
        bits -= if numbers.iter().any(|&number| number > end * 0.98) { 6.0 } else { 0.0 };
    }
    if column.is_float() && !constant {
        // A float whose magnitude runs over many decades is a wrong order.
        let sizes = || numbers.iter().map(|number| number.abs()).filter(|&size| size > 0.0);
        let decades = (sizes().fold(0.0, f64::max) / sizes().fold(f64::MAX, f64::min)).log10();
        bits -= if decades > 6.0 { 8.0 } else { 0.0 };
    }
    bits
}

/// Keeps the best reading of each first register; overlapping readings of the same signal are one candidate.
fn one_per_register(mut all: Vec<Candidate>, blocks: &[BlockSeries], variants: &[Variant]) -> Vec<Candidate> {
    all.sort_by(|a, b| b.bits.total_cmp(&a.bits));
    let mut taken: BTreeSet<(u8, Space, u16)> = BTreeSet::new();
    all.retain(|one| {
        let block = &blocks[one.reading.block as usize];
        let words = variants[usize::from(one.reading.variant)].words;
        let place =
            |offset: usize| (block.unit, block.space, block.first.wrapping_add(one.reading.at).wrapping_add(offset as u16));
        if (0..words).any(|offset| taken.contains(&place(offset))) {
            return false;
        }
        taken.extend((0..words).map(place));
        true
    });
    all
}

/// The weight, in bits, of the case that none of the registers is the value: it meets every condition by chance.
fn none_bits(query: &Query, registers: usize) -> f64 {
    let digits = |value: f64, unit: f64| (value.abs() / unit).max(4.0).log2();
    let shown: f64 = query.shown.iter().map(|shown| digits(shown.value, shown.unit())).sum();
    let moves = 1.6 * query.moves.len() as f64;
    (registers.max(1) as f64 / PRESENT).log2() - shown - moves
}

/// The candidates near the best, with their odds.
fn with_odds(mut all: Vec<Candidate>, none_bits: f64) -> Vec<Candidate> {
    let Some(best) = all.first().map(|one| one.bits) else { return all };
    all.retain(|one| one.bits > best - FAR_BITS);
    let weights: Vec<f64> = all.iter().map(|one| (one.bits - best).exp2()).collect();
    let none = (none_bits - best).min(60.0).exp2();
    let total: f64 = weights.iter().sum::<f64>() + none;
    for (one, weight) in all.iter_mut().zip(weights) {
        one.chance = weight / total;
        let rest = (total - weight).max(weight * 1e-12);
        one.odds_bits = (weight / rest).log2().clamp(-20.0, MOST_BITS);
    }
    all
}
