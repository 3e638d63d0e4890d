//! A profile compiled to a plan: which points a block of registers holds, and how each is converted.
//!
//! This is the only place where registers become values. A value counts only if one transaction carries all of its
//! registers: what is cut by the end of a read, or split over two, is not put together.

mod convert;
mod layout;
mod shortcut;
pub mod sunspec;
mod value;
pub mod watch;

use std::sync::Arc;

use crate::profile::{Point, Profile};
use modlens_protocol::register_type::Space;

use layout::Layout;
use shortcut::{Shortcut, NOTHING};

pub use convert::Convert;
pub use layout::{Edge, Piece, Step};
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
    /// In `Plan::shortcuts`.
    shortcut: u16,
}

/// A compiled profile.
#[derive(Debug, Default)]
pub struct Plan {
    /// The profile.
    pub profile: Profile,
    compiled: Vec<Compiled>,
    /// For each table, its part of `compiled`, which is sorted by address.
    spaces: [(u32, u32); 4],
    /// How numbers are come to quickly; the first is that of a bare register.
    shortcuts: Vec<Shortcut>,
    /// Where the steps of each table are.
    layouts: [Layout; 4],
    steps: Vec<Step>,
    /// What holds the scale factors, in `compiled`.
    holders: Vec<u32>,
    wide: Vec<Wide>,
}

/// A number of several registers, whose order matters.
#[derive(Clone, Copy, Debug)]
pub struct Wide {
    /// Which table.
    pub space: Space,
    /// Its first register.
    pub address: u16,
    /// How many it takes.
    pub width: u16,
    /// In the plan.
    pub compiled: u32,
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
        let mut plan = Self { profile, shortcuts: vec![Shortcut::BARE], ..Self::default() };
        plan.compile();
        plan.wide = (0..plan.compiled.len() as u32).filter_map(|index| plan.wide_number(index)).collect();
        for (space, layout) in Space::ALL.iter().zip(&mut plan.layouts) {
            let (start, end) = plan.spaces[space.0 as usize];
            let values = (start..end).map(|index| {
                let value = &plan.compiled[index as usize];
                (value.address, value.width, Step::value(value.address, value.shortcut, index))
            });
            *layout = Layout::new(&values.collect::<Vec<_>>(), &mut plan.steps);
        }
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
            let convert = Convert::new(point);
            let shortcut = shared(&mut self.shortcuts, Shortcut::new(point, &convert, factor));
            let (address, width) = (point.address, point.step());
            let base = Compiled { address, width, name: String::new(), point: i as u32, factor, convert, shortcut };
            all.extend(values(point, &base).map(|compiled| (point.space, compiled)));
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

    fn wide_number(&self, compiled: u32) -> Option<Wide> {
        let value = self.compiled(compiled);
        let point = self.point(value);
        let wide = Wide { space: point.space, address: value.address, width: value.width, compiled };
        (value.width > 1 && point.kind.number()).then_some(wide)
    }

    /// The numbers of several registers, by table and address.
    pub fn wide(&self) -> &[Wide] {
        &self.wide
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

    /// The steps of all layouts.
    #[inline]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// A block in parts: slices of `steps`, and edges.
    #[inline]
    pub fn pieces(&self, space: Space, first: u16, count: usize, piece: impl FnMut(Piece)) {
        self.layouts[space as usize].pieces(first, count, piece);
    }

    /// What an edge holds, by address: values that it holds whole, and the registers that are in none of them.
    pub fn edge(&self, edge: &Edge, mut step: impl FnMut(Step)) {
        // Registers before `covered` were told already.
        let mut covered = edge.place.start;
        for one in &self.steps[edge.steps.clone()] {
            let first = usize::from(one.address);
            (covered..first).for_each(|address| step(Step::bare(address as u16)));
            covered = covered.max(first);
            let behind = first + usize::from(self.shortcuts[usize::from(one.shortcut)].width);
            if behind <= edge.place.end {
                step(*one);
                covered = covered.max(behind);
            }
        }
        (covered..edge.place.end).for_each(|address| step(Step::bare(address as u16)));
    }

    /// What a block of `count` registers or bits holds, by address: values that it holds whole, and the registers that
    /// are in none of them.
    pub fn block(&self, space: Space, first: u16, count: usize, mut step: impl FnMut(Step)) {
        self.pieces(space, first, count, |piece| match piece {
            Piece::Bare(place) => place.for_each(|address| step(Step::bare(address as u16))),
            Piece::Steps(steps) => self.steps[steps].iter().for_each(|one| step(*one)),
            Piece::Edge(edge) => self.edge(&edge, &mut step),
        });
    }
}

/// So many shortcuts are told apart; then only widths are.
const SHORTCUTS: usize = 1024;

/// The number of a shortcut; points of a plan have few different ones.
fn shared(shortcuts: &mut Vec<Shortcut>, wanted: Shortcut) -> u16 {
    let wanted = if shortcuts.len() < SHORTCUTS { wanted } else { Shortcut::long(wanted.width) };
    let known = shortcuts.iter().position(|known| *known == wanted);
    known.unwrap_or_else(|| {
        shortcuts.push(wanted);
        shortcuts.len() - 1
    }) as u16
}

fn values<'a>(point: &'a Point, base: &'a Compiled) -> impl Iterator<Item = Compiled> + 'a {
    let (width, length) = (point.step(), point.length());
    (0..length).map(move |i| Compiled {
        address: point.address + i * width,
        name: if length > 1 { format!("{}[{i}]", point.name) } else { point.name.clone() },
        ..base.clone()
    })
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

    /// The numbers of some steps in a block of registers, `NOTHING` where there is none: tight, unlike `value`.
    pub fn numbers(&self, steps: &[Step], first: u16, bytes: &[u8], part: &mut Part, each: impl FnMut(&[f64])) {
        let (shortcuts, factors) = (&self.plan.shortcuts[..], &self.factors[..]);
        part.of(steps, each, |step| {
            let at = 2 * usize::from(step.address.wrapping_sub(first));
            let number = shortcuts[usize::from(step.shortcut)].number(bytes, at, factors);
            number.unwrap_or_else(|()| self.long_number(*step, bytes, at))
        });
    }

    #[cold]
    fn long_number(&self, step: Step, bytes: &[u8], at: usize) -> f64 {
        let compiled = step.compiled().map(|index| self.plan.compiled(index));
        let registers = compiled.and_then(|value| Some((value, bytes.get(at..at + 2 * usize::from(value.width))?)));
        registers.and_then(|(value, bytes)| self.value(value, bytes).number()).unwrap_or(NOTHING)
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

/// So many numbers are given at a time: a place for all of them would have to be filled twice.
const PART: usize = 64;

/// Room for some numbers.
pub struct Part([f64; PART]);

impl Default for Part {
    fn default() -> Self {
        Self([NOTHING; PART])
    }
}

impl Part {
    /// Gives the numbers of some items, a part of them at a time.
    #[inline]
    pub fn of<T>(&mut self, items: &[T], mut each: impl FnMut(&[f64]), number: impl Fn(&T) -> f64) {
        for items in items.chunks(PART) {
            self.0.iter_mut().zip(items).for_each(|(place, item)| *place = number(item));
            each(&self.0[..items.len()]);
        }
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
            found.push((step.address - first, step.compiled().map(|at| plan.compiled(at).name.clone())));
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
