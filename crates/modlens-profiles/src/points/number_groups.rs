//! The numbers of a block of registers, those together that are decoded alike: a loop for each way, without a decision for
//! each number.

use crate::points::fast_decoder::NumberForm;
use crate::points::{LayoutEntry, PlanInstance};

/// The entries of a block by their decoder.
#[derive(Debug)]
pub(super) struct NumberGroups {
    groups: Vec<Group>,
    /// Where the registers of each entry begin, in bytes, group by group.
    offsets: Vec<u16>,
    /// The entries of groups without a loop of their own, to be decoded one by one.
    others: Vec<LayoutEntry>,
    /// The address of the first register.
    first: u16,
}

/// Entries with the same decoder.
#[derive(Debug)]
struct Group {
    form: NumberForm,
    /// The end of its part of `NumberGroups::offsets`.
    end: usize,
}

impl NumberGroups {
    /// Groups the entries of a block of registers from address `first` on.
    pub(super) fn new(instance: &PlanInstance, entries: &[LayoutEntry], first: u16) -> Self {
        let decoder = |entry: &LayoutEntry| &instance.plan.decoders[usize::from(entry.decoder)];
        let mut by_form: Vec<(NumberForm, Vec<u16>)> = Vec::new();
        let mut others = Vec::new();
        for entry in entries {
            let Some(form) = decoder(entry).form() else {
                others.push(*entry);
                continue;
            };
            let offset = 2 * entry.address.wrapping_sub(first);
            match by_form.iter_mut().find(|(known, _)| *known == form) {
                Some((_, offsets)) => offsets.push(offset),
                None => by_form.push((form, vec![offset])),
            }
        }
        let (mut groups, mut offsets) = (Vec::new(), Vec::new());
        for (form, of_form) in by_form {
            offsets.extend(of_form);
            groups.push(Group { form, end: offsets.len() });
        }
        Self { groups, offsets, others, first }
    }

    /// Whether a number of the block, of which these are the bytes, satisfies `is_wanted`, as no NaN does.
    #[inline]
    pub(super) fn any(&self, instance: &PlanInstance, bytes: &[u8], is_wanted: impl Fn(f64) -> bool) -> bool {
        let (mut start, mut found) = (0, false);
        for Group { form, end } in &self.groups {
            found |= form.any(&self.offsets[start..*end], bytes, &is_wanted);
            start = *end;
        }
        found || self.others.iter().any(|entry| is_wanted(instance.entry_number(*entry, self.first, bytes)))
    }
}
