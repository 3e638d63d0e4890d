//! A profile compiled to a plan: which points a block of registers holds, and how each is converted.
//!
//! This is the only place where registers become values. A value counts only if one transaction carries all of its
//! registers: what is cut by the end of a read, or split over two, is not put together.

mod convert;
pub mod sunspec;
mod value;
pub mod watch;

use std::sync::Arc;

use crate::profile::{Point, Profile, Space};

pub use convert::Convert;
pub use value::{push_float, Value};

/// One value of a point, as it is looked for in blocks.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// Its first register or bit.
    pub address: u16,
    /// Registers or bits that it takes.
    pub width: u16,
    /// Its name; those of an array have their number behind it.
    pub name: String,
    /// The point in the profile.
    pub point: u32,
    /// Which scale factor it needs.
    pub factor: Option<u16>,
    convert: Convert,
}

/// A part of a block: a value, or a register that no point of the plan has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Where it begins in the block.
    pub item: u16,
    /// In `Plan::compiled`; `None` for a bare register.
    pub compiled: Option<u32>,
}

/// A compiled profile.
#[derive(Debug, Default)]
pub struct Plan {
    /// The profile.
    pub profile: Profile,
    compiled: Vec<Compiled>,
    /// For each table, its part of `compiled`, which is sorted by address.
    spaces: [(u32, u32); 4],
    /// What holds the scale factors, in `compiled`.
    holders: Vec<u32>,
    wide: usize,
}

/// A plan as it applies to a unit at one moment: the scale factors last seen.
#[derive(Clone, Debug)]
pub struct Bound {
    /// The plan.
    pub plan: Arc<Plan>,
    factors: Vec<Option<i32>>,
}

impl Plan {
    /// Compiles a profile.
    pub fn new(profile: Profile) -> Self {
        let mut plan = Self { compiled: Vec::new(), spaces: [(0, 0); 4], holders: Vec::new(), wide: 0, profile };
        plan.compile();
        plan.wide = (0..plan.compiled.len() as u32).filter(|&index| plan.is_wide(index)).count();
        plan
    }

    fn compile(&mut self) {
        let scoped = |point: &Point| point.sf.clone().map(|sf| (point.scope, sf));
        let mut holders: Vec<(u16, String)> = self.profile.points.iter().filter_map(scoped).collect();
        holders.sort_unstable();
        holders.dedup();
        let mut all: Vec<(Space, Compiled)> = Vec::new();
        for (i, point) in self.profile.points.iter().enumerate() {
            let factor = scoped(point).and_then(|sf| holders.binary_search(&sf).ok()).map(|slot| slot as u16);
            all.extend(values(point, i as u32, factor).map(|compiled| (point.space, compiled)));
        }
        all.sort_by_key(|(space, compiled)| (*space, compiled.address));
        for (space, range) in self.spaces.iter_mut().enumerate() {
            let at = |space: usize| all.partition_point(|(other, _)| (*other as usize) < space) as u32;
            *range = (at(space), at(space + 1));
        }
        let named = |(scope, name): &(u16, String)| {
            all.iter().position(|(_, compiled)| {
                let point = &self.profile.points[compiled.point as usize];
                point.scope == *scope && point.name == *name
            })
        };
        // Checked when the profile was read: every scale factor has its holder.
        self.holders = holders.iter().filter_map(named).map(|at| at as u32).collect();
        self.compiled = all.into_iter().map(|(_, compiled)| compiled).collect();
    }

    /// One of the values.
    #[inline]
    pub fn compiled(&self, index: u32) -> &Compiled {
        &self.compiled[index as usize]
    }

    /// Whether a value is a number of several registers, whose order matters.
    pub fn is_wide(&self, index: u32) -> bool {
        let compiled = self.compiled(index);
        compiled.width > 1 && self.point(compiled).kind.number()
    }

    /// How many of them there are.
    pub fn wide(&self) -> usize {
        self.wide
    }

    /// All values, by table and address.
    pub fn all(&self) -> &[Compiled] {
        &self.compiled
    }

    /// The point that a value belongs to.
    #[inline]
    pub fn point(&self, compiled: &Compiled) -> &Point {
        &self.profile.points[compiled.point as usize]
    }

