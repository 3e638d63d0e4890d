//! Which profile the units of a bus have: given by the user, or discovered from `SunSpec` models.

use std::collections::HashMap;
use std::sync::Arc;

use crate::findings::{self, Found};
use crate::pairing::PendingTransaction;
use modlens_profiles::points::order_check::OrderCheck;
use modlens_profiles::points::sunspec::{marker, Chain};
use modlens_profiles::points::{Plan, PlanInstance};
use modlens_protocol::functions::{Functions, Operation};
use modlens_protocol::pdu::u16_at;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// A profile that the user gave to some units.
pub(super) struct Assignment {
    /// Name of the bus; all buses where `None`.
    pub(super) bus: Option<String>,
    pub(super) units: Vec<u8>,
    pub(super) plan: Arc<Plan>,
}

/// The profiles of the units of one bus.
#[derive(Default)]
pub(crate) struct Profiles {
    /// The profile of each unit with the scale factors known by now; empty while no unit has one.
    by_unit: Vec<Option<Arc<PlanInstance>>>,
    /// The `SunSpec` models of units that the user gave no profile for, as far as they have been read.
    sunspec_chains: HashMap<u8, Chain>,
    /// For each unit, the check of the profile's order of bytes against the values.
    order_checks: Vec<OrderCheck>,
}

impl Profiles {
    /// Whether no unit has a profile.
    #[inline]
    pub(crate) fn are_none(&self) -> bool {
        self.by_unit.is_empty()
    }

    /// The profiles that the user gave to the units of a bus; a later assignment wins.
    pub(super) fn of_bus(assignments: &[Assignment], bus: &str) -> Self {
        let mut profiles = Self::default();
        for assignment in assignments.iter().filter(|given| given.bus.as_deref().is_none_or(|name| name == bus)) {
            profiles.make_room();
            for &unit in &assignment.units {
                profiles.by_unit[usize::from(unit)] = Some(Arc::new(PlanInstance::new(Arc::clone(&assignment.plan))));
            }
        }
        profiles
    }

    /// Learns scale factors and `SunSpec` models from a transaction; gives the profile of its unit after that. If values or
    /// function contradict the profile, a finding is added to `found` (none on the function of a request that arrived damaged).
    /// `None` if the unit has no profile.
    ///
    /// Only registers that were read with success (status `ok`) teach anything. A unit without profile gets one if they are
    /// holding registers that begin or continue its `SunSpec` models. The order of bytes is checked until each point is judged;
    /// with scale factors for ever, because these may change.
    pub(super) fn learn_from(
        &mut self,
        functions: &Functions,
        transaction: &PendingTransaction,
        found: &mut Found,
    ) -> Option<Arc<PlanInstance>> {
        let unit = usize::from(transaction.unit);
        let read = registers_read(functions, transaction).filter(|_| transaction.status == Status::Ok);
        self.discover_models(transaction.unit, read);
        let instance = self.by_unit.get_mut(unit)?.as_mut()?;
        findings::profile::function(&instance.plan, transaction, found);
        if let Some((space, first, bytes)) = read {
            let order_check = &mut self.order_checks[unit];
            if instance.has_factors() || !order_check.done(&instance.plan) {
                for mismatch in order_check.add_and_judge(&instance.plan, space, first, bytes) {
                    findings::profile::order(&instance.plan, &mismatch, found);
                }
                if let Some(changed) = instance.with_factors_from(space, first, bytes) {
                    *instance = Arc::new(changed);
                }
            }
        }
        Some(Arc::clone(instance))
    }

    /// Looks for `SunSpec` models in holding registers that were read. Not for a unit that has a profile from the user; for one
    /// without profile, or whose profile was made from its models, which may go on.
    fn discover_models(&mut self, unit: u8, read: Option<(Space, u16, &[u8])>) {
        let Some((Space::Holding, first, bytes)) = read else { return };
        let has_profile = self.by_unit.get(usize::from(unit)).is_some_and(Option::is_some);
        if !has_profile || self.sunspec_chains.contains_key(&unit) {
            self.discover(unit, first, bytes);
        }
    }

