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
        instance.plan.extend_by_block((space, first, usize::from(count)), &mut entries);
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
    /// The address of the plan. What is known holds the plan itself, so that nothing else has this address.
    instance: usize,
    known: Option<KnownContents>,
    /// The list that has it, and its place there.
    listed: (u64, u32),
}

/// What a block contains, if it was asked for again.
#[derive(Debug)]
struct KnownContents {
    /// The number of entries.
    rows: u32,
    /// `None` if no value of a point is near.
    plan: Option<Arc<BlockPlan>>,
    _instance: Arc<PlanInstance>,
}

/// Where the entries of a block are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockEntries {
    /// Each register or bit is one.
    Bare,
    /// There are so many, at this place of the list.
    Listed(u32, u32),
    /// The block did not come before, as far as is known.
    Unknown,
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

impl KnownContents {
    #[cold]
    fn new(instance: &Arc<PlanInstance>, key: BlockKey) -> Self {
        let has_point = instance.plan.has_point_near(key.space, key.first, usize::from(key.count));
        let plan = has_point.then(|| Arc::new(BlockPlan::new(instance, key)));
        let rows = plan.as_ref().map_or(u32::from(key.count), |plan| plan.entries.len() as u32);
        Self { rows, plan, _instance: Arc::clone(instance) }
    }
}

impl BlockPlans {
    /// The number of a new list of blocks.
    pub fn begin_list(&mut self) -> u64 {
        self.list += 1;
        self.list
    }

    /// The entries of the block of `count` registers or bits from `first` on, which is added to a list if it is not there. `list`: its
    /// number, and the blocks that were asked for with that.
    #[inline]
    pub fn entries_of(
        &mut self,
        (list, plans): (u64, &mut Vec<Arc<BlockPlan>>),
        instance: &Arc<PlanInstance>,
        (space, first, count): (Space, u16, u16),
    ) -> BlockEntries {
        let key = BlockKey { space, first, count };
        let address = Arc::as_ptr(instance) as usize;
        let at = self.place(key, address);
        let same = |block: &&mut KnownBlock| block.key == key && block.instance == address;
        let Some(block) = self.places.get_mut(at).and_then(Option::as_mut).filter(same) else {
            self.note(KnownBlock { key, instance: address, known: None, listed: (0, 0) });
            return BlockEntries::Unknown;
        };
        let KnownContents { rows, plan, .. } = block.known.get_or_insert_with(|| KnownContents::new(instance, key));
        if block.listed.0 != list {
            block.listed = (list, plans.len() as u32);
            plans.extend(plan.clone());
        }
        if plan.is_some() {
            BlockEntries::Listed(block.listed.1, *rows)
        } else {
            BlockEntries::Bare
        }
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
        let stays = |block: &KnownBlock| block.known.is_some() && block.listed.0 + 1 >= list;
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
