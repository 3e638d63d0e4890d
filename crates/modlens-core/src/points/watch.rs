//! Whether the values of a bound profile make sense in the order that it says.

use std::collections::HashMap;

use crate::learn::judge;
use crate::points::{Plan, Step};
use crate::profile::{Order, Space};

/// Samples after which a point is judged.
const ENOUGH: usize = 40;

/// Samples of the points of one unit that are wider than a register, until they are judged.
#[derive(Debug, Default)]
pub struct Watch {
    samples: HashMap<u32, Vec<Vec<u16>>>,
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
        plan.block(space, first, bytes.len() / 2, |step: Step| {
            let Some(index) = step.compiled.filter(|&index| plan.is_wide(index)) else { return };
            let samples = self.samples.entry(index).or_default();
            if samples.len() >= ENOUGH {
                return;
            }
            let start = 2 * usize::from(step.item);
            let block = &bytes[start..start + 2 * usize::from(plan.compiled(index).width)];
            samples.push(block.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect());
            if samples.len() == ENOUGH {
                full.push(index);
            }
        });
        self.judged += full.len();
        full.into_iter().filter_map(|index| self.mismatch(plan, index)).collect()
    }

    fn mismatch(&self, plan: &Plan, compiled: u32) -> Option<Mismatch> {
        let rows: Vec<&[u16]> = self.samples[&compiled].iter().map(Vec::as_slice).collect();
        let claims = judge(&rows, 0.0, None);
        let point = plan.point(plan.compiled(compiled));
        let best = claims.first().filter(|claim| claim.sure && claim.order != point.order)?;
        // A float is not told to be a counter: the type is the profile's, only the order is judged.
        let same = matches!(best.kind.word().as_bytes()[0], b'f') == matches!(point.kind.word().as_bytes()[0], b'f');
        let rival = claims.iter().any(|claim| claim.order == point.order && claim.bits + 6.0 > best.bits);
        (same && !rival).then(|| Mismatch { compiled, order: best.order, reason: best.reason.clone() })
    }
}
