//! A device profile compiled to a plan: which points (named values) a block of registers contains, and how each is
//! converted.
//!
//! This is the only place where registers become values. A value counts only if one transaction carries all of its
//! registers: a value that is cut at the end of a read, or split over two reads, is not put together, because the
//! device may have changed it in between.
//!
//! Scale factors that are points themselves are read here (`with_factors_from`) and applied in `conversion` and
//! `fast_decoder`; `sunspec` finds the models of a device.

mod block_plan;
mod conversion;
mod fast_decoder;
mod layout;
mod number_groups;
pub mod sunspec;
mod unit_plans;
mod value;

use std::sync::Arc;

use crate::profile::{Point, Profile};
use modlens_protocol::register_type::Space;

use fast_decoder::{FastDecoder, NO_NUMBER};
use layout::Layout;

pub use block_plan::{BlockEntries, BlockPlan, BlockPlans};
pub use conversion::Conversion;
pub use layout::{LayoutEntry, LayoutPart, PartialBlock};
pub use number_groups::RegisterBuffer;
pub use unit_plans::UnitPlans;
pub use value::{push_float, Value};

/// One value of a point, ready for decoding. A point with several values (an array) is compiled to one of these per
/// value.
#[derive(Clone, Debug)]
pub struct CompiledPoint {
    /// Address of its first register or bit.
    pub address: u16,
    /// The number of registers or bits that it takes.
    pub width: u16,
    /// Its name; values of an array have their index appended: `t[0]`, `t[1]`.
    pub name: String,
    /// Index of the point in the profile.
    pub point: u32,
    /// Index of the scale factor that it needs, in `PlanInstance::factors`.
    pub factor: Option<u16>,
    conversion: Conversion,
    /// Index in `Plan::decoders`.
    decoder: u16,
}

impl CompiledPoint {
    /// The value of these registers, without a scale factor that is a point of its own.
    pub fn value(&self, bytes: &[u8]) -> Value<'static> {
        self.conversion.value(bytes, None)
    }

    /// The integer on the wire, before scaling. `None` if the bits are no number or mean "no value".
    pub fn raw(&self, bytes: &[u8]) -> Option<i128> {
        self.conversion.raw(bytes)
    }
}

/// A compiled profile.
#[derive(Debug, Default)]
pub struct Plan {
    /// The profile that was compiled.
    pub profile: Profile,
    compiled: Vec<CompiledPoint>,
    /// For each table (coils, discrete inputs, input registers, holding registers), its index range in `compiled`,
    /// where the values of a table are sorted by address.
    table_ranges: [(u32, u32); 4],
    /// Fast decoders for numbers, shared by all points that are encoded alike. The first one decodes a register without
    /// a point.
    decoders: Vec<FastDecoder>,
    /// For each table, where its addresses are found in `entries`.
    layouts: [Layout; 4],
    entries: Vec<LayoutEntry>,
    /// The values that contain scale factors, as indices into `compiled`.
    scale_factor_points: Vec<u32>,
    multi_register_points: Vec<MultiRegisterPoint>,
}

/// A number of several registers. Its register and byte order matters, so it is checked against the traffic (see
/// `order_check`).
#[derive(Clone, Copy, Debug)]
pub struct MultiRegisterPoint {
    /// The table that it belongs to.
    pub space: Space,
    /// Address of its first register.
    pub address: u16,
    /// The number of registers that it takes.
    pub width: u16,
    /// Index of the value in the plan.
    pub compiled_index: u32,
}

/// A plan as it applies to one unit at one moment: with the scale factors that were last read from the unit.
#[derive(Clone, Debug)]
pub struct PlanInstance {
    /// The plan.
    pub plan: Arc<Plan>,
    /// The power of ten of each scale factor, in the order of `Plan::scale_factor_points`; `None` until it was read.
    factors: Vec<Option<i32>>,
}

