//! Checks whether the values of a profile's points make sense in the register and byte order that the profile gives.
//! The result becomes the finding `order_mismatch`.

use crate::learn::{is_plausible_float, rank_types, Habits};
use crate::points::{MultiRegisterPoint, Plan};
use crate::profile::{Order, Type};
use modlens_protocol::register_type::Space;

/// The number of samples after which a point is judged for good.
const ENOUGH_SAMPLES: usize = 40;

/// The numbers of samples after which another order is reported, if it is already certain.
const EARLY: [usize; 2] = [10, 20];

/// A bit set that contains every order.
const EVERY_ORDER: u8 = (1 << Order::ALL.len()) - 1;

/// Samples of one unit's points that take more than one register. They are dropped once the point has been judged.
#[derive(Debug, Default)]
pub struct OrderCheck {
    /// The samples of each point in `Plan::wide_point`.
    points: Vec<Samples>,
    unjudged: UnjudgedAddresses,
    /// The number of points that have been judged.
    judged: usize,
}

/// For each table, a bit per address: set if a value that is still to be judged begins there. Empty before the first
/// block.
#[derive(Debug, Default)]
struct UnjudgedAddresses([Vec<u64>; 4]);

/// The samples of one point so far; empty once it has been judged.
#[derive(Clone, Debug, Default)]
struct Samples {
    /// The registers of all samples, one sample after the other.
    registers: Vec<u16>,
    /// A bit set of the orders in which a sample is no plausible float. If it contains every order, the point cannot be
    /// judged, and no mismatch is reported.
    implausible_orders: u8,
}

/// A point whose values make sense in another order than the profile's.
pub struct Mismatch {
    /// Index of the value in the plan.
    pub compiled_index: u32,
    /// The order in which its values make sense.
    pub order: Order,
    /// The evidence for that order, as text.
    pub reason: String,
}

impl OrderCheck {
    /// Whether all points have been judged, which is the case for most of a recording.
    pub fn done(&self, plan: &Plan) -> bool {
        self.judged >= plan.multi_register_points().len()
    }

    /// Adds a block of registers that was read, unless a point can be judged with it. Returns `false` in that case,
    /// without adding anything: the caller must then call `add_and_judge`, which is slower.
    pub fn add_unless_ready(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> bool {
        if self.points.is_empty() {
            return plan.multi_register_points().is_empty();
        }
        let Self { points, unjudged, .. } = self;
        let ready =
            |(at, wide_point, block): (usize, &MultiRegisterPoint, &[u8])| points[at].after_adding(plan, wide_point, block).1;
        if unjudged.unjudged_in_block(plan, space, first, bytes).any(ready) {
            return false;
        }
        for (at, wide_point, block) in unjudged.unjudged_in_block(plan, space, first, bytes) {
            points[at].add(plan, wide_point, block);
        }
        true
    }

    /// Whether this block has a value that is still to be judged.
    pub fn is_open(&self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> bool {
        self.unjudged.unjudged_in_block(plan, space, first, bytes).next().is_some()
    }

    /// Adds a block of registers that was read, and judges each point that now has enough samples.
    pub fn add_and_judge(&mut self, plan: &Plan, space: Space, first: u16, bytes: &[u8]) -> Vec<Mismatch> {
        if self.points.is_empty() {
            self.start(plan);
        }
        let (mut mismatches, mut judged) = (Vec::new(), Vec::<usize>::new());
        for (at, wide_point, block) in self.unjudged.unjudged_in_block(plan, space, first, bytes) {
            let point = &mut self.points[at];
            if point.add(plan, wide_point, block) {
                let found = point.mismatch(plan, wide_point);
                if found.is_some() || !point.is_early(wide_point) {
                    *point = Samples::default();
                    judged.push(at);
                }
                mismatches.extend(found);
            }
        }
        self.judged += judged.len();
        for at in judged {
            self.unjudged.mark_judged(&plan.multi_register_points()[at]);
        }
        mismatches
    }

    /// Prepares for all points of the plan, when the first block arrives.
    fn start(&mut self, plan: &Plan) {
        self.points.resize_with(plan.multi_register_points().len(), Samples::default);
        plan.multi_register_points().iter().for_each(|wide_point| self.unjudged.add(wide_point));
    }
}

impl UnjudgedAddresses {
    fn add(&mut self, wide_point: &MultiRegisterPoint) {
        let unjudged = &mut self.0[wide_point.space as usize];
        unjudged.resize(1024, 0);
        unjudged[usize::from(wide_point.address) / 64] |= 1 << (wide_point.address % 64);
    }

    fn mark_judged(&mut self, wide_point: &MultiRegisterPoint) {
        self.0[wide_point.space as usize][usize::from(wide_point.address) / 64] &= !(1 << (wide_point.address % 64));
    }

    /// The values of a block that are still to be judged: their index in `Plan::wide_point`, and the bytes of their
    /// registers.
    fn unjudged_in_block<'a>(
        &'a self,
        plan: &'a Plan,
        space: Space,
        first: u16,
        bytes: &'a [u8],
    ) -> impl Iterator<Item = (usize, &'a MultiRegisterPoint, &'a [u8])> {
        let end = usize::from(first) + bytes.len() / 2;
        let any = self.any_in(space, first, end);
        let first_index = if any {
            plan.multi_register_points().partition_point(|wide_point| (wide_point.space, wide_point.address) < (space, first))
        } else {
            usize::MAX
        };
        let is_in_block = move |(_, wide_point): &(usize, &MultiRegisterPoint)| {
            wide_point.space == space && usize::from(wide_point.address) < end
        };
        plan.multi_register_points().iter().enumerate().skip(first_index).take_while(is_in_block).filter_map(
            move |(at, wide_point)| {
                let start = 2 * usize::from(wide_point.address - first);
                let block = bytes.get(start..start + 2 * usize::from(wide_point.width))?;
                self.has(space, wide_point.address).then_some((at, wide_point, block))
            },
        )
    }

    fn has(&self, space: Space, address: u16) -> bool {
        self.0[space as usize][usize::from(address) / 64] >> (address % 64) & 1 == 1
    }

    /// Whether a value that is still to be judged begins in the block. Checks 64 addresses at a time.
    fn any_in(&self, space: Space, first: u16, end: usize) -> bool {
        let (mut at, last) = (usize::from(first), end.min(0x1_0000));
        let unjudged = &self.0[space as usize];
        while at < last && !unjudged.is_empty() {
            let here = (64 - at % 64).min(last - at);
            if unjudged[at / 64] >> (at % 64) << (64 - here) != 0 {
                return true;
            }
            at += here;
        }
        false
    }
}

impl Samples {
    /// The orders that are ruled out for a float once this sample is added (as in `implausible_orders`), and whether there are then
    /// enough samples to judge.
    fn after_adding(&self, plan: &Plan, wide_point: &MultiRegisterPoint, block: &[u8]) -> (u8, bool) {
        let point = plan.point(plan.compiled_point(wide_point.compiled_index));
        let mut implausible_orders = self.implausible_orders;
        if is_float(point.kind) {
            implausible_orders |= 1 << point.order as u8;
            for (order, _) in Order::ALL {
                implausible_orders |= u8::from(!is_plausible_float(block, order)) << order as u8;
            }
        }
        let samples = self.registers.len() / usize::from(wide_point.width) + 1;
        let enough = samples >= ENOUGH_SAMPLES || EARLY.contains(&samples);
        (implausible_orders, enough || implausible_orders == EVERY_ORDER)
    }

