//! What a device does elsewhere: the orders and types of its numbers that are certain.

use crate::learn::layout_point::LayoutPoint;
use crate::profile::{Order, Type};

/// So many certain numbers show the order that a device uses.
const ENOUGH_VOTES: f64 = 3.0;

/// How often devices use each order, in the sequence of `Order::ALL`. It counts as one number of the device.
const USUAL: [(Order, f64); 4] = [(Order::Abcd, 0.6), (Order::Cdab, 0.34), (Order::Badc, 0.03), (Order::Dcba, 0.03)];

/// Bonus in bits for an order that numbers of the same device are known to have.
const KNOWN_ORDER_BITS: f64 = 3.0;

/// The certain numbers of a device, counted.
#[derive(Clone, Debug, Default)]
pub struct Habits {
    votes: Vec<(Order, f64)>,
    floats: Vec<(Order, usize)>,
    integer_totals: usize,
    float_totals: usize,
}

impl Habits {
    /// Counts the certain numbers of several registers.
    pub(super) fn of(points: &[LayoutPoint]) -> Self {
        let mut found = Self::default();
        for point in points.iter().filter(|point| point.is_certain && point.kind != Type::Str) {
            let is_float = matches!(point.kind, Type::F32 | Type::F64);
            add(&mut found.votes, point.order, 1.0);
            if is_float {
                add(&mut found.floats, point.order, 1);
            }
            found.float_totals += usize::from(point.is_rising && is_float);
            found.integer_totals += usize::from(point.is_rising && !is_float);
        }
        found
    }

    /// A device with so many numbers of one order.
    #[cfg(test)]
    pub(super) fn with_votes(order: Order, count: f64) -> Self {
        Self { votes: vec![(order, count)], ..Self::default() }
    }

    fn all_votes(&self) -> f64 {
        self.votes.iter().map(|vote| vote.1).sum()
    }

    /// Whether enough numbers are certain to say anything.
    pub(super) fn are_known(&self) -> bool {
        self.all_votes() >= ENOUGH_VOTES
    }

    /// What the order counts for or against a number, in bits: how likely one more number has it, after those that are
    /// known (rule of succession), compared with the most usual order of all devices.
    pub(super) fn order_bits(&self, order: Order) -> f64 {
        let prior = USUAL.iter().find(|row| row.0 == order).map_or(0.0, |row| row.1);
        if !self.are_known() {
            return (prior / USUAL[0].1).log2();
        }
        let votes = self.votes.iter().find(|vote| vote.0 == order).map_or(0.0, |vote| vote.1);
        let known = if votes > 0.0 { KNOWN_ORDER_BITS } else { 0.0 };
        known + ((votes + prior) / (self.all_votes() + 1.0)).log2()
    }

    /// Whether the totals of the device are integers rather than floats.
    pub(super) fn has_integer_totals(&self) -> bool {
        self.integer_totals >= 2 && self.integer_totals > 2 * self.float_totals
    }

    /// Whether the device has several floats in this order, and more than in any other.
    pub(super) fn has_floats(&self, order: Order) -> bool {
        let count = |order: Order| self.floats.iter().find(|row| row.0 == order).map_or(0, |row| row.1);
        count(order) >= 3 && self.floats.iter().all(|row| row.1 <= count(order))
    }
}

/// Adds to the row of an order.
fn add<T: std::ops::AddAssign>(rows: &mut Vec<(Order, T)>, order: Order, more: T) {
    match rows.iter_mut().find(|row| row.0 == order) {
        Some(row) => row.1 += more,
        None => rows.push((order, more)),
    }
}