impl Plan {
    /// Compiles a profile.
    pub fn new(profile: Profile) -> Self {
        let mut plan = Self { profile, decoders: vec![FastDecoder::BARE], ..Self::default() };
        plan.compile();
        plan.multi_register_points =
            (0..plan.compiled.len() as u32).filter_map(|index| plan.multi_register_point(index)).collect();
        for (space, layout) in Space::ALL.iter().zip(&mut plan.layouts) {
            let (start, end) = plan.table_ranges[space.0 as usize];
            let values = (start..end).map(|index| {
                let value = &plan.compiled[index as usize];
                (value.address, value.width, LayoutEntry::value(value.address, value.decoder, index))
            });
            *layout = Layout::new(&values.collect::<Vec<_>>(), &mut plan.entries);
        }
        plan
    }

    /// Compiles the values of all points, sorts them by table and address, and finds the values that contain the scale
    /// factors.
    fn compile(&mut self) {
        let scale_factor_of = |point: &Point| point.sf.clone().map(|sf| (point.scope, sf));
        let mut scale_factor_points: Vec<(u16, String)> = self.profile.points.iter().filter_map(scale_factor_of).collect();
        scale_factor_points.sort_unstable();
        scale_factor_points.dedup();
        let mut all: Vec<(Space, CompiledPoint)> = Vec::new();
        for (i, point) in self.profile.points.iter().enumerate() {
            let factor =
                scale_factor_of(point).and_then(|sf| scale_factor_points.binary_search(&sf).ok()).map(|slot| slot as u16);
            let conversion = Conversion::new(point);
            let decoder = shared_decoder(&mut self.decoders, FastDecoder::new(point, &conversion, factor));
            let (address, width) = (point.address, point.registers_per_value());
            let base = CompiledPoint { address, width, name: String::new(), point: i as u32, factor, conversion, decoder };
            all.extend(point_values(point, &base).map(|compiled| (point.space, compiled)));
        }
        all.sort_by_key(|(space, compiled)| (*space, compiled.address));
        for (space, range) in self.table_ranges.iter_mut().enumerate() {
            let at = |space: usize| all.partition_point(|(other, _)| (*other as usize) < space) as u32;
            *range = (at(space), at(space + 1));
        }
        let named = |(scope, name): &(u16, String)| {
            all.iter().position(|(_, compiled)| {
                let point = &self.profile.points[compiled.point as usize];
                point.scope == *scope && point.name == *name
            })
        };
        // Always found: reading a profile fails if a scale factor refers to no point.
        self.scale_factor_points = scale_factor_points.iter().filter_map(named).map(|at| at as u32).collect();
        self.compiled = all.into_iter().map(|(_, compiled)| compiled).collect();
    }

    /// The value with this index.
    #[inline]
    pub fn compiled_point(&self, index: u32) -> &CompiledPoint {
        &self.compiled[index as usize]
    }

    /// The value as a `MultiRegisterPoint`, if it is a number of several registers.
    fn multi_register_point(&self, compiled_index: u32) -> Option<MultiRegisterPoint> {
        let value = self.compiled_point(compiled_index);
        let point = self.point(value);
        let candidate = MultiRegisterPoint { space: point.space, address: value.address, width: value.width, compiled_index };
        (value.width > 1 && point.kind.is_number()).then_some(candidate)
    }

    /// The numbers of several registers, sorted by table and address.
    pub fn multi_register_points(&self) -> &[MultiRegisterPoint] {
        &self.multi_register_points
    }

    /// All values, sorted by table and address.
    pub fn compiled_points(&self) -> &[CompiledPoint] {
        &self.compiled
    }

    /// The point that a value belongs to.
    #[inline]
    pub fn point(&self, compiled: &CompiledPoint) -> &Point {
        &self.profile.points[compiled.point as usize]
    }

    /// The entries of all layouts, to which the ranges of `LayoutPart::Entries` and `PartialBlock::entries` refer.
    #[inline]
    pub fn entries(&self) -> &[LayoutEntry] {
        &self.entries
    }

    /// Whether a value may lie in a block of `count` registers or bits from address `first` on. Where the answer is no, each of
    /// them is an entry of its own.
    #[inline]
    pub fn has_point_near(&self, space: Space, first: u16, count: usize) -> bool {
        self.layouts[space as usize].has_region_in(first, count)
    }

    /// Splits a block of `count` registers or bits from address `first` into parts: slices of `entries`, bare
    /// registers, and partial blocks at its ends.
    #[inline]
    pub fn split_block(&self, space: Space, first: u16, count: usize, part: impl FnMut(LayoutPart)) {
        self.layouts[space as usize].split_block(first, count, part);
    }