    /// Whether more samples may still decide.
    fn is_early(&self, wide_point: &MultiRegisterPoint) -> bool {
        self.implausible_orders != EVERY_ORDER && self.registers.len() < ENOUGH_SAMPLES * usize::from(wide_point.width)
    }

    /// Adds a sample. Returns whether there are now enough to judge.
    fn add(&mut self, plan: &Plan, wide_point: &MultiRegisterPoint, block: &[u8]) -> bool {
        let (implausible_orders, enough) = self.after_adding(plan, wide_point, block);
        self.implausible_orders = implausible_orders;
        if implausible_orders == EVERY_ORDER {
            return true;
        }
        if self.registers.is_empty() {
            self.registers.reserve_exact(ENOUGH_SAMPLES * usize::from(wide_point.width));
        }
        self.registers.extend(block.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])));
        enough
    }

    /// Judges a point: the mismatch, if another order is clearly more plausible than that of the profile.
    fn mismatch(&self, plan: &Plan, wide_point: &MultiRegisterPoint) -> Option<Mismatch> {
        let enough = self.registers.len() >= EARLY[0] * usize::from(wide_point.width);
        let rows: Vec<&[u16]> = self.registers.chunks_exact(usize::from(wide_point.width)).filter(|_| enough).collect();
        let point = plan.point(plan.compiled_point(wide_point.compiled_index));
        let hypotheses = rank_types(&rows, &vec![true; rows.len()], &Habits::default());
        let best = hypotheses.first().filter(|hypothesis| hypothesis.is_certain && hypothesis.order != point.order)?;
        // The profile's type is taken for granted; only the order is judged. So a float is not compared with readings
        // as an integer.
        let same_kind_of_number = is_float(best.kind) == is_float(point.kind);
        let profile_order_comes_close =
            hypotheses.iter().any(|hypothesis| hypothesis.order == point.order && hypothesis.bits + 6.0 > best.bits);
        (same_kind_of_number && !profile_order_comes_close).then(|| Mismatch {
            compiled_index: wide_point.compiled_index,
            order: best.order,
            reason: best.reason.clone(),
        })
    }
}

fn is_float(kind: Type) -> bool {
    matches!(kind, Type::F32 | Type::F64)
}
