//! Decides what a register is for, by how it moves.

use std::rc::Rc;

use crate::learn::observed::Counts;
use crate::profile::Type;

/// What a register is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It never changed.
    Constant,
    /// The master writes it.
    Setpoint,
    /// One of a few states.
    Enum,
    /// Bits of their own meaning.
    BitField,
    /// It only rises.
    Counter,
    /// It goes up and down.
    Measurement,
    /// It follows the time.
    Clock,
    /// It changes with each answer.
    Heartbeat,
    /// A text.
    Text,
}

impl Role {
    /// The name of the role.
    pub fn word(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Setpoint => "setpoint",
            Self::Enum => "enum",
            Self::BitField => "bit field",
            Self::Counter => "counter",
            Self::Measurement => "measurement",
            Self::Clock => "clock",
            Self::Heartbeat => "heartbeat",
            Self::Text => "text",
        }
    }
}

/// The values of a point over time: samples for its numbers, exact counts for its registers.
#[derive(Debug)]
pub(super) struct Course<'a> {
    /// The type.
    pub kind: Type,
    /// The numbers that were kept.
    pub numbers: Vec<f64>,
    /// Their times in seconds.
    pub seconds: Rc<[f64]>,
    /// The counts of each register.
    pub counts: Vec<&'a Counts>,
}

/// Fewer steps do not show that something rises evenly.
const LEAST_STEPS: usize = 24;