    /// Learns from a transaction on the fast path, if that takes no more than adding it to the check of the order of bytes. Else
    /// `false`, with nothing learned: it may give a finding or change the profile, and has to go through `learn_from`.
    /// `request` begins with the unit, `block` are the registers read, if any were.
    #[inline]
    pub(crate) fn learn_on_fast_path(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> bool {
        self.by_unit.is_empty() || self.learn_block(functions, request, block)
    }

    /// The part of `learn_on_fast_path` for buses with profiles; it gives the same answer. A unit without profile, or a block of
    /// bits, changes nothing: `true`. `false`, with nothing learned, if the unit has `SunSpec` models, if the profile does
    /// not list the function or the table has no address space for it, if a scale factor would change, or if the check of the
    /// order of bytes has not begun or could be decided with this block. Else the block is added to the check of that order.
    fn learn_block(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> bool {
        let [unit, code, high, low, ..] = *request else { return false };
        let Some(instance) = &self.by_unit[usize::from(unit)] else { return !self.sunspec_chains.contains_key(&unit) };
        let (plan, first, order_check) =
            (&instance.plan, u16::from_be_bytes([high, low]), &mut self.order_checks[usize::from(unit)]);
        let listed = &plan.profile.device.functions;
        if self.sunspec_chains.contains_key(&unit) || !(listed.is_empty() || listed.contains(&code)) {
            return false;
        }
        let Some(block) = block.filter(|_| instance.has_factors() || !order_check.done(plan)) else { return true };
        let space = functions.row(code, &request[2..]).and_then(|row| row.space);
        let mut changes_nothing = |space| {
            instance.with_factors_from(space, first, block).is_none() && order_check.add_unless_ready(plan, space, first, block)
        };
        space.is_some_and(|space| space.is_bits() || changes_nothing(space))
    }

    /// The profile of a unit.
    #[inline]
    pub(crate) fn of_unit(&self, unit: u8) -> Option<Arc<PlanInstance>> {
        self.by_unit.get(usize::from(unit))?.clone()
    }

    /// Makes room for the profiles of all units, before the first one is set.
    fn make_room(&mut self) {
        self.by_unit.resize(256, None);
        self.order_checks.resize_with(256, OrderCheck::default);
    }

    /// Looks for `SunSpec` models in a block of holding registers: `bytes`, from the address `first` on. Without the marker,
    /// blocks of a unit that has not shown it before are passed over.
    ///
    /// A device begins its models with a marker in a fixed register, and each model gives the length to the next one. What
    /// has been read of them so far is compiled to a profile, again whenever a further model is found.
    fn discover(&mut self, unit: u8, first: u16, bytes: &[u8]) {
        if marker(first, bytes).is_none() && (self.sunspec_chains.is_empty() || !self.sunspec_chains.contains_key(&unit)) {
            return;
        }
        if self.sunspec_chains.entry(unit).or_default().follow(first, bytes) {
            let plan = Arc::new(Plan::new(self.sunspec_chains[&unit].profile()));
            self.make_room();
            let slot = &mut self.by_unit[usize::from(unit)];
            let instance =
                slot.as_ref().map_or_else(|| PlanInstance::new(Arc::clone(&plan)), |old| old.extended(Arc::clone(&plan)));
            *slot = Some(Arc::new(instance));
            self.order_checks[usize::from(unit)] = OrderCheck::default();
        }
    }
}

/// The block of registers that a transaction has read: address space, first address, and the bytes. `None` if its function is
/// unknown or does not read, if it reads bits, or if request or response are too short.
fn registers_read<'t>(functions: &Functions, transaction: &'t PendingTransaction) -> Option<(Space, u16, &'t [u8])> {
    let body = transaction.request.pdu().get(1..)?;
    let row = functions.row(transaction.function, body)?;
    if !matches!(row.operation, Operation::Read | Operation::ReadWrite) {
        return None;
    }
    let space = row.space?;
    let (at, has_bits) = row.offsets.response_block?;
    let bytes = transaction.response.pdu().get(1 + at..).filter(|_| !has_bits)?;
    Some((space, u16_at(body, row.offsets.address?)?, bytes))
}