    /// Lists the entries of a partial block by address: the values that lie completely inside it, and every register
    /// that belongs to none of those.
    pub fn partial_block(&self, partial_block: &PartialBlock, mut visit: impl FnMut(LayoutEntry)) {
        // Registers before `covered` belong to entries that were passed on already.
        let mut covered = partial_block.addresses.start;
        for entry in &self.entries[partial_block.entries.clone()] {
            let first = usize::from(entry.address);
            (covered..first).for_each(|address| visit(LayoutEntry::bare(address as u16)));
            covered = covered.max(first);
            let end = first + usize::from(self.decoders[usize::from(entry.decoder)].width);
            if end <= partial_block.addresses.end {
                visit(*entry);
                covered = covered.max(end);
            }
        }
        (covered..partial_block.addresses.end).for_each(|address| visit(LayoutEntry::bare(address as u16)));
    }

    /// Lists the entries of a block of `count` registers or bits, by address: the values that lie completely inside it,
    /// and every register or bit that belongs to none of those.
    pub fn block(&self, space: Space, first: u16, count: usize, mut visit: impl FnMut(LayoutEntry)) {
        let mut entries = Vec::with_capacity(count);
        self.extend_by_block((space, first, count), &mut entries);
        entries.into_iter().for_each(&mut visit);
    }

    /// Appends the same entries.
    pub fn extend_by_block(&self, (space, first, count): (Space, u16, usize), to: &mut Vec<LayoutEntry>) {
        self.split_block(space, first, count, |part| match part {
            LayoutPart::Bare(addresses) => to.extend(addresses.map(|address| LayoutEntry::bare(address as u16))),
            LayoutPart::Entries(entries) => to.extend_from_slice(&self.entries[entries]),
            LayoutPart::PartialBlock(partial_block) => self.partial_block(&partial_block, |entry| to.push(entry)),
        });
    }
}

/// The number of different fast decoders that a plan keeps. Further points only share a slow decoder per width, so that
/// the linear search in `shared_decoder` stays short.
const MAX_DECODERS: usize = 1024;

/// The index of a fast decoder, which is added if no point has needed it before. The points of a plan need few
/// different ones.
fn shared_decoder(decoders: &mut Vec<FastDecoder>, wanted: FastDecoder) -> u16 {
    let wanted = if decoders.len() < MAX_DECODERS { wanted } else { FastDecoder::general(wanted.width) };
    let known = decoders.iter().position(|known| *known == wanted);
    known.unwrap_or_else(|| {
        decoders.push(wanted);
        decoders.len() - 1
    }) as u16
}

/// The values of a point: one, or the items of an array at consecutive addresses.
fn point_values<'a>(point: &'a Point, base: &'a CompiledPoint) -> impl Iterator<Item = CompiledPoint> + 'a {
    let (width, length) = (point.registers_per_value(), point.value_count());
    (0..length).map(move |i| CompiledPoint {
        address: point.address + i * width,
        name: if length > 1 { format!("{}[{i}]", point.name) } else { point.name.clone() },
        ..base.clone()
    })
}

impl PlanInstance {
    /// A plan with no scale factor known yet.
    pub fn new(plan: Arc<Plan>) -> Self {
        let factors = vec![None; plan.scale_factor_points.len()];
        Self { plan, factors }
    }

    /// A larger plan of the same unit (after a further `SunSpec` model was found), keeping the scale factors that were
    /// read so far.
    #[must_use]
    pub fn extended(&self, plan: Arc<Plan>) -> Self {
        let mut larger = Self::new(plan);
        for (slot, &factor_point) in larger.plan.scale_factor_points.iter().enumerate() {
            let address = larger.plan.compiled_point(factor_point).address;
            let known =
                self.plan.scale_factor_points.iter().position(|&other| self.plan.compiled_point(other).address == address);
            larger.factors[slot] = known.and_then(|slot| self.factors[slot]);
        }
        larger
    }

