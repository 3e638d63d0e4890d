//! What the values of a point say about whether it is what the profile says.

use crate::fit::plausible::{is_in_range, is_total, is_usual_float, worth};
use crate::fit::seen::SeenTable;
use crate::fit::series::{is_placeholder, Series};
use crate::points::CompiledPoint;
use crate::profile::{Decimal, Order, Point, Type};

/// What the values say about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Nothing.
    Silent,
    /// They are as those of such a point; the evidence in bits.
    Fits(f64),
    /// They cannot be such a point; the reason, to be read after its name.
    Contradicts(&'static str),
}

/// The evidence of one point is limited: neighbours are wrong together.
const MOST_BITS: f64 = 4.0;

/// What a contradiction counts, in bits.
const CONTRADICTION_BITS: f64 = 6.0;

/// The evidence of a number that the values themselves show.
const LEARNED_BITS: f64 = 4.0;

/// A quantity in one register does not jump so far from sample to sample, on the average.
const WILD_STEP: f64 = 6000.0;

/// The steps that show whether a quantity jumps.
const LEAST_STEPS: usize = 4;

impl Verdict {
    /// The evidence for the profile in bits.
    pub fn bits(self) -> f64 {
        match self {
            Self::Silent => 0.0,
            Self::Fits(bits) => bits,
            Self::Contradicts(_) => -CONTRADICTION_BITS,
        }
    }

    /// The reason against the point.
    pub fn words(self) -> Option<&'static str> {
        match self {
            Self::Contradicts(words) => Some(words),
            _ => None,
        }
    }
}

/// Judges a point by its samples and by what was learnt of its registers.
pub(super) fn judge(seen: &SeenTable<'_>, compiled: &CompiledPoint, point: &Point, series: &Series) -> Verdict {
    let by_layout = judge_layout(seen, compiled, point);
    if matches!(by_layout, Verdict::Contradicts(_)) {
        return by_layout;
    }
    match (judge_values(compiled, point, series), by_layout) {
        (Verdict::Fits(bits), Verdict::Fits(more)) => Verdict::Fits(bits + more),
        (Verdict::Silent, by_layout) => by_layout,
        (by_values, _) => by_values,
    }
}

/// Compares a point with the numbers that the values show in its registers.
fn judge_layout(seen: &SeenTable<'_>, compiled: &CompiledPoint, point: &Point) -> Verdict {
    if compiled.width > Type::F64.registers() || !point.kind.is_number() {
        return Verdict::Silent;
    }
    let end = u32::from(compiled.address) + u32::from(compiled.width);
    let is_float = |kind: Type| matches!(kind, Type::F16 | Type::F32 | Type::F64);
    let certain = seen.learned.iter().map(|one| &one.layout).filter(|layout| layout.is_certain && layout.kind != Type::Str);
    for layout in certain.filter(|layout| u32::from(layout.address) < end && u32::from(compiled.address) < layout.end()) {
        let is_there = (layout.address, layout.count) == (compiled.address, compiled.width);
        if !is_there || is_float(layout.kind) != is_float(point.kind) {
            return Verdict::Contradicts("with registers that the values show to be another number");
        }
        if compiled.width > 1 && layout.order != point.order {
            return Verdict::Contradicts("with registers in another order");
        }
        if compiled.width > 1 {
            return Verdict::Fits(LEARNED_BITS);
        }
    }
    Verdict::Silent
}

