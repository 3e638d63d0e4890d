//! Whether the values of a bound profile make sense in the order that it says.

use crate::learn::{judge, sensible_float};
use crate::points::{Plan, Wide};
use crate::profile::{Order, Type};
use modlens_protocol::register_type::Space;

/// Samples after which a point is judged.
const ENOUGH: usize = 40;

/// A bit for every order.
const EVERY_ORDER: u8 = (1 << Order::ALL.len()) - 1;

/// Samples of the points of one unit that are wider than a register, until they are judged.
#[derive(Debug, Default)]
pub struct Watch {
    /// For each of `Plan::wide`.
    points: Vec<Samples>,
    open: Open,
    judged: usize,
}

/// By table and register: whether a value begins there that is still to be judged. Empty before the first block.
#[derive(Debug, Default)]
struct Open([Vec<u64>; 4]);

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

    /// Takes a block of registers that was read, unless a point can be judged with it: that is for `see`.
    pub fn take(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> bool {
        if self.points.is_empty() {
            return plan.wide().is_empty();
        }
        let Self { points, open, .. } = self;
        let ready = |(at, wide, block): (usize, &Wide, &[u8])| points[at].with(plan, wide, block).1;
        if open.within(plan, space, first, bytes).any(ready) {
            return false;
        }
        for (at, wide, block) in open.within(plan, space, first, bytes) {
            points[at].add(plan, wide, block);
        }
        true
    }

    /// A block of registers that was read.
    pub fn see(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> Vec<Mismatch> {
        if self.points.is_empty() {
            self.begin(plan);
        }
        let (mut found, mut judged) = (Vec::new(), Vec::<usize>::new());
        for (at, wide, block) in self.open.within(plan, space, first, bytes) {
            let point = &mut self.points[at];
            if point.add(plan, wide, block) {
                let samples = std::mem::take(point);
                found.extend(samples.mismatch(plan, wide));
                judged.push(at);
            }
        }
        self.judged += judged.len();
        for at in judged {
            self.open.close(&plan.wide()[at]);
        }
        found
    }

    fn begin(&mut self, plan: &Plan) {
        self.points.resize_with(plan.wide().len(), Samples::default);
        plan.wide().iter().for_each(|wide| self.open.add(wide));
    }
}

impl Open {
    fn add(&mut self, wide: &Wide) {
        let open = &mut self.0[wide.space as usize];
        open.resize(1024, 0);
        open[usize::from(wide.address) / 64] |= 1 << (wide.address % 64);
    }

    fn close(&mut self, wide: &Wide) {
        self.0[wide.space as usize][usize::from(wide.address) / 64] &= !(1 << (wide.address % 64));
    }

    /// The values of a block that are still to be judged: in `Plan::wide`, and their registers.
    fn within<'a>(
        &'a self,
        plan: &'a Plan,
        space: Space,
        first: u16,
        bytes: &'a [u8],
    ) -> impl Iterator<Item = (usize, &'a Wide, &'a [u8])> {
        let end = usize::from(first) + bytes.len() / 2;
        let any = self.any(space, first, end);
        let begin =
            if any { plan.wide().partition_point(|wide| (wide.space, wide.address) < (space, first)) } else { usize::MAX };
        let within = move |(_, wide): &(usize, &Wide)| wide.space == space && usize::from(wide.address) < end;
        plan.wide().iter().enumerate().skip(begin).take_while(within).filter_map(move |(at, wide)| {
            let start = 2 * usize::from(wide.address - first);
            let block = bytes.get(start..start + 2 * usize::from(wide.width))?;
            self.has(space, wide.address).then_some((at, wide, block))
        })
    }

    fn has(&self, space: Space, address: u16) -> bool {
        self.0[space as usize][usize::from(address) / 64] >> (address % 64) & 1 == 1
    }

    /// Whether a value that is still to be judged begins in the block.
    fn any(&self, space: Space, first: u16, end: usize) -> bool {
        let (mut at, last) = (usize::from(first), end.min(0x1_0000));
        let open = &self.0[space as usize];
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
    /// In which orders no float has made sense with a further sample, and whether there is enough to judge by then.
    fn with(&self, plan: &Plan, wide: &Wide, block: &[u8]) -> (u8, bool) {
        let point = plan.point(plan.compiled(wide.compiled));
        let mut absurd = self.absurd;
        if is_float(point.kind) {
            absurd |= 1 << point.order as u8;
            for (order, _) in Order::ALL {
                absurd |= u8::from(!sensible_float(block, order)) << order as u8;
            }
        }
        let enough = self.registers.len() + usize::from(wide.width) >= ENOUGH * usize::from(wide.width);
        (absurd, enough || absurd == EVERY_ORDER)
    }

    /// A further sample; whether there is enough to judge by.
    fn add(&mut self, plan: &Plan, wide: &Wide, block: &[u8]) -> bool {
        let (absurd, enough) = self.with(plan, wide, block);
        self.absurd = absurd;
        if absurd == EVERY_ORDER {
            return true;
        }
        if self.registers.is_empty() {
            self.registers.reserve_exact(ENOUGH * usize::from(wide.width));
        }
        self.registers.extend(block.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])));
        enough
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
