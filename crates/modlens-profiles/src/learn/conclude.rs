//! All that is learnt about the registers of a table: layout, role, scale and quantity, each with its evidence.

use std::collections::BTreeSet;
use std::rc::Rc;

use crate::learn::anchor::{self, Anchor};
use crate::learn::calibration::{layout_bits, quantity_bits, role_bits, scale_bits};
use crate::learn::grid;
use crate::learn::habits::Habits;
use crate::learn::layout::{best_blocks, layout, BestBlocks};
use crate::learn::layout_point::LayoutPoint;
use crate::learn::observed::{ObservedTable, Samples};
use crate::learn::relations::relate;
use crate::learn::role::{role, Course, Role};
use crate::learn::scale::{scales, Scale};
use crate::learn::singles;
use crate::points::Conversion;
use crate::profile::Type;

/// The numbers that are looked at, of all points together.
const MOST_NUMBERS: usize = 4 << 20;

/// The numbers of a point that are always looked at.
const LEAST_NUMBERS: usize = 16;

/// What is learnt about one point.
#[derive(Clone, Debug)]
pub struct Learned {
    /// Its registers, type and order.
    pub layout: LayoutPoint,
    /// The evidence for the layout before it was counted what it is worth, in bits.
    pub evidence: f64,
    /// What it is for, with the evidence in bits.
    pub role: Option<(Role, f64)>,
    /// Its scale, unit and quantity.
    pub scale: Option<Scale>,
    /// The smallest and the largest raw number among the samples.
    pub range: Option<(f64, f64)>,
}

/// Learns about all registers of a table, in the order of their addresses; `anchors` are scales known from elsewhere.
pub fn conclude(table: &ObservedTable, anchors: &[Anchor]) -> Vec<Learned> {
    let best = best_blocks(table);
    let mut points = layout(table, &best, None);
    let were_known = Habits::of(&points).are_known();
    grid::fill(table, &mut points);
    let habits = Habits::of(&points);
    if !were_known && habits.are_known() {
        // Pairs with an upper register of zero show the order, too.
        points = layout(table, &best, Some(&habits));
        grid::fill(table, &mut points);
    }
    singles::add(table, &best, &mut points);
    let upper_halves = possible_upper_halves(table, &points);
    let mut reader = CourseReader::new(table, &best, points.len());
    let courses: Vec<(Course<'_>, Option<Role>)> = points
        .iter()
        .map(|point| {
            let course = reader.course(point);
            let role = role(&course).filter(|role| *role != Role::Constant || !upper_halves.contains(&point.address));
            (course, role)
        })
        .collect();
    let ranges: Vec<_> = courses.iter().map(|(course, _)| (!course.numbers.is_empty()).then(|| course.range())).collect();
    let addresses: Vec<u16> = points.iter().map(|point| point.address).collect();
    let mut scales = scales(&courses, &addresses);
    for anchor in anchors {
        if let Ok(at) = points.binary_search_by_key(&anchor.address, |point| point.address) {
            anchor::apply(&courses, at, anchor, &mut scales);
        }
    }
    let totals = relate(&courses, &mut scales);
    let roles = courses.iter().enumerate().map(|(i, (_, role))| role.or(totals.contains(&i).then_some(Role::Counter)));
    let roles: Vec<_> = roles.map(|role| role.map(|role| (role, role_bits(role)))).collect();
    let rest = roles.into_iter().zip(scales).zip(ranges);
    let learned = |(mut layout, ((role, scale), range)): (LayoutPoint, ((_, Option<Scale>), _))| {
        let evidence = layout.bits;
        layout.bits = layout_bits(evidence);
        let scale =
            scale.map(|scale| Scale { bits: scale_bits(scale.bits), quantity_bits: quantity_bits(scale.quantity_bits), ..scale });
        Learned { layout, evidence, role, scale, range }
    };
    points.into_iter().zip(rest).map(learned).collect()
}

/// Constant registers beside one that only rises or jumps over its whole range, and those of zero beside one that moves: they
/// may be its upper half.
fn possible_upper_halves(table: &ObservedTable, points: &[LayoutPoint]) -> BTreeSet<u16> {
    let single: BTreeSet<u16> = points.iter().filter(|point| point.count == 1).map(|point| point.address).collect();
    let is_lower = |at: &u16| {
        let counts = table.registers.get(at);
        counts.is_some_and(|counts| counts.changes() > 0 && (counts.downs == 0 || counts.max - counts.min > 0x6000))
    };
    let beside = |at: u16| [at.checked_sub(1), at.checked_add(1)];
    let moves = |at: &u16| table.registers.get(at).is_some_and(|counts| counts.changes() > 0);
    let is_zero = |at: &u16| table.registers.get(at).is_some_and(|counts| counts.first == 0 && counts.changes() == 0);
    let beside_lower = single.iter().filter(|at| is_lower(at)).flat_map(|&at| beside(at)).flatten();
    let beside_moving = single.iter().filter(|at| moves(at)).flat_map(|&at| beside(at)).flatten().filter(is_zero);
    beside_lower.chain(beside_moving).collect()
}

/// Reads the numbers of points over time.
pub(super) struct CourseReader<'a> {
    table: &'a ObservedTable,
    best: &'a BestBlocks<'a>,
    /// The numbers that are taken of a point.
    most: usize,
    /// The times of the block that was read last: its points have them in common.
    times: Option<(*const Samples, Rc<[f64]>)>,
}

