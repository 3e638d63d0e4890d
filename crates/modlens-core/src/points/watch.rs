//! Whether the values of a bound profile make sense in the order that it says.

use crate::learn::{judge, sensible_float};
use crate::points::{Plan, Wide};
use crate::profile::{Order, Space, Type};

/// Samples after which a point is judged.
const ENOUGH: usize = 40;

/// Samples of the points of one unit that are wider than a register, until they are judged.
#[derive(Debug, Default)]
pub struct Watch {
    /// For each of `Plan::wide`.
    points: Vec<Samples>,
    /// By table and register: whether a value begins there that is still to be judged. Empty before the first block.
    open: [Vec<u64>; 4],
    judged: usize,
}

/// What a point had so far; nothing once it is judged.
#[derive(Clone, Debug, Default)]
struct Samples {
    /// The registers, one sample behind the other.
    registers: Vec<u16>,
    /// A bit for every order in which a float would be none; with all of them there is no mismatch.
    absurd: u8,
}

/// A point whose values make sense in another order.
pub struct Mismatch {
    /// In the plan.
    pub compiled: u32,
    /// The order that fits.
    pub order: Order,
    /// What speaks for it.
    pub reason: String,
}

impl Watch {
    /// Whether there is nothing left to judge: most of the time.
    pub fn done(&self, plan: &Plan) -> bool {
        self.judged >= plan.wide().len()
    }

    /// Whether a block of registers has something to judge, so that `see` has to see it.
    pub fn waits(&self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> bool {
        let begun = !self.points.is_empty() || plan.wide().is_empty();
        !begun || self.any_open(space, first, usize::from(first) + bytes.len() / 2)
    }

    /// A block of registers that was read.
    pub fn see(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> Vec<Mismatch> {
        if self.points.is_empty() {
            self.begin(plan);
        }
        let end = usize::from(first) + bytes.len() / 2;
        let mut found = Vec::new();
        if !self.any_open(space, first, end) {
            return found;
        }
        let begin = plan.wide().partition_point(|wide| (wide.space, wide.address) < (space, first));
        for (at, wide) in plan.wide().iter().enumerate().skip(begin) {
            let (address, width) = (wide.address, usize::from(wide.width));
            if wide.space != space || usize::from(address) >= end {
                break;
            }
            let start = 2 * usize::from(address - first);
            let block = bytes.get(start..start + 2 * width).filter(|_| self.is_open(space, address));
            let Some(block) = block else { continue };
            let point = &mut self.points[at];
            if point.add(plan, wide, block) {
                let samples = std::mem::take(point);
                found.extend(samples.mismatch(plan, wide));
                self.judged += 1;
                self.open[space as usize][usize::from(address) / 64] &= !(1 << (address % 64));
            }
        }
        found
    }

    fn begin(&mut self, plan: &Plan) {
        self.points.resize_with(plan.wide().len(), Samples::default);
        for wide in plan.wide() {
            let open = &mut self.open[wide.space as usize];
            open.resize(1024, 0);
            open[usize::from(wide.address) / 64] |= 1 << (wide.address % 64);
        }
    }

    fn is_open(&self, space: Space, address: u16) -> bool {
        self.open[space as usize][usize::from(address) / 64] >> (address % 64) & 1 == 1
    }

    /// Whether a value that is still to be judged begins in the block.
    fn any_open(&self, space: Space, first: u16, end: usize) -> bool {
        let (mut at, last) = (usize::from(first), end.min(0x1_0000));
        let open = &self.open[space as usize];
        while at < last && !open.is_empty() {
            let here = (64 - at % 64).min(last - at);
            if open[at / 64] >> (at % 64) << (64 - here) != 0 {
                return true;
            }
            at += here;
        }
        false
    }
}

impl Samples {
    /// A further sample; whether there is enough to judge by.
    fn add(&mut self, plan: &Plan, wide: &Wide, block: &[u8]) -> bool {
        let point = plan.point(plan.compiled(wide.compiled));
        if is_float(point.kind) {
            self.absurd |= 1 << point.order as u8;
            for (order, _) in Order::ALL {
                self.absurd |= u8::from(!sensible_float(block, order)) << order as u8;
            }
            if self.absurd == (1 << Order::ALL.len()) - 1 {
                return true;
            }
        }
        let enough = ENOUGH * usize::from(wide.width);
        if self.registers.is_empty() {
            self.registers.reserve_exact(enough);
        }
        self.registers.extend(block.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])));
        self.registers.len() >= enough
    }

    fn mismatch(&self, plan: &Plan, wide: &Wide) -> Option<Mismatch> {
        let enough = self.registers.len() >= ENOUGH * usize::from(wide.width);
        let rows: Vec<&[u16]> = self.registers.chunks_exact(usize::from(wide.width)).filter(|_| enough).collect();
        let point = plan.point(plan.compiled(wide.compiled));
        let claims = judge(&rows, 0.0, None);
        let best = claims.first().filter(|claim| claim.sure && claim.order != point.order)?;
        // A float is not told to be a counter: the type is the profile's, only the order is judged.
        let same = is_float(best.kind) == is_float(point.kind);
        let rival = claims.iter().any(|claim| claim.order == point.order && claim.bits + 6.0 > best.bits);
        (same && !rival).then(|| Mismatch { compiled: wide.compiled, order: best.order, reason: best.reason.clone() })
    }
}

fn is_float(kind: Type) -> bool {
    matches!(kind, Type::F32 | Type::F64)
}