fn judge_values(compiled: &CompiledPoint, point: &Point, series: &Series) -> Verdict {
    if series.is_zero() || series.rows().all(is_placeholder) {
        return Verdict::Silent;
    }
    if matches!(point.kind, Type::Str | Type::Strh | Type::Strl) {
        return judge_text(series);
    }
    if !point.kind.is_number() || compiled.factor.is_some() || point.bits.is_some() || !point.bit_labels.is_empty() {
        return Verdict::Silent;
    }
    if !point.labels.is_empty() {
        return judge_labels(compiled, point, series);
    }
    let numbers: Vec<f64> = series.numbers(compiled).into_iter().flatten().collect();
    let is_float = matches!(point.kind, Type::F32 | Type::F64);
    let unit = point.unit.as_deref().unwrap_or("");
    if is_float {
        // A float that is none is no value, unless it says so.
        let are_finite = numbers.len() * 2 > series.times.len();
        if !are_finite || !numbers.iter().all(|number| is_usual_float(*number)) {
            return Verdict::Contradicts("with registers that are no such number");
        }
    } else if !is_likely_integer(point, series) {
        return Verdict::Contradicts("with registers that are no such number");
    }
    if !numbers.iter().all(|number| is_in_range(unit, *number)) {
        return Verdict::Contradicts("beyond the range of such a quantity");
    }
    if point.kind.registers() == 1 && !is_float && jumps(series) {
        return Verdict::Contradicts("jumping as no such quantity does");
    }
    if is_total(unit) && falls_as_often_as_it_rises(&numbers) {
        return Verdict::Contradicts("going up and down, which totals do not");
    }
    let scale = point.scale.map_or(1.0, Decimal::to_f64);
    let bits = worth(unit, &numbers, point.kind.bits(), scale, is_float).min(MOST_BITS);
    if bits > 0.0 {
        Verdict::Fits(bits)
    } else {
        Verdict::Silent
    }
}

fn judge_text(series: &Series) -> Verdict {
    let Some(bytes) = series.bytes().next() else { return Verdict::Silent };
    let letters: Vec<u8> = bytes.into_iter().filter(|byte| !matches!(byte, 0 | 0xFF)).collect();
    if letters.is_empty() {
        Verdict::Silent
    } else if letters.iter().all(|byte| (0x20..0x7F).contains(byte)) {
        Verdict::Fits((letters.len() as f64).min(MOST_BITS))
    } else {
        Verdict::Contradicts("with bytes that are no text")
    }
}

fn judge_labels(compiled: &CompiledPoint, point: &Point, series: &Series) -> Verdict {
    if point.scale.is_some() || point.offset.is_some() {
        return Verdict::Silent;
    }
    let values: Vec<i128> = series.bytes().filter_map(|bytes| compiled.raw(&bytes)).collect();
    let is_known = |value: &i128| point.labels.iter().any(|(label, _)| i128::from(*label) == *value);
    if !values.iter().all(is_known) {
        return Verdict::Contradicts("with values outside its labels");
    }
    let highest = point.labels.iter().map(|label| label.0).max().unwrap_or(0) as f64;
    // Small numbers are in many registers.
    Verdict::Fits(if highest > 16.0 { 2.0 } else { 0.5 })
}

/// Whether the upper register is that of an integer of a usual size: above half a thousand million, devices hardly count.
fn is_likely_integer(point: &Point, series: &Series) -> bool {
    const LARGE: u16 = 0x2000;
    if !matches!(point.kind, Type::U32 | Type::S32) {
        return true;
    }
    let upper = |row: &[u16]| if matches!(point.order, Order::Cdab | Order::Dcba) { row[1] } else { row[0] };
    let is_likely = |word: u16| word < LARGE || (point.kind == Type::S32 && word >= 0xFFFF - LARGE);
    series.rows().filter(|row| !is_placeholder(row)).all(|row| is_likely(upper(row)))
}

/// Whether a register moves as no quantity does: by a tenth of its whole range from sample to sample.
fn jumps(series: &Series) -> bool {
    let words: Vec<u16> = series.rows().filter(|row| !is_placeholder(row)).map(|row| row[0]).collect();
    let way = |pair: &[u16]| {
        f64::from(i32::from(pair[1]) - i32::from(pair[0])).abs().min(f64::from(pair[1].wrapping_sub(pair[0]) as i16).abs())
    };
    let steps: Vec<f64> = words.windows(2).map(way).collect();
    steps.len() >= LEAST_STEPS && steps.iter().sum::<f64>() / steps.len() as f64 > WILD_STEP
}

/// Whether numbers go down nearly as often as up.
fn falls_as_often_as_it_rises(numbers: &[f64]) -> bool {
    let downs = numbers.windows(2).filter(|pair| pair[1] < pair[0]).count();
    let ups = numbers.windows(2).filter(|pair| pair[1] > pair[0]).count();
    downs >= 2 && downs * 2 > ups
}
