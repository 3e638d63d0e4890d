//! Whether the values of a bound profile make sense in the order that it says.

use std::collections::HashMap;

use crate::learn::{float_elsewhere, judge};
use crate::points::{Plan, Step};
use crate::profile::{Order, Space};

/// Samples after which a point is judged.
const ENOUGH: usize = 40;

/// Samples of the points of one unit that are wider than a register, until they are judged.
#[derive(Debug, Default)]
pub struct Watch {
    /// The registers of each sample, one sample behind the other.
    samples: HashMap<u32, Vec<u16>>,
    /// By table and register: whether a value begins there that is still to be judged. Empty before the first block.
    open: [Vec<u64>; 4],
    judged: usize,
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
        self.judged >= plan.wide()
    }

    /// A block of registers that was read.
    pub fn see(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> Vec<Mismatch> {
        let mut full = Vec::new();
        if !self.any_open(plan, space, first, bytes.len() / 2) {
            return Vec::new();
        }
        plan.block(space, first, bytes.len() / 2, |step: Step| {
            let Some(index) = step.compiled.filter(|&index| plan.is_wide(index)) else { return };
            let (start, width) = (2 * usize::from(step.item), usize::from(plan.compiled(index).width));
            let samples = self.samples.entry(index).or_default();
            if samples.len() >= ENOUGH * width {
                return;
            }
            let block = &bytes[start..start + 2 * width];
            samples.extend(block.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])));
            if samples.len() == ENOUGH * width {
                full.push(index);
            }
        });
        for &index in &full {
            let address = plan.compiled(index).address;
            // Two values may begin with the same register.
            let lacks = |other: u32| {
                let seen = self.samples.get(&other).map_or(0, Vec::len);
                plan.is_wide(other) && seen < ENOUGH * usize::from(plan.compiled(other).width)
            };
            if !plan.beginning(space, address).any(lacks) {
                self.open[space as usize][usize::from(address) / 64] &= !(1 << (address % 64));
            }
        }
        self.judged += full.len();
        full.into_iter().filter_map(|index| self.mismatch(plan, index)).collect()
    }

    /// Whether a value that is still to be judged begins in the block.
    fn any_open(&mut self, plan: &Plan, space: Space, first: u16, count: usize) -> bool {
        if self.open.iter().all(Vec::is_empty) {
            self.open.fill(vec![0; 1024]);
            for compiled in (0..plan.all().len() as u32).filter(|&index| plan.is_wide(index)).map(|index| plan.compiled(index)) {
                let address = usize::from(compiled.address);
                self.open[plan.point(compiled).space as usize][address / 64] |= 1 << (address % 64);
            }
        }
        let (first, last) = (usize::from(first), (usize::from(first) + count).min(0x1_0000));
        let open = &self.open[space as usize];
        let mut at = first;
        while at < last {
            let here = (64 - at % 64).min(last - at);
            if open[at / 64] >> (at % 64) << (64 - here) != 0 {
                return true;
            }
            at += here;
        }
        false
    }

    fn mismatch(&self, plan: &Plan, compiled: u32) -> Option<Mismatch> {
        let samples = &self.samples[&compiled];
        let rows: Vec<&[u16]> = samples.chunks_exact(usize::from(plan.compiled(compiled).width)).collect();
        let point = plan.point(plan.compiled(compiled));
        if point.kind.word().starts_with('f') && !float_elsewhere(&rows, point.order) {
            return None;
        }
        let claims = judge(&rows, 0.0, None);
        let best = claims.first().filter(|claim| claim.sure && claim.order != point.order)?;
        // A float is not told to be a counter: the type is the profile's, only the order is judged.
        let same = matches!(best.kind.word().as_bytes()[0], b'f') == matches!(point.kind.word().as_bytes()[0], b'f');
        let rival = claims.iter().any(|claim| claim.order == point.order && claim.bits + 6.0 > best.bits);
        (same && !rival).then(|| Mismatch { compiled, order: best.order, reason: best.reason.clone() })
    }
}