    /// The value of a point, from the bytes of its registers. `Value::Missing` if its scale factor has not been read
    /// yet.
    #[inline]
    pub fn value<'p>(&'p self, compiled: &'p CompiledPoint, bytes: &[u8]) -> Value<'p> {
        let factor = match compiled.factor {
            None => None,
            // An unknown factor is not guessed.
            Some(slot) => match self.factors.get(usize::from(slot)) {
                Some(Some(power)) => Some(*power),
                _ => return Value::Missing,
            },
        };
        self.with_label(compiled, compiled.conversion.value(bytes, factor), || compiled.conversion.raw(bytes))
    }

    /// Passes on the numbers of consecutive entries in a block of registers, `NO_NUMBER` for an entry without one. A
    /// tight loop over fast decoders, which gives the same numbers as `value` does one at a time.
    pub fn numbers(
        &self,
        entries: &[LayoutEntry],
        first: u16,
        bytes: &[u8],
        buffer: &mut NumberBuffer,
        each: impl FnMut(&[f64]),
    ) {
        buffer.for_each_chunk(entries, each, |entry| self.entry_number(*entry, first, bytes));
    }

    /// The number of an entry in a block of registers from address `first` on, `NO_NUMBER` if it has none.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The body of the loops over entries.
    pub fn entry_number(&self, entry: LayoutEntry, first: u16, bytes: &[u8]) -> f64 {
        let at = 2 * usize::from(entry.address.wrapping_sub(first));
        let number = self.plan.decoders[usize::from(entry.decoder)].number(bytes, at, &self.factors);
        number.unwrap_or_else(|()| self.long_number(entry, bytes, at))
    }

    /// The number of an entry by the general path through a `Value`, for points that the fast decoders do not cover.
    #[cold]
    fn long_number(&self, entry: LayoutEntry, bytes: &[u8], at: usize) -> f64 {
        let compiled = entry.compiled_index().map(|index| self.plan.compiled_point(index));
        let registers = compiled.and_then(|value| Some((value, bytes.get(at..at + 2 * usize::from(value.width))?)));
        registers.and_then(|(value, bytes)| self.value(value, bytes).number()).unwrap_or(NO_NUMBER)
    }

    /// The value of a coil or discrete input.
    pub fn bit<'p>(&'p self, compiled: &'p CompiledPoint, bit: i32) -> Value<'p> {
        self.with_label(compiled, Conversion::bit(bit), || Some(i128::from(bit)))
    }

    /// Replaces a number by its label or by the labels of its set bits, if the profile has any for the raw number.
    #[inline]
    fn with_label<'p>(&'p self, compiled: &'p CompiledPoint, value: Value<'static>, raw: impl Fn() -> Option<i128>) -> Value<'p> {
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

    /// Whether the plan has scale factors, so that blocks must be searched for them.
    pub fn has_factors(&self) -> bool {
        !self.plan.scale_factor_points.is_empty()
    }

    /// Whether a scale factor begins in this block of registers.
    pub fn has_factor_in(&self, space: Space, first: u16, bytes: usize) -> bool {
        self.plan.scale_factor_points.iter().map(|&at| self.plan.compiled_point(at)).any(|factor| {
            let end = usize::from(first) + bytes / 2;
            self.plan.point(factor).space == space && (usize::from(first)..end).contains(&usize::from(factor.address))
        })
    }

    /// Takes the scale factors from a block of registers that was read. Returns the plan with them if any has changed,
    /// or `None`.
    pub fn with_factors_from(&self, space: Space, first: u16, bytes: &[u8]) -> Option<Self> {
        let mut changed: Option<Self> = None;
        for (slot, &factor_point) in self.plan.scale_factor_points.iter().enumerate() {
            let factor_point = self.plan.compiled_point(factor_point);
            let start = usize::from(factor_point.address).checked_sub(usize::from(first)).map(|item| 2 * item);
            let range = start.map(|start| start..start + 2 * usize::from(factor_point.width));
            let same = self.plan.point(factor_point).space == space;
            let Some(bytes) = range.filter(|_| same).and_then(|range| bytes.get(range)) else { continue };
            // A larger exponent is no scale factor but a fault of the device.
            let power =
                factor_point.conversion.raw(bytes).and_then(|raw| i32::try_from(raw).ok()).filter(|power| power.abs() <= 20);
            if self.factors[slot] != power {
                changed.get_or_insert_with(|| self.clone()).factors[slot] = power;
            }
        }
        changed
    }

    /// The name that the device's profile has for an exception code.
    pub fn exception(&self, code: u8) -> Option<&str> {
        let words = &self.plan.profile.device.exceptions;
        words.iter().find(|(known, _)| *known == code).map(|(_, text)| text.as_str())
    }
}