impl Course<'_> {
    /// Ups, downs and changes of direction among the numbers that were kept.
    fn directions(&self) -> (u64, u64, u64) {
        let (mut ups, mut downs, mut reversals, mut last) = (0, 0, 0, 0i8);
        for pair in self.numbers.windows(2).filter(|pair| pair[0].to_bits() != pair[1].to_bits()) {
            let direction = if pair[1] > pair[0] { 1 } else { -1 };
            (ups, downs) = if direction > 0 { (ups + 1, downs) } else { (ups, downs + 1) };
            reversals += u64::from(last != 0 && last != direction);
            last = direction;
        }
        (ups, downs, reversals)
    }

    /// The mean change per second.
    pub fn rate(&self) -> f64 {
        let (Some(first), Some(last)) = (self.numbers.first(), self.numbers.last()) else { return 0.0 };
        let time = self.seconds[self.seconds.len() - 1] - self.seconds[0];
        if time > 0.0 {
            (last - first) / time
        } else {
            0.0
        }
    }

    /// Whether the number only rises, without a change of direction in between.
    pub fn only_rises(&self) -> bool {
        let (ups, downs, _) = self.directions();
        downs == 0 && ups > 0 && self.counts.iter().take(1).all(|counts| counts.downs == 0)
    }

    /// Whether the numbers are those of a time: they rise evenly, in many steps.
    pub fn rises_evenly(&self) -> bool {
        let (Some(&first), Some(&start), rate) = (self.numbers.first(), self.seconds.first(), self.rate()) else { return false };
        let steps = self.numbers.windows(2).filter(|pair| pair[0].to_bits() != pair[1].to_bits()).count();
        let line = |second: f64| first + rate * (second - start);
        steps >= LEAST_STEPS
            && rate > 0.0
            && self.seconds.iter().zip(&self.numbers).all(|(&second, number)| (number - line(second)).abs() < 2.5)
    }

    /// The time from the first to the last number in seconds.
    pub fn duration(&self) -> f64 {
        self.seconds.last().zip(self.seconds.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// The smallest and the largest number.
    pub fn range(&self) -> (f64, f64) {
        self.numbers.iter().fold((f64::MAX, f64::MIN), |(low, high), &number| (low.min(number), high.max(number)))
    }

    /// Whether the numbers of both are of the same times.
    pub fn is_in_step_with(&self, other: &Self) -> bool {
        Rc::ptr_eq(&self.seconds, &other.seconds) || self.seconds == other.seconds
    }

    /// Whether no register ever changed.
    pub fn is_constant(&self) -> bool {
        self.counts.iter().all(|counts| counts.changes() == 0)
    }
}

/// The role of a point, or `None` where the data do not say.
pub(super) fn role(course: &Course<'_>) -> Option<Role> {
    if course.kind == Type::Str {
        return Some(Role::Text);
    }
    let first = course.counts.first()?;
    if first.writes > 0 {
        return Some(Role::Setpoint);
    }
    if course.is_constant() {
        // The ends of the range are what unused registers hold.
        let is_used = course.counts.iter().any(|counts| !matches!(counts.first, 0x7FFF | 0x8000 | 0xFFFF));
        return (first.samples >= 4 && is_used).then_some(Role::Constant);
    }
    if course.counts.len() == 1 {
        one_register(course, first)
    } else {
        several_registers(course)
    }
}

fn several_registers(course: &Course<'_>) -> Option<Role> {
    let (ups, downs, reversals) = course.directions();
    if course.kind == Type::U32 && is_rate(course.rate(), 1.0) && course.range().0 > 1e9 {
        return Some(Role::Clock);
    }
    if downs == 0 && ups >= 4 {
        return Some(Role::Counter);
    }
    (reversals >= 3).then_some(Role::Measurement)
}

/// Whether a rate is this one, within two per cent.
pub(super) fn is_rate(rate: f64, expected: f64) -> bool {
    (rate / expected - 1.0).abs() < 0.02
}

fn one_register(course: &Course<'_>, counts: &Counts) -> Option<Role> {
    let changes = counts.changes();
    let polls = counts.samples.saturating_sub(1).max(1);
    if changes >= 8 && counts.increments * 10 >= polls * 9 && counts.max - counts.min >= 8 {
        return Some(Role::Heartbeat);
    }
    if let Some(clock) = clock(course, counts) {
        return Some(clock);
    }
    if let Some(distinct) = counts.distinct() {
        return few_values(counts, &distinct);
    }
    if counts.ups == 0 {
        // What only falls is hardly a counter, unless it counts down the time.
        let is_time = is_rate(course.rate(), -1.0) || is_rate(course.rate(), -1.0 / 60.0);
        return (counts.downs >= 16 && !is_time).then_some(Role::Measurement);
    }
    if counts.downs == 0 {
        // A quantity that drifts may rise for hours.
        let hours = course.duration() / 3600.0;
        return (counts.ups >= 16 && hours >= 6.0).then_some(Role::Counter);
    }
    (counts.reversals >= 3).then_some(Role::Measurement)
}

/// Seconds or minutes that run to 59 and begin again.
fn clock(course: &Course<'_>, counts: &Counts) -> Option<Role> {
    let wraps = course.numbers.windows(2).filter(|pair| pair[1] < pair[0]).count();
    let is_full = |pair: &[f64]| pair[1] >= pair[0] || (pair[0] >= 45.0 && pair[1] <= 14.0);
    let fits = counts.max <= 59 && counts.max >= 55 && counts.min <= 4 && wraps >= 2;
    let moves = counts.changes() * 10 >= counts.samples || counts.increments == counts.ups;
    (fits && moves && course.numbers.windows(2).all(is_full)).then_some(Role::Clock)
}

/// States are smaller than this.
const LEAST_NUMBER: u16 = 100;

/// The role of a register that had at most twelve values.
fn few_values(counts: &Counts, distinct: &[(u16, u32)]) -> Option<Role> {
    let changes = counts.changes();
    let values: Vec<u16> = distinct.iter().map(|pair| pair.0).collect();
    let is_range = values.windows(2).all(|pair| pair[1] - pair[0] == 1);
    let stays = counts.samples as f64 / changes as f64;
    let moved = counts.set & counts.clear;
    // Values around which a quantity moves by its smallest step.
    if is_range && values.len() >= 4 && counts.reversals >= 3 && counts.max >= 12 {
        return Some(Role::Measurement);
    }
    if counts.max >= 16 && counts.max < 0x8000 && counts.single_bits * 3 >= changes * 2 && moved.count_ones() >= 2 && !is_range {
        return (values.len() >= 3 && stays >= 6.0).then_some(Role::BitField);
    }
    // A larger number that moves by its smallest step. Flags change a single bit each.
    let is_number = values.len() >= 3 || changes > counts.single_bits;
    if is_range && counts.min >= LEAST_NUMBER && counts.reversals >= 3 && is_number {
        return Some(Role::Measurement);
    }
    // Flags change one at a time; so does a number that takes two values.
    let is_state = (changes - counts.single_bits) * 3 >= changes;
    if stays >= 8.0 && values.len() <= 8 && counts.max < 16 && changes >= 2 && is_state {
        return Some(Role::Enum);
    }
    (counts.reversals >= 6 && values.len() >= 4 && stays < 6.0).then_some(Role::Measurement)
}
