//! Which unit of which bus has which profile.

use std::collections::HashMap;
use std::sync::Arc;

use crate::check::Found;
use crate::pairing::Exchange;
use crate::session::Session;
use modlens_profiles::points::sunspec::{marker, Chain};
use modlens_profiles::points::watch::Watch;
use modlens_profiles::points::{Bound, Plan};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::{Functions, Operation};
use modlens_protocol::pdu::u16_at;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// A profile for some units, of one bus or of all.
pub(super) struct Assignment {
    bus: Option<String>,
    units: Vec<u8>,
    plan: Arc<Plan>,
}

/// The profiles of one bus by unit; empty where there are none at all.
#[derive(Default)]
pub(super) struct Profiles {
    by_unit: Vec<Option<Arc<Bound>>>,
    /// `SunSpec` models of units that no profile was given for.
    chains: HashMap<u8, Chain>,
    watches: Vec<Watch>,
}

impl Session {
    /// Binds a profile to units, on one bus (by its name) or on all; the last one wins. Buses are told when they are
    /// added, so bind first.
    pub fn bind(&mut self, bus: Option<&str>, units: &[u8], plan: &Arc<Plan>) {
        let plan = Arc::clone(plan);
        self.assignments.push(Assignment { bus: bus.map(str::to_owned), units: units.to_vec(), plan });
    }

    pub(super) fn profiles_of(&self, bus: &str) -> Profiles {
        let mut profiles = Profiles::default();
        for one in self.assignments.iter().filter(|one| one.bus.as_deref().is_none_or(|name| name == bus)) {
            profiles.make_room();
            for &unit in &one.units {
                profiles.by_unit[usize::from(unit)] = Some(Arc::new(Bound::new(Arc::clone(&one.plan))));
            }
        }
        profiles
    }
}

impl Profiles {
    /// The profile of the exchange's unit, with what this exchange itself told: scale factors, `SunSpec` models. What
    /// the values say against the profile goes to `found`.
    pub(super) fn on(&mut self, functions: &Functions, exchange: &Exchange, found: &mut Found) -> Option<Arc<Bound>> {
        let unit = exchange.unit;
        let read = || registers_read(functions, exchange).filter(|_| exchange.status == Status::Ok);
        if self.by_unit.get(usize::from(unit)).is_none_or(Option::is_none) {
            let (_, first, bytes) = read().filter(|(space, ..)| *space == Space::Holding)?;
            self.discover(unit, first, bytes)?;
        } else if !self.chains.is_empty() && self.chains.contains_key(&unit) {
            if let Some((Space::Holding, first, bytes)) = read() {
                self.discover(unit, first, bytes);
            }
        }
        let bound = self.by_unit.get_mut(usize::from(unit))?.as_mut()?;
        let known = &bound.plan.profile.device.functions;
        // A damaged request may have asked for anything.
        if !known.is_empty() && !known.contains(&exchange.function) && exchange.status != Status::BadRequest {
            let listed: Vec<String> = known.iter().map(u8::to_string).collect();
            found.push((
                Finding::UnsupportedFunction,
                format!("function {}; the profile has {}", exchange.function, listed.join(", ")),
            ));
        }
        let watch = &mut self.watches[usize::from(unit)];
        if bound.has_factors() || !watch.done(&bound.plan) {
            if let Some((space, first, bytes)) = read() {
                for one in watch.see(&bound.plan, space, first, bytes) {
                    let compiled = bound.plan.compiled(one.compiled);
                    let said = bound.plan.point(compiled).order.word();
                    let text = format!("{}: {}, not {said}: {}", compiled.name, one.order.word(), one.reason);
                    found.push((Finding::OrderMismatch, text));
                }
                if let Some(changed) = bound.learn(space, first, bytes) {
                    *bound = Arc::new(changed);
                }
            }
        }
        Some(Arc::clone(bound))
    }

    /// Whether an answer says nothing that is to be told; else `on` has to look. The request begins with the unit, the
    /// block is what was read, if anything was; it is taken note of.
    #[inline]
    pub(super) fn take(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> bool {
        self.by_unit.is_empty() || self.take_block(functions, request, block)
    }

    fn take_block(&mut self, functions: &Functions, request: &[u8], block: Option<&[u8]>) -> bool {
        let [unit, code, high, low, ..] = *request else { return false };
        let Some(bound) = &self.by_unit[usize::from(unit)] else { return !self.chains.contains_key(&unit) };
        let (plan, first, watch) = (&bound.plan, u16::from_be_bytes([high, low]), &mut self.watches[usize::from(unit)]);
        let known = &plan.profile.device.functions;
        if self.chains.contains_key(&unit) || !(known.is_empty() || known.contains(&code)) {
            return false;
        }
        let Some(block) = block.filter(|_| bound.has_factors() || !watch.done(plan)) else { return true };
        let space = functions.row(code, &request[2..]).and_then(|row| row.space);
        let mut quiet = |space| bound.learn(space, first, block).is_none() && watch.take(plan, space, first, block);
        space.is_some_and(|space| space.bits() || quiet(space))
    }

    /// The profile of a unit.
    #[inline]
    pub(super) fn of(&self, unit: u8) -> Option<Arc<Bound>> {
        self.by_unit.get(usize::from(unit))?.clone()
    }

    fn make_room(&mut self) {
        self.by_unit.resize(256, None);
        self.watches.resize_with(256, Watch::default);
    }

    /// Looks for `SunSpec` models in a block; `None` if none is known of this unit.
    fn discover(&mut self, unit: u8, first: u16, bytes: &[u8]) -> Option<()> {
        if marker(first, bytes).is_none() && (self.chains.is_empty() || !self.chains.contains_key(&unit)) {
            return None;
        }
        if self.chains.entry(unit).or_default().see(first, bytes) {
            let plan = Arc::new(Plan::new(self.chains[&unit].profile()));
            self.make_room();
            let slot = &mut self.by_unit[usize::from(unit)];
            let bound = slot.as_ref().map_or_else(|| Bound::new(Arc::clone(&plan)), |old| old.extended(Arc::clone(&plan)));
            *slot = Some(Arc::new(bound));
            self.watches[usize::from(unit)] = Watch::default();
        }
        self.by_unit.get(usize::from(unit))?.as_ref().map(|_| ())
    }
}

/// The block of registers that an exchange read.
fn registers_read<'e>(functions: &Functions, exchange: &'e Exchange) -> Option<(Space, u16, &'e [u8])> {
    let body = exchange.request.pdu().get(1..)?;
    let row = functions.row(exchange.function, body)?;
    if !matches!(row.operation, Operation::Read | Operation::ReadWrite) {
        return None;
    }
    let space = row.space?;
    let (at, bits) = row.roles.response_block?;
    let bytes = exchange.response.pdu().get(1 + at..).filter(|_| !bits)?;
    Some((space, u16_at(body, row.roles.address?)?, bytes))
}