/// Numbers that are passed on at a time. Room for all numbers of a block would have to be initialised before it is
/// filled.
const PART_NUMBERS: usize = 64;

/// A buffer for the numbers that are passed on at a time.
pub struct NumberBuffer([f64; PART_NUMBERS]);

impl Default for NumberBuffer {
    fn default() -> Self {
        Self([NO_NUMBER; PART_NUMBERS])
    }
}

impl NumberBuffer {
    /// Computes the number of each item and passes the numbers on, one buffer at a time.
    #[inline]
    pub fn for_each_chunk<T>(&mut self, items: &[T], mut each: impl FnMut(&[f64]), number: impl Fn(&T) -> f64) {
        for items in items.chunks(PART_NUMBERS) {
            self.0.iter_mut().zip(items).for_each(|(slot, item)| *slot = number(item));
            each(&self.0[..items.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::ProfileFormat;

    fn plan(registers: &str) -> Arc<Plan> {
        Arc::new(Plan::new(Profile::parse(&format!("profile = 1\n{registers}"), ProfileFormat::Toml).unwrap()))
    }

    fn entries(plan: &Plan, first: u16, count: usize) -> Vec<(u16, Option<String>)> {
        let mut found = Vec::new();
        plan.block(Space::Holding, first, count, |entry| {
            found.push((entry.address - first, entry.compiled_index().map(|at| plan.compiled_point(at).name.clone())));
        });
        found
    }

    #[test]
    fn a_value_cut_by_the_end_of_a_block_is_not_decoded() {
        let plan = plan("[[registers]]\nat='hr:10'\nname='a'\ntype='u32'\n[[registers]]\nat='hr:12'\nname='b'");
        let a = |item| (item, Some("a".to_owned()));
        let b = |item| (item, Some("b".to_owned()));
        assert_eq!(entries(&plan, 10, 3), [a(0), b(2)]);
        assert_eq!(entries(&plan, 11, 2), [(0, None), b(1)]);
        assert_eq!(entries(&plan, 9, 2), [(0, None), (1, None)]);
    }

    #[test]
    fn bits_of_a_register_are_separate_values() {
        let plan = plan(
            "[[registers]]\nat='hr:5.0'\nname='run'\n[[registers]]\nat='hr:5.4-6'\nname='mode'\n[[registers]]\nat='hr:6'\nname='t'\ncount=2",
        );
        let names: Vec<_> = entries(&plan, 5, 3).into_iter().map(|(item, name)| (item, name.unwrap())).collect();
        let expected = [(0, "run"), (0, "mode"), (1, "t[0]"), (2, "t[1]")];
        assert_eq!(names, expected.map(|(item, name)| (item, name.to_owned())));
        let instance = PlanInstance::new(Arc::clone(&plan));
        let mode = plan.compiled_points().iter().find(|value| value.name == "mode").unwrap();
        assert_eq!(instance.value(mode, &[0x00, 0b0101_0001]), Value::Decimal(5, 0));
    }

    #[test]
    fn a_scaled_value_is_missing_until_its_factor_was_read() {
        let plan =
            plan("[[registers]]\nat='hr:1'\nname='w'\nsf='w_sf'\n[[registers]]\nat='hr:2'\nname='w_sf'\ntype='s16'\nnan=0x8000");
        let instance = PlanInstance::new(Arc::clone(&plan));
        let w = &plan.compiled_points()[0];
        assert_eq!(instance.value(w, &[0, 214]), Value::Missing);
        let instance = instance.with_factors_from(Space::Holding, 1, &[0, 214, 0xFF, 0xFF]).unwrap();
        assert_eq!(instance.value(w, &[0, 214]), Value::Decimal(214, -1));
        assert!(instance.with_factors_from(Space::Holding, 1, &[0, 7, 0xFF, 0xFF]).is_none());
        assert_eq!(instance.with_factors_from(Space::Holding, 2, &[0x80, 0]).unwrap().value(w, &[0, 214]), Value::Missing);
    }
}
