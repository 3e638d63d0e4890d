//! What a block of registers or bits contains by the plan of its unit, found once for all transactions with that block: a
//! master polls the same blocks again and again.

use std::sync::{Arc, OnceLock};

use crate::points::number_groups::NumberGroups;
use crate::points::{LayoutEntry, PlanInstance};
use modlens_protocol::register_type::Space;

/// The entries of a block, which has at least one value of a point.
#[derive(Debug)]
pub struct BlockPlan {
    /// The plan, with the scale factors known at that moment.
    pub instance: Arc<PlanInstance>,
    /// By address: the values that lie completely inside the block, and every register or bit that belongs to none of those.
    pub entries: Vec<LayoutEntry>,
    /// The address of the first register or bit.
    first: u16,
    /// Its numbers by how they are decoded, once somebody has asked for one.
    groups: OnceLock<NumberGroups>,
}

impl BlockPlan {
    /// Whether a number of this block of registers satisfies `is_wanted`. `bytes` are those of its registers. `NO_NUMBER` of an
    /// entry without a number is asked for, too.
    #[inline]
    pub fn has_number(&self, bytes: &[u8], is_wanted: impl Fn(f64) -> bool) -> bool {
        let groups = self.groups.get_or_init(|| NumberGroups::new(&self.instance, &self.entries, self.first));
        groups.any(&self.instance, bytes, is_wanted)
    }
}

/// A block by its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct BlockKey {
    space: Space,
    first: u16,
    count: u16,
}

/// A block of one unit that was asked for.
#[derive(Debug)]
struct KnownBlock {
    key: BlockKey,
    instance: Arc<PlanInstance>,
    /// `None` of a block without a value of a point.
    plan: Option<Arc<BlockPlan>>,
    /// The list that has it, and its place there.
    listed: (u64, u32),
}

/// Places for blocks at first, and at most: powers of two.
const FIRST_PLACES: usize = 16;
const MAX_PLACES: usize = 1024;

/// The blocks that were asked for last.
#[derive(Debug, Default)]
pub struct BlockPlans {
    places: Vec<Option<KnownBlock>>,
    /// The number of the list made last.
    list: u64,
}

impl BlockPlans {
    /// The number of a new list of blocks.
    pub fn begin_list(&mut self) -> u64 {
        self.list += 1;
        self.list
    }

    /// The place in a list of the block of `count` registers or bits from `first` on; it is added if it is not there. `None` if
    /// no value of a point is in it. `list`: its number, and the blocks that were asked for with that.
    #[inline]
    pub fn place_of(
        &mut self,
        (list, plans): (u64, &mut Vec<Arc<BlockPlan>>),
        instance: &Arc<PlanInstance>,
        (space, first, count): (Space, u16, u16),
    ) -> Option<u32> {
        let key = BlockKey { space, first, count };
        let at = self.place(key, instance);
        match self.places.get(at) {
            Some(Some(known)) if known.key == key && Arc::ptr_eq(&known.instance, instance) => {}
            _ => self.add(key, instance),
        }
        let at = self.place(key, instance);
        let known = self.places[at].as_mut()?;
        let plan = known.plan.as_ref()?;
        if known.listed.0 != list {
            known.listed = (list, plans.len() as u32);
            plans.push(Arc::clone(plan));
        }
        Some(known.listed.1)
    }

    /// The place of a block: some of the highest bits of its product with an odd number without pattern.
    #[inline]
    fn place(&self, key: BlockKey, instance: &Arc<PlanInstance>) -> usize {
        let block = (key.space as u64) << 32 | u64::from(key.first) << 16 | u64::from(key.count);
        let mixed = (block ^ (Arc::as_ptr(instance) as u64) << 24).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> (u64::BITS - MAX_PLACES.ilog2())) as usize & self.places.len().wrapping_sub(1)
    }

    /// Finds out what a block contains. If there is another one at its place, there come to be more places, or at last it takes
    /// that place.
    #[cold]
    fn add(&mut self, key: BlockKey, instance: &Arc<PlanInstance>) {
        let BlockKey { space, first, count } = key;
        let mut entries = Vec::new();
        instance.plan.block(space, first, usize::from(count), |entry| entries.push(entry));
        let has_point = entries.iter().any(|entry| entry.compiled_index().is_some());
        let instance = Arc::clone(instance);
        let plan =
            has_point.then(|| Arc::new(BlockPlan { instance: Arc::clone(&instance), entries, first, groups: OnceLock::new() }));
        if self.places.is_empty() {
            self.places.resize_with(FIRST_PLACES, || None);
        }
        while self.places[self.place(key, &instance)].is_some() && self.places.len() < MAX_PLACES {
            let known = std::mem::take(&mut self.places);
            self.places.resize_with(2 * known.len(), || None);
            known.into_iter().flatten().for_each(|known| self.put(known));
        }
        self.put(KnownBlock { key, instance, plan, listed: (0, 0) });
    }

    fn put(&mut self, known: KnownBlock) {
        let at = self.place(known.key, &known.instance);
        self.places[at] = Some(known);
    }
}
