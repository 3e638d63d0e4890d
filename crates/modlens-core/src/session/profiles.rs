//! Which unit of which bus has which profile.

use std::sync::Arc;

use crate::functions::{Functions, Operation};
use crate::pairing::Exchange;
use crate::pdu::u16_at;
use crate::points::{Bound, Plan};
use crate::profile::Space;
use crate::records::Status;
use crate::session::Session;

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
            profiles.by_unit.resize(256, None);
            for &unit in &one.units {
                profiles.by_unit[usize::from(unit)] = Some(Arc::new(Bound::new(Arc::clone(&one.plan))));
            }
        }
        profiles
    }
}

impl Profiles {
    /// The profile of the exchange's unit, with the scale factors that this exchange itself may have told.
    pub(super) fn on(&mut self, functions: &Functions, exchange: &Exchange) -> Option<Arc<Bound>> {
        let bound = self.by_unit.get_mut(usize::from(exchange.unit))?.as_mut()?;
        if bound.has_factors() && exchange.status == Status::Ok {
            if let Some((space, first, bytes)) = registers_read(functions, exchange) {
                if let Some(changed) = bound.learn(space, first, bytes) {
                    *bound = Arc::new(changed);
                }
            }
        }
        Some(Arc::clone(bound))
    }
}

/// The block of registers that an exchange read.
fn registers_read<'e>(functions: &Functions, exchange: &'e Exchange) -> Option<(Space, u16, &'e [u8])> {
    let body = exchange.request.pdu.get(1..)?;
    let row = functions.row(exchange.function, body)?;
    if !matches!(row.operation, Operation::Read | Operation::ReadWrite) {
        return None;
    }
    let space = Space::from_word(row.register_type.as_deref()?)?;
    let (at, bits) = row.roles.response_block?;
    let bytes = exchange.response.pdu.get(1 + at..).filter(|_| !bits)?;
    Some((space, u16_at(body, row.roles.address?)?, bytes))
}
