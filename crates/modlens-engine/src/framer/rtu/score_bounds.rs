//! The most that a header may claim, by unit and by function code: looked up, where nearly no place begins a frame.
//!
//! A bound is worked out for a few more sightings than there were, and again once there are more. All other sightings
//! only make a header dearer; when what was seen is halved, all bounds go.

use crate::framer::rtu::bits::log2;
use crate::framer::rtu::costs::{usual_bits, OPEN_LENGTH, ORPHAN};
use crate::framer::rtu::gain::{REQUEST, RESPONSE};
use crate::framer::rtu::model::Model;
use modlens_protocol::functions::{FieldLimits, Functions, EXCEPTION_BIT};

/// So many times as many sightings.
const MORE: f32 = 1.125;

/// Bounds are worked out again once so many times as many frames were seen: they are half a bit too high then.
const LOOSE: f32 = 1.4;

/// A bound, and the sightings that it holds for, as a request and as a response.
#[derive(Clone, Copy)]
struct Bound {
    bits: f32,
    seen: [f32; 2],
}

const UNKNOWN: Bound = Bound { bits: 0.0, seen: [-1.0; 2] };

/// What was worked out.
pub struct Hints {
    units: Box<[Bound; 256]>,
    codes: Box<[Bound; 256]>,
    frames: f32,
}

impl Default for Hints {
    fn default() -> Self {
        Self { units: Box::new([UNKNOWN; 256]), codes: Box::new([UNKNOWN; 256]), frames: 0.0 }
    }
}

impl Hints {
    /// What was seen has become less.
    pub fn clear(&mut self) {
        self.units.fill(UNKNOWN);
        self.codes.fill(UNKNOWN);
    }

    /// There were so many frames.
    pub fn renew(&mut self, frames: f32) {
        if frames > LOOSE * self.frames || frames < self.frames / LOOSE {
            self.clear();
            self.frames = frames;
        }
    }
}

impl Model {
    /// The most bits that unit and function code of a header may claim, whatever follows, where they answer no request.
    pub fn claims_at_most(&mut self, functions: &Functions, unit: u8, code: u8) -> f32 {
        let seen = self.seen_unit(unit);
        let bound = &self.hints.units[usize::from(unit)];
        let of_unit = if seen <= bound.seen[0] {
            bound.bits
        } else {
            let bits = usual_bits(unit) - self.unit_if(unit, MORE * seen);
            self.hints.units[usize::from(unit)] = Bound { bits, seen: [MORE * seen; 2] };
            bits
        };
        let seen = [REQUEST, RESPONSE].map(|direction| self.seen_function(code, direction));
        let bound = &self.hints.codes[usize::from(code)];
        if seen[0] <= bound.seen[0] && seen[1] <= bound.seen[1] {
            return of_unit + bound.bits;
        }
        let seen = seen.map(|seen| MORE * seen);
        let bits = self.code_at_most(functions, code, seen);
        self.hints.codes[usize::from(code)] = Bound { bits, seen };
        of_unit + bits
    }

    fn code_at_most(&self, functions: &Functions, code: u8, seen: [f32; 2]) -> f32 {
        let function = code & !EXCEPTION_BIT;
        if function == 0 {
            return f32::MIN;
        }
        let permitted = |permits: &[FieldLimits]| permits.iter().map(permitted_at_most).sum::<f32>();
        // Without a row it is a request of any length.
        let mut request = -OPEN_LENGTH;
        let mut response = f32::MIN;
        for row in functions.variants(function) {
            let counts = if row.roles.request_block.is_some() { OPEN_LENGTH } else { 0.0 };
            request = request.max(permitted(&row.permits[REQUEST]) + counts);
            response = response.max(permitted(&row.permits[RESPONSE]));
        }
        if code != function {
            (request, response) = (f32::MIN, response.max(0.0));
        }
        let cost = |direction: usize| self.function_if(functions, code, direction, seen[direction]);
        usual_bits(code) + (request - cost(REQUEST)).max(response - cost(RESPONSE) - ORPHAN)
    }
}

/// The most that a field is worth whose values are limited.
fn permitted_at_most(permit: &FieldLimits) -> f32 {
    let choices: u64 = permit.ranges.iter().map(|(low, high)| u64::from(high - low) + 1).sum();
    let usual = |low: u32, high: u32| {
        let places = (0..permit.width as u32).map(|place| 8 * place);
        // A byte is the same in all values of a range where no bit of it differs, and none above it.
        places.map(|place| usual_bits(if (low ^ high) >> place == 0 { (high >> place) as u8 } else { 1 })).sum::<f32>()
    };
    let most = permit.ranges.iter().map(|&(low, high)| usual(low, high)).fold(0.0, f32::max);
    (most - log2(choices as f32)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framer::rtu::gain::{header, permitted};
    use crate::framer::rtu::model::{Copy, Setting};
    use crate::framer::Context;
    use modlens_protocol::direction::Direction;
    use proptest::prelude::*;

    #[test]
    fn no_field_is_worth_more_than_its_bound() {
        let model = Model::default();
        let permits = Functions::embedded().rows().flat_map(|row| row.permits.iter().flatten());
        let mut seen = 0;
        for permit in permits {
            for value in 0..=u16::MAX {
                let bytes = u32::from(value).to_be_bytes();
                let body = [&vec![0; permit.offset][..], &bytes[4 - permit.width..]].concat();
                assert!(permitted(&model, permit, &body) <= permitted_at_most(permit) + 0.01, "{permit:?} {value}");
                seen += 1;
            }
        }
        assert!(seen > 1_000_000);
    }

    proptest! {
        #[test]
        fn no_header_claims_more_than_its_bound(
            parts in proptest::collection::vec((0u8..4, 0u8..20, 0usize..2, proptest::collection::vec(0u8..4, 4..12)), 1..200),
        ) {
            let mut model = Model::default();
            let units = [false; 256];
            let context = Context {
                functions: Functions::embedded(),
                asked: None,
                ahead: true,
                shared: false,
                speaker: None,
                certain: None,
                known_units: &units,
                paired_units: &units,
                pause: &|_| 0.0,
                said: &|_| Direction::Unknown,
            };
            for (unit, code, direction, body) in parts {
                let seen = [&[unit, if code > 16 { code | EXCEPTION_BIT } else { code }][..], &body].concat();
                let bound = model.claims_at_most(context.functions, seen[0], seen[1]);
                if let Some(header) = header(&model, &context, None, &seen) {
                    prop_assert!(header.gain <= bound + 0.01, "{seen:02x?}: {} above {bound}", header.gain);
                }
                model.learn(&seen, direction, Setting { waiting: false, junk: 0 }, Copy::Unclear);
                model.learn_noise(&body);
                model.settle();
            }
        }
    }
}
