//! Which profile the units of a bus have: given by the user, or discovered from `SunSpec` models.

use std::collections::HashMap;
use std::sync::Arc;

use crate::findings::{self, Found};
use crate::pairing::PendingTransaction;
use modlens_profiles::order_check::OrderCheck;
use modlens_profiles::points::sunspec::{marker, Chain};
use modlens_profiles::points::{Plan, PlanInstance, UnitPlans};
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
    /// The profile of each unit with the scale factors known by now.
    plans: Arc<UnitPlans>,
    /// Changes with what blocks of a unit may teach: other points than before, or `SunSpec` models. 0 while no unit has a profile.
    generation: u32,
    /// The `SunSpec` models of units that the user gave no profile for, as far as they have been read.
    sunspec_chains: HashMap<u8, Chain>,
    /// For each unit, the check of the profile's order of bytes against the values; empty while no unit has a profile.
    order_checks: Vec<OrderCheck>,
}

/// What came of an exchange on the fast path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LearnOutcome {
    /// It was learned from.
    Learned,
    /// It taught nothing, and neither will another exchange with the same request in this generation (`Profiles::generation`).
    Settled,
    /// Nothing was learned: it may give a finding or change the profile, and has to go through `learn_from`.
    Refused,
}

impl Profiles {
    /// Whether no unit has a profile, or shows the beginning of one (`SunSpec`).
    #[inline]
    pub(crate) fn are_none(&self) -> bool {
        self.plans.are_none() && self.sunspec_chains.is_empty()
    }

    /// The profiles as they are now; `None` if no unit has one.
    #[inline]
    pub(crate) fn now(&self) -> Option<Arc<UnitPlans>> {
        (!self.plans.are_none()).then(|| Arc::clone(&self.plans))
    }

    /// The number of times that something other than values has changed, for who remembers what is settled.
    #[inline]
    pub(crate) fn generation(&self) -> u32 {
        self.generation
    }

    /// The profiles that the user gave to the units of a bus; a later assignment wins.
    pub(super) fn of_bus(assignments: &[Assignment], bus: &str) -> Self {
        let mut profiles = Self::default();
        for assignment in assignments.iter().filter(|given| given.bus.as_deref().is_none_or(|name| name == bus)) {
            for &unit in &assignment.units {
                profiles.set(unit, PlanInstance::new(Arc::clone(&assignment.plan)));
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
        let read = registers_read(functions, transaction).filter(|_| transaction.status == Status::Ok);
        self.discover_models(transaction.unit, read);
        let instance = Arc::clone(self.plans.of_unit(transaction.unit)?);
        findings::profile::function(&instance.plan, transaction, found);
        if let Some((space, first, bytes)) = read {
            let order_check = &mut self.order_checks[usize::from(transaction.unit)];
            if instance.has_factors() || !order_check.done(&instance.plan) {
                for mismatch in order_check.add_and_judge(&instance.plan, space, first, bytes) {
                    findings::profile::order(&instance.plan, &mismatch, found);
                }
                if let Some(changed) = instance.with_factors_from(space, first, bytes) {
                    Arc::make_mut(&mut self.plans).set(transaction.unit, changed);
                    return self.of_unit(transaction.unit);
                }
            }
        }
        Some(instance)
    }

    /// Looks for `SunSpec` models in holding registers that were read. Not for a unit that has a profile from the user; for one
    /// without profile, or whose profile was made from its models, which may go on.
    fn discover_models(&mut self, unit: u8, read: Option<(Space, u16, &[u8])>) {
        let Some((Space::Holding, first, bytes)) = read else { return };
        let has_profile = self.plans.of_unit(unit).is_some();
        if !has_profile || self.sunspec_chains.contains_key(&unit) {
            self.discover(unit, first, bytes);
        }
    }

    /// Learns from a transaction on the fast path, if that takes no more than adding it to the check of the order of bytes. Else
    /// `false`, with nothing learned: it may give a finding or change the profile, and has to go through `learn_from`.
    /// `request` begins with the unit, `block` are the registers read, if any were.
    #[inline]
    pub(crate) fn learn_on_fast_path(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> bool {
        self.are_none() || self.learn_block(functions, request, block) != LearnOutcome::Refused
    }

    /// The part of `learn_on_fast_path` for buses with profiles.
    ///
    /// A unit without profile, or a block of bits, changes nothing. Refused if the unit has `SunSpec` models, if the profile does
    /// not list the function or the table has no address space for it, if a scale factor would change, or if the check of the
    /// order of bytes has not begun or could be decided with this block. Else the block is added to the check of that order.
    #[inline(never)]
    pub(crate) fn learn_block(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> LearnOutcome {
        let [unit, code, high, low, ..] = *request else { return LearnOutcome::Refused };
        if self.sunspec_chains.contains_key(&unit) {
            return LearnOutcome::Refused;
        }
        let Some(instance) = self.plans.of_unit(unit) else { return LearnOutcome::Settled };
        let (plan, first, order_check) =
            (&instance.plan, u16::from_be_bytes([high, low]), &mut self.order_checks[usize::from(unit)]);
        if !plan.profile.device.lists_function(code) {
            return LearnOutcome::Refused;
        }
        let Some(block) = block.filter(|_| instance.has_factors() || !order_check.done(plan)) else {
            return LearnOutcome::Settled;
        };
        let Some(space) = functions.row(code, &request[2..]).and_then(|row| row.space) else { return LearnOutcome::Refused };
        if space.is_bits() {
            return LearnOutcome::Settled;
        }
        let changes_nothing =
            instance.with_factors_from(space, first, block).is_none() && order_check.add_unless_ready(plan, space, first, block);
        if !changes_nothing {
            return LearnOutcome::Refused;
        }
        if instance.has_factor_in(space, first, block.len()) || order_check.is_open(plan, space, first, block) {
            LearnOutcome::Learned
        } else {
            LearnOutcome::Settled
        }
    }

    /// Whether the fast path may take the refusal of a request with this unit and function: the profile has nothing to say to it.
    pub(crate) fn pass_over_refusal(&self, unit: u8, code: u8) -> bool {
        self.plans.of_unit(unit).is_none_or(|instance| {
            let device = &instance.plan.profile.device;
            device.lists_function(code) && device.exceptions.is_empty()
        })
    }

    /// The profile of a unit.
    #[inline]
    pub(crate) fn of_unit(&self, unit: u8) -> Option<Arc<PlanInstance>> {
        self.plans.of_unit(unit).cloned()
    }

    /// Gives a unit a profile, whose order of bytes has not been checked yet.
    fn set(&mut self, unit: u8, instance: PlanInstance) {
        Arc::make_mut(&mut self.plans).set(unit, instance);
        self.order_checks.resize_with(256, OrderCheck::default);
        self.order_checks[usize::from(unit)] = OrderCheck::default();
        self.generation += 1;
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
        let known = self.sunspec_chains.len();
        let is_longer = self.sunspec_chains.entry(unit).or_default().follow(first, bytes);
        if is_longer {
            let plan = Arc::new(Plan::new(self.sunspec_chains[&unit].profile()));
            let instance = match self.plans.of_unit(unit) {
                Some(old) => old.extended(plan),
                None => PlanInstance::new(plan),
            };
            self.set(unit, instance);
        } else if self.sunspec_chains.len() > known {
            self.generation += 1;
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
