//! What a block of registers or bits contains by the plan of its unit, found once for all transactions with that block: a
//! master polls the same blocks again and again.

use std::sync::{Arc, OnceLock};

use crate::points::number_groups::{NumberGroups, RegisterBuffer};
use crate::points::{LayoutEntry, PlanInstance};
use modlens_protocol::register_type::Space;

/// The entries of a block.
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
    fn new(instance: &Arc<PlanInstance>, BlockKey { space, first, count }: BlockKey) -> Self {
        let mut entries = Vec::with_capacity(usize::from(count));
        instance.plan.block(space, first, usize::from(count), |entry| entries.push(entry));
        Self { instance: Arc::clone(instance), entries, first, groups: OnceLock::new() }
    }

    /// Whether a number of this block of registers satisfies `is_wanted`, as no NaN does. `bytes` are those of its registers.
    #[inline]
    pub fn has_number(&self, bytes: &[u8], buffer: &mut RegisterBuffer, is_wanted: impl Fn(f64) -> bool) -> bool {
        let groups = self.groups.get_or_init(|| NumberGroups::new(&self.instance, &self.entries, self.first));
        groups.any(&self.instance, bytes, buffer, is_wanted)
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
    /// The address of the plan. Only where `plan` is there, it is sure to be still the same plan.
    instance: usize,
    /// What it contains, if it was asked for again.
    plan: Option<Arc<BlockPlan>>,
    /// The list that has it, and its place there.
    listed: (u64, u32),
}

/// Places for blocks at first, and at most: powers of two.
const FIRST_PLACES: usize = 16;
const MAX_PLACES: usize = 1024;

/// The blocks that were asked for last. What a block contains is kept only if it comes again: a master may write somewhere else
/// each time.
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

    /// The place in a list of the block of `count` registers or bits from `first` on; it is added if it is not there. `None` of a
    /// block that did not come before, as far as is known. `list`: its number, and the blocks that were asked for with that.
    #[inline]
    pub fn place_of(
        &mut self,
        (list, plans): (u64, &mut Vec<Arc<BlockPlan>>),
        instance: &Arc<PlanInstance>,
        (space, first, count): (Space, u16, u16),
    ) -> Option<u32> {
        let key = BlockKey { space, first, count };
        let address = Arc::as_ptr(instance) as usize;
        let at = self.place(key, address);
        let same = |known: &&mut KnownBlock| known.key == key && known.instance == address;
        let Some(known) = self.places.get_mut(at).and_then(Option::as_mut).filter(same) else {
            self.note(KnownBlock { key, instance: address, plan: None, listed: (list, 0) });
            return None;
        };
        let plan = known.plan.get_or_insert_with(|| {
            known.listed = (0, 0);
            Arc::new(BlockPlan::new(instance, key))
        });
        if known.listed.0 != list {
            known.listed = (list, plans.len() as u32);
            plans.push(Arc::clone(plan));
        }
        Some(known.listed.1)
    }

    /// The place of a block: some of the highest bits of its product with an odd number without pattern.
    #[inline]
    fn place(&self, key: BlockKey, instance: usize) -> usize {
        let block = (key.space as u64) << 32 | u64::from(key.first) << 16 | u64::from(key.count);
        let mixed = (block ^ (instance as u64) << 24).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed >> (u64::BITS - MAX_PLACES.ilog2())) as usize & self.places.len().wrapping_sub(1)
    }

    /// Notes that a block has come. If its place has one that comes again and again, there come to be more places, or at last it
    /// has none.
    #[inline(never)]
    fn note(&mut self, block: KnownBlock) {
        if self.places.is_empty() {
            self.places.resize_with(FIRST_PLACES, || None);
        }
        // One that has not come since the list before may go.
        let list = self.list;
        let stays = |known: &KnownBlock| known.plan.is_some() && known.listed.0 + 1 >= list;
        while self.places[self.place(block.key, block.instance)].as_ref().is_some_and(stays) {
            if self.places.len() == MAX_PLACES {
                return;
            }
            let known = std::mem::take(&mut self.places);
            self.places.resize_with(2 * known.len(), || None);
            known.into_iter().flatten().for_each(|known| self.put(known));
        }
        self.put(block);
    }

    fn put(&mut self, block: KnownBlock) {
        let at = self.place(block.key, block.instance);
        self.places[at] = Some(block);
    }
}