    /// The values that begin with this register or bit.
    pub fn beginning(&self, space: Space, address: u16) -> impl Iterator<Item = u32> + '_ {
        let (start, end) = self.spaces[space as usize];
        let points = &self.compiled[start as usize..end as usize];
        let first = points.partition_point(|point| point.address < address);
        (first..)
            .take_while(move |&at| points.get(at).is_some_and(|point| point.address == address))
            .map(move |at| start + at as u32)
    }

    /// What a block of `count` registers or bits holds, by address: values that it holds whole, and the registers that
    /// are in none of them.
    #[inline]
    pub fn block(&self, space: Space, first: u16, count: usize, mut step: impl FnMut(Step)) {
        let (start, end) = self.spaces[space as usize];
        let points = &self.compiled[start as usize..end as usize];
        let mut next = points.partition_point(|point| point.address < first);
        // Registers before `covered` belong to a value that was told already.
        let mut covered = 0;
        for item in 0..count {
            let address = usize::from(first) + item;
            while let Some(point) = points.get(next).filter(|point| usize::from(point.address) == address) {
                if item + usize::from(point.width) <= count {
                    step(Step { item: item as u16, compiled: Some(start + next as u32) });
                    covered = covered.max(item + usize::from(point.width));
                }
                next += 1;
            }
            if item >= covered {
                step(Step { item: item as u16, compiled: None });
            }
        }
    }
}

fn values(point: &Point, index: u32, factor: Option<u16>) -> impl Iterator<Item = Compiled> + '_ {
    let (width, length) = (point.step(), point.length());
    (0..length).map(move |i| Compiled {
        address: point.address + i * width,
        width,
        name: if length > 1 { format!("{}[{i}]", point.name) } else { point.name.clone() },
        point: index,
        factor,
        convert: Convert::new(point),
    })
}

impl Compiled {
    /// The number of these registers at once, where it takes neither labels nor scale factors nor sentinels.
    #[inline]
    pub fn quick(&self, bytes: &[u8]) -> Option<f64> {
        if self.factor.is_some() {
            return None;
        }
        self.convert.quick(bytes)
    }
}

impl Bound {
    /// A plan before any scale factor has been seen.
    pub fn new(plan: Arc<Plan>) -> Self {
        let factors = vec![None; plan.holders.len()];
        Self { plan, factors }
    }

    /// A larger plan of the same unit, with the scale factors that this one has seen.
    #[must_use]
    pub fn extended(&self, plan: Arc<Plan>) -> Self {
        let mut larger = Self::new(plan);
        for (slot, &holder) in larger.plan.holders.iter().enumerate() {
            let address = larger.plan.compiled(holder).address;
            let known = self.plan.holders.iter().position(|&other| self.plan.compiled(other).address == address);
            larger.factors[slot] = known.and_then(|slot| self.factors[slot]);
        }
        larger
    }

    /// The value of a step that has one, from the registers that it takes.
    #[inline]
    pub fn value<'p>(&'p self, compiled: &'p Compiled, bytes: &[u8]) -> Value<'p> {
        let factor = match compiled.factor {
            None => None,
            // A factor that was never seen is not guessed.
            Some(slot) => match self.factors.get(usize::from(slot)) {
                Some(Some(power)) => Some(*power),
                _ => return Value::Missing,
            },
        };
        self.labelled(compiled, compiled.convert.value(bytes, factor), || compiled.convert.raw(bytes))
    }

    /// The value of a coil or discrete input.
    pub fn bit<'p>(&'p self, compiled: &'p Compiled, bit: i32) -> Value<'p> {
        self.labelled(compiled, Convert::bit(bit), || Some(i128::from(bit)))
    }

