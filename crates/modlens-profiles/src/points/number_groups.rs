//! The numbers of a block of registers, those together that are decoded alike: a loop for each way, without a decision for
//! each number, which the compiler does for several numbers at once.

use crate::points::fast_decoder::NumberForm;
use crate::points::{LayoutEntry, PlanInstance};

/// Room for the registers of a block, of which a PDU has no more than 126: some of them twice, and every place that a byte can say.
const MOST_PLACES: usize = 256;

/// Each group has a multiple of this many registers, some of them twice: that many numbers are decoded side by side, and those that
/// are left over would be decoded one by one.
const PER_STEP: usize = 8;

/// Fewer numbers are decoded one by one.
const FEW: usize = 8;

/// The registers of a block as numbers. Kept by the caller, since it would have to be initialised for each block.
#[derive(Debug)]
pub struct RegisterBuffer {
    /// In the order of their addresses.
    by_address: [u16; MOST_PLACES],
    /// Group by group.
    by_group: [u16; MOST_PLACES],
}

impl Default for RegisterBuffer {
    fn default() -> Self {
        Self { by_address: [0; MOST_PLACES], by_group: [0; MOST_PLACES] }
    }
}

/// The entries of a block by how they are decoded.
#[derive(Debug)]
pub(super) struct NumberGroups {
    groups: Vec<Group>,
    /// The places of the registers in the block, group by group.
    places: Vec<u8>,
    /// The entries that are decoded one by one.
    others: Vec<LayoutEntry>,
    /// The address of the first register.
    first: u16,
}

/// Entries that are decoded alike.
#[derive(Debug)]
struct Group {
    form: NumberForm,
    /// The end of its part of `NumberGroups::places`.
    end: usize,
}

impl NumberGroups {
    /// Groups the entries of a block of registers from address `first` on.
    pub(super) fn new(instance: &PlanInstance, entries: &[LayoutEntry], first: u16) -> Self {
        let mut by_form: Vec<(NumberForm, Vec<u8>)> = Vec::new();
        let mut others = Vec::new();
        let are_many = entries.len() >= FEW;
        for entry in entries {
            let form = instance.plan.decoders[usize::from(entry.decoder)].form().filter(|_| are_many);
            let place = u8::try_from(entry.address.wrapping_sub(first)).ok().filter(|&at| at < u8::MAX);
            let Some((form, place)) = form.zip(place) else {
                others.push(*entry);
                continue;
            };
            let places = form.places(place);
            match by_form.iter_mut().find(|(known, _)| *known == form) {
                Some((_, of_form)) => of_form.extend(places),
                None => by_form.push((form, places.collect())),
            }
        }
        let padded: usize = by_form.iter().map(|(_, places)| places.len().next_multiple_of(PER_STEP)).sum();
        if padded > MOST_PLACES {
            return Self { groups: Vec::new(), places: Vec::new(), others: entries.to_vec(), first };
        }
        let (mut groups, mut places) = (Vec::new(), Vec::new());
        for (form, of_form) in by_form {
            // A group has whole pairs, so that they repeat as such.
            let all = of_form.len().next_multiple_of(PER_STEP);
            places.extend(of_form.iter().cycle().take(all));
            groups.push(Group { form, end: places.len() });
        }
        Self { groups, places, others, first }
    }

    /// Whether a number of the block, of which these are the bytes, satisfies `is_wanted`, as no NaN does.
    #[inline]
    pub(super) fn any(
        &self,
        instance: &PlanInstance,
        bytes: &[u8],
        RegisterBuffer { by_address, by_group }: &mut RegisterBuffer,
        is_wanted: impl Fn(f64) -> bool,
    ) -> bool {
        if self.groups.is_empty() {
            return self.any_other(instance, bytes, is_wanted);
        }
        by_address.iter_mut().zip(bytes.as_chunks().0).for_each(|(register, pair)| *register = u16::from_be_bytes(*pair));
        by_group.iter_mut().zip(&self.places).for_each(|(register, &at)| *register = by_address[usize::from(at)]);
        let (mut start, mut found) = (0, false);
        for Group { form, end } in &self.groups {
            found |= form.any(&by_group[start..*end], &is_wanted);
            start = *end;
        }
        found || self.any_other(instance, bytes, is_wanted)
    }

    /// The same of those that are decoded one by one.
    #[inline]
    fn any_other(&self, instance: &PlanInstance, bytes: &[u8], is_wanted: impl Fn(f64) -> bool) -> bool {
        self.others.iter().any(|entry| is_wanted(instance.entry_number(*entry, self.first, bytes)))
    }
}