impl<'a> CourseReader<'a> {
    pub(super) fn new(table: &'a ObservedTable, best: &'a BestBlocks<'a>, points: usize) -> Self {
        let most = (MOST_NUMBERS / points.max(1)).max(LEAST_NUMBERS);
        Self { table, best, most, times: None }
    }

    /// The numbers of a point over time.
    pub(super) fn course(&mut self, point: &LayoutPoint) -> Course<'a> {
        let registers = (0..point.count).filter_map(|i| self.table.registers.get(&point.address.wrapping_add(i)));
        let counts = registers.collect();
        let block = self.best.get(&(point.address, point.count)).filter(|_| point.kind != Type::Str);
        let Some(&(samples, at)) = block else {
            return Course { kind: point.kind, numbers: Vec::new(), seconds: Rc::default(), counts };
        };
        let conversion = Conversion::of_type(point.kind, point.order);
        let rows = samples.rows(at, at + usize::from(point.count));
        let mut bytes = Vec::with_capacity(8);
        let all = self.taken(samples).map(|i| {
            bytes.clear();
            bytes.extend(rows[i].iter().flat_map(|word| word.to_be_bytes()));
            conversion.value(&bytes, None).number()
        });
        let all: Vec<Option<f64>> = all.collect();
        let times = self.times_of(samples);
        let seconds = if all.contains(&None) {
            times.iter().zip(&all).filter(|pair| pair.1.is_some()).map(|pair| *pair.0).collect()
        } else {
            times
        };
        Course { kind: point.kind, numbers: all.into_iter().flatten().collect(), seconds, counts }
    }

    /// The rows that are taken of a block: all of them, or pairs spread over all.
    fn taken(&self, samples: &Samples) -> impl Iterator<Item = usize> + use<> {
        let stride = samples.len().div_ceil(self.most).max(1);
        (0..samples.len()).filter(move |i| (i / 2).is_multiple_of(stride))
    }

    /// The times of these rows in seconds.
    fn times_of(&mut self, samples: &'a Samples) -> Rc<[f64]> {
        let key: *const Samples = samples;
        if let Some((_, times)) = self.times.as_ref().filter(|known| known.0 == key) {
            return times.clone();
        }
        let times: Rc<[f64]> = self.taken(samples).map(|i| samples.times()[i] as f64 / 1e9).collect();
        self.times = Some((key, times.clone()));
        times
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Order;

    /// A day of polls each minute: three voltages of the mains, a state, a counter of seconds, and three small numbers of
    /// two registers.
    fn table() -> ObservedTable {
        let mut table = ObservedTable::default();
        for i in 0..1440i64 {
            let wave = |phase: f64| (2300.0 + 25.0 * (i as f64 / 30.0 + phase).sin() + 3.0 * (i as f64 * 1.7).cos()) as u16;
            let small = |step: i64| (i * step % 977) as u16;
            let seconds = (1_000_000 + 60 * i) as u32;
            let state = 1 + u16::from(i % 300 > 200);
            let words = [
                wave(0.0),
                wave(2.0),
                wave(4.0),
                state,
                (seconds >> 16) as u16,
                seconds as u16,
                0,
                small(5),
                0,
                small(7),
                0,
                small(11),
            ];
            table.put(0, &words, i * 60_000_000_000, false);
        }
        table
    }

    #[test]
    fn layout_role_scale_and_quantity() {
        let learned = conclude(&table(), &[]);
        let at = |address: u16| learned.iter().find(|one| one.layout.address == address).unwrap();
        for phase in 0..3 {
            let (one, scale) = (at(phase), at(phase).scale.unwrap());
            assert_eq!((one.layout.kind, one.role.unwrap().0), (Type::U16, Role::Measurement));
            assert_eq!((scale.factor, scale.unit, scale.quantity), (0.1, Some("V"), Some("voltage")));
        }
        assert_eq!(at(3).role.unwrap().0, Role::Enum);
        let counter = at(4);
        assert_eq!((counter.layout.kind, counter.layout.order, counter.role.unwrap().0), (Type::U32, Order::Abcd, Role::Counter));
        assert_eq!(counter.scale.unwrap().quantity, Some("duration"));
        assert!([6, 8, 10].iter().all(|&pair| at(pair).layout.kind == Type::U32), "{learned:?}");
        assert!(learned.iter().all(|one| one.layout.bits < 10.0));
    }
}