    #[inline]
    fn labelled<'p>(&'p self, compiled: &'p Compiled, value: Value<'static>, raw: impl Fn() -> Option<i128>) -> Value<'p> {
        let point = self.plan.point(compiled);
        if point.labels.is_empty() && point.bit_labels.is_empty() {
            return value;
        }
        let Some(number) = raw().and_then(|raw| i64::try_from(raw).ok()) else { return value };
        if let Ok(at) = point.labels.binary_search_by_key(&number, |(known, _)| *known) {
            return Value::Label(number, &point.labels[at].1);
        }
        if point.bit_labels.is_empty() {
            return value;
        }
        Value::Flags(number as u64, &point.bit_labels)
    }

    /// Whether blocks have to be looked through for scale factors.
    pub fn has_factors(&self) -> bool {
        !self.plan.holders.is_empty()
    }

    /// The scale factors of a block of registers that was read; gives the plan with them, if any is new.
    pub fn learn(&self, space: Space, first: u16, bytes: &[u8]) -> Option<Self> {
        let mut changed: Option<Self> = None;
        for (slot, &holder) in self.plan.holders.iter().enumerate() {
            let holder = self.plan.compiled(holder);
            let start = usize::from(holder.address).checked_sub(usize::from(first)).map(|item| 2 * item);
            let range = start.map(|start| start..start + 2 * usize::from(holder.width));
            let same = self.plan.point(holder).space == space;
            let Some(bytes) = range.filter(|_| same).and_then(|range| bytes.get(range)) else { continue };
            // An exponent beyond these is no scale but a mistake of the device.
            let power = holder.convert.raw(bytes).and_then(|raw| i32::try_from(raw).ok()).filter(|power| power.abs() <= 20);
            if self.factors[slot] != power {
                changed.get_or_insert_with(|| self.clone()).factors[slot] = power;
            }
        }
        changed
    }

    /// The device's own words for an exception code.
    pub fn exception(&self, code: u8) -> Option<&str> {
        let words = &self.plan.profile.device.exceptions;
        words.iter().find(|(known, _)| *known == code).map(|(_, text)| text.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Form;

    fn plan(registers: &str) -> Arc<Plan> {
        Arc::new(Plan::new(Profile::parse(&format!("profile = 1\n{registers}"), Form::Toml).unwrap()))
    }

    fn steps(plan: &Plan, first: u16, count: usize) -> Vec<(u16, Option<String>)> {
        let mut found = Vec::new();
        plan.block(Space::Holding, first, count, |step| {
            found.push((step.item, step.compiled.map(|at| plan.compiled(at).name.clone())));
        });
        found
    }

    #[test]
    fn a_value_that_is_cut_is_not_invented() {
        let plan = plan("[[registers]]\nat='hr:10'\nname='a'\ntype='u32'\n[[registers]]\nat='hr:12'\nname='b'");
        let a = |item| (item, Some("a".to_owned()));
        let b = |item| (item, Some("b".to_owned()));
        assert_eq!(steps(&plan, 10, 3), [a(0), b(2)]);
        assert_eq!(steps(&plan, 11, 2), [(0, None), b(1)]);
        assert_eq!(steps(&plan, 9, 2), [(0, None), (1, None)]);
    }

    #[test]
    fn parts_of_a_register_are_values_each() {
        let plan = plan(
            "[[registers]]\nat='hr:5.0'\nname='run'\n[[registers]]\nat='hr:5.4-6'\nname='mode'\n[[registers]]\nat='hr:6'\nname='t'\ncount=2",
        );
        let names: Vec<_> = steps(&plan, 5, 3).into_iter().map(|(item, name)| (item, name.unwrap())).collect();
        let expected = [(0, "run"), (0, "mode"), (1, "t[0]"), (2, "t[1]")];
        assert_eq!(names, expected.map(|(item, name)| (item, name.to_owned())));
        let bound = Bound::new(Arc::clone(&plan));
        let mode = plan.all().iter().find(|value| value.name == "mode").unwrap();
        assert_eq!(bound.value(mode, &[0x00, 0b0101_0001]), Value::Decimal(5, 0));
    }

    #[test]
    fn a_scale_factor_has_to_be_seen() {
        let plan =
            plan("[[registers]]\nat='hr:1'\nname='w'\nsf='w_sf'\n[[registers]]\nat='hr:2'\nname='w_sf'\ntype='s16'\nnan=0x8000");
        let bound = Bound::new(Arc::clone(&plan));
        let w = &plan.all()[0];
        assert_eq!(bound.value(w, &[0, 214]), Value::Missing);
        let bound = bound.learn(Space::Holding, 1, &[0, 214, 0xFF, 0xFF]).unwrap();
        assert_eq!(bound.value(w, &[0, 214]), Value::Decimal(214, -1));
        assert!(bound.learn(Space::Holding, 1, &[0, 7, 0xFF, 0xFF]).is_none());
        assert_eq!(bound.learn(Space::Holding, 2, &[0x80, 0]).unwrap().value(w, &[0, 214]), Value::Missing);
    }
}
