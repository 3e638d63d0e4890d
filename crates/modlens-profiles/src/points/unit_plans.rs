//! The plans of the units of a bus at one moment, shared by all transactions of which that moment is one.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::points::block_plan::BlockPlans;
use crate::points::PlanInstance;

/// The number of unit addresses.
const UNITS: usize = 256;

/// The plan of each unit of a bus, with the scale factors known at one moment.
#[derive(Clone, Debug, Default)]
pub struct UnitPlans {
    /// By unit; empty while no unit has one.
    by_unit: Vec<Option<Arc<PlanInstance>>>,
    /// The blocks that were read so far. What replaces these plans goes on with them.
    blocks: Arc<Mutex<BlockPlans>>,
}

impl UnitPlans {
    /// Whether no unit has a plan.
    #[inline]
    pub fn are_none(&self) -> bool {
        self.by_unit.is_empty()
    }

    /// The plan of a unit.
    #[inline]
    pub fn of_unit(&self, unit: u8) -> Option<&Arc<PlanInstance>> {
        self.by_unit.get(usize::from(unit))?.as_ref()
    }

    /// Gives a unit another plan.
    pub fn set(&mut self, unit: u8, instance: PlanInstance) {
        self.by_unit.resize(UNITS, None);
        self.by_unit[usize::from(unit)] = Some(Arc::new(instance));
    }

    /// Gives a unit a plan that others have as well, or takes its own away.
    pub fn share(&mut self, unit: u8, instance: Option<Arc<PlanInstance>>) {
        self.by_unit.resize(UNITS, None);
        self.by_unit[usize::from(unit)] = instance;
    }

    /// What the blocks of these units contain, as far as somebody has asked.
    pub fn known_blocks(&self) -> MutexGuard<'_, BlockPlans> {
        // Whoever has panicked with it has left blocks that are complete.
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
