//! The values of registers and points over time.
//!
//! A master reads registers in blocks, so the values of a block are kept together: one look-up for all of them, and minima and
//! maxima that the compiler makes into vector instructions. Where a unit has a profile, each value is a series of its own.

use std::collections::{BTreeMap, HashMap};
use std::hash::{Hash, Hasher};

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;
use serde_json::{json, Value as Json};

use super::series::{Bucket, Range, Series};
use crate::columns::{blocks, Items, ReadingView};

/// Registers, bits and points of which there are series, all buses taken together.
pub(super) const MAX_VALUES: usize = 4096;

/// Registers or bits of a block: 2,000 coils are the most that a function reads (application protocol, 6.1).
const MAX_BLOCK: usize = 2048;

/// Registers of a block: 125 are the most that a function reads (6.3); blocks of bits may be longer.
const MAX_REGISTERS: usize = 128;

/// Unit, table, first address and quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct BlockKey(u8, Space, u16, u16);

/// Hashes the key as one number, which is faster than field by field.
impl Hash for BlockKey {
    #[inline]
    fn hash<H: Hasher>(&self, state: &mut H) {
        let Self(unit, space, first, count) = *self;
        state.write_u64(u64::from(unit) << 40 | (space as u64) << 32 | u64::from(first) << 16 | u64::from(count));
    }
}

/// Unit, table, address, and index of the point in the plan (`u32::MAX` for a bare register or bit).
type PointKey = (u8, Space, u16, u32);

/// The registers of one bus.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Registers {
    blocks: HashMap<BlockKey, Block, foldhash::fast::FixedState>,
    points: BTreeMap<PointKey, Point>,
    /// Number of values in `blocks` and `points` together.
    pub values: usize,
}

/// Registers or bits that are read or written together.
#[derive(Clone, Debug, PartialEq)]
struct Block {
    counts: Counts,
    /// How often each value changed.
    changes: Vec<u64>,
    last: Vec<u16>,
    series: Series<BlockBucket>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    reads: u64,
    writes: u64,
    /// Position on the axis of the last read or write.
    newest: i64,
}

/// The values of a block; empty where it was neither read nor written.
#[derive(Clone, Debug, Default, PartialEq)]
struct BlockBucket {
    count: u64,
    /// The least of each value, then the greatest, then the newest: in one allocation, because there are many buckets.
    values: Vec<u16>,
}

/// A value with a name, or a bare one of a unit that has a profile.
#[derive(Clone, Debug, PartialEq)]
struct Point {
    name: Option<String>,
    unit_of_measure: Option<String>,
    counts: Counts,
    changes: u64,
    /// The bytes of the first value and of the last one.
    first: Vec<u8>,
    raw: Vec<u8>,
    text: Option<String>,
    number: Option<f64>,
    series: Series<PointBucket>,
}

/// One value in one bucket.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct PointBucket {
    count: u64,
    least: f64,
    most: f64,
    last: f64,
}

/// Where a transaction is on the axis of the bus, and how fine the series of its values is.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Position of the transaction.
    pub position: i64,
    /// Buckets are at least this power of two wide.
    pub shift: u32,
    /// Largest number of buckets.
    pub most: usize,
}

impl Registers {
    /// Adds what a transaction of a unit without a profile read or wrote; gives how many values there was no room for.
    pub fn transaction(&mut self, batch: &Batch, row: &Transaction, place: Place, room: usize) -> usize {
        if !matches!(row.status, Status::Ok | Status::Broadcast) {
            return 0;
        }
        let Some(found) = blocks(batch, row) else { return 0 };
        let written = found.written.map(|block| (true, block));
        let read = found.read.map(|block| (false, block));
        let mut left_out = 0;
        for (is_write, (first, items)) in written.into_iter().chain(read) {
            if items.len() > MAX_BLOCK {
                continue; // No function of the specification carries so many.
            }
            let key = BlockKey(row.unit, found.space, first, items.len() as u16);
            let block = match self.blocks.get_mut(&key) {
                Some(block) => block,
                None if self.values + items.len() > room => {
                    left_out += items.len();
                    continue;
                }
                None => {
                    self.values += items.len();
                    self.blocks.entry(key).or_insert_with(|| Block::new(items.len(), place.shift))
                }
            };
            block.add(&items, is_write, place);
        }
        left_out
    }

    /// Adds a value of a unit with a profile; gives 1 if there was no room for it.
    pub fn value(&mut self, part: &ReadingView<'_>, place: Place, room: usize) -> usize {
        if !matches!(part.transaction.status, Status::Ok | Status::Broadcast) {
            return 0;
        }
        let key = (part.transaction.unit, part.space, part.address, part.compiled.map_or(u32::MAX, |(index, _)| index));
        if !self.points.contains_key(&key) {
            if self.values + 1 > room {
                return 1;
            }
            self.values += 1;
            self.points.insert(key, Point::new(part, place.shift));
        }
        self.points.get_mut(&key).expect("just added").add(part, place);
        0
    }

    /// Adds what a later part of the recording showed.
    pub fn merge(&mut self, later: &Self, most: usize, room: usize) -> usize {
        let mut left_out = 0;
        let mut keys: Vec<&BlockKey> = later.blocks.keys().collect();
        keys.sort_unstable();
        for key in keys {
            let block = &later.blocks[key];
            match self.blocks.get_mut(key) {
                Some(own) => own.merge(block, most),
                None if self.values + block.last.len() > room => left_out += block.last.len(),
                None => {
                    self.values += block.last.len();
                    self.blocks.insert(*key, block.clone());
                }
            }
        }
        for (key, point) in &later.points {
            match self.points.get_mut(key) {
                Some(own) => own.merge(point, most),
                None if self.values + 1 > room => left_out += 1,
                None => {
                    self.values += 1;
                    self.points.insert(*key, point.clone());
                }
            }
        }
        left_out
    }

    /// The range of all its series.
    pub fn range(&self) -> Option<Range> {
        let blocks = self.blocks.values().filter_map(|block| block.series.range());
        blocks.chain(self.points.values().filter_map(|point| point.series.range())).reduce(Range::with)
    }

    /// Returns every value with its counts, sorted by unit, table and address. A value that has varied, and that more than one
    /// bucket has, gets a `course`: its least, greatest and last value by bucket.
    pub fn json(&self, range: Range) -> Json {
        let mut keys: Vec<&BlockKey> = self.blocks.keys().collect();
        keys.sort_unstable();
        // A register that several blocks contain is one.
        let mut all: BTreeMap<PointKey, Row> = BTreeMap::new();
        for key in keys {
            let BlockKey(unit, space, first, _) = *key;
            let block = &self.blocks[key];
            let buckets = block.series.cut_to(range);
            for at in 0..block.last.len() {
                let row = block.row(at, &buckets);
                let key = (unit, space, first.wrapping_add(at as u16), u32::MAX);
                match all.get_mut(&key) {
                    Some(own) => own.merge(row),
                    None => drop(all.insert(key, row)),
                }
            }
        }
        for (key, point) in &self.points {
            // Before its unit had a profile, a register was in blocks.
            match all.get_mut(key) {
                Some(own) => own.merge(point.row(range)),
                None => drop(all.insert(*key, point.row(range))),
            }
        }
        all.into_iter().map(|((unit, space, address, _), row)| row.json(unit, space, address)).collect()
    }
}

impl Block {
    fn new(values: usize, shift: u32) -> Self {
        Self { counts: Counts::default(), changes: vec![0; values], last: vec![0; values], series: Series::new(shift) }
    }

    fn add(&mut self, items: &Items<'_>, is_write: bool, place: Place) {
        let is_first = self.counts.reads + self.counts.writes == 0;
        self.counts.add(is_write, place.position);
        // Registers fit on the stack; long blocks of bits do not.
        let (mut on_stack, mut on_heap) = ([0u16; MAX_REGISTERS], Vec::new());
        let values = match self.last.len() {
            count @ ..=MAX_REGISTERS => &mut on_stack[..count],
            count => {
                on_heap.resize(count, 0);
                &mut on_heap[..]
            }
        };
        decode(items, values);
        if !is_first {
            self.count_changes(values);
        }
        self.last.copy_from_slice(values);
        let bucket = self.series.at(place.position, place.most);
        if bucket.count == 0 {
            bucket.values = [&*values, values, values].concat();
        } else {
            bucket.extend((values, values), values);
        }
        bucket.count += 1;
    }

    /// Counts which values differ from the last ones. Most do not, so they are compared eight at once.
    fn count_changes(&mut self, values: &[u16]) {
        let count = |changes: &mut [u64], new: &[u16], old: &[u16]| {
            let differ = new.iter().zip(old).map(|(new, old)| u64::from(new != old));
            changes.iter_mut().zip(differ).for_each(|(changes, differs)| *changes += differs);
        };
        let ((new, new_rest), (old, old_rest)) = (values.as_chunks::<8>(), self.last.as_chunks::<8>());
        let (changes, changes_rest) = self.changes.as_chunks_mut::<8>();
        for ((changes, new), old) in changes.iter_mut().zip(new).zip(old) {
            if new != old {
                count(changes, new, old);
            }
        }
        count(changes_rest, new_rest, old_rest);
    }

    fn merge(&mut self, later: &Self, most: usize) {
        if later.counts.reads + later.counts.writes == 0 {
            return;
        }
        let first = later.first_values();
        let changed = self.last.iter().zip(&first).map(|(old, new)| u64::from(old != new));
        self.changes.iter_mut().zip(&later.changes).zip(changed).for_each(|((own, more), seam)| *own += more + seam);
        self.last.clone_from(&later.last);
        self.counts.merge(later.counts);
        self.series.merge(&later.series, most);
    }

    /// The values of its first bucket: those it begins with, as long as the bucket holds one value of each.
    fn first_values(&self) -> Vec<u16> {
        let range = self.series.range().expect("it was read");
        self.series.cut_to(range).into_iter().find(|one| one.count > 0).map_or_else(Vec::new, |one| one.columns()[2].to_vec())
    }

    fn row(&self, at: usize, buckets: &[BlockBucket]) -> Row {
        let one = |bucket: &BlockBucket| match bucket.count {
            0 => PointBucket::default(),
            count => {
                let [least, greatest, newest] = bucket.columns().map(|column| f64::from(column[at]));
                PointBucket { count, least, most: greatest, last: newest }
            }
        };
        Row {
            name: None,
            unit_of_measure: None,
            counts: self.counts,
            changes: self.changes[at],
            text: None,
            number: Some(f64::from(self.last[at])),
            buckets: buckets.iter().map(one).collect(),
        }
    }
}

/// The items as numbers.
fn decode(items: &Items<'_>, values: &mut [u16]) {
    match items {
        Items::Words(bytes) => {
            let pairs = bytes.as_chunks().0;
            values.iter_mut().zip(pairs).for_each(|(value, pair)| *value = u16::from_be_bytes(*pair));
        }
        other => values.iter_mut().enumerate().for_each(|(at, value)| *value = other.get(at) as u16),
    }
}

impl BlockBucket {
    /// The least values, the greatest, and the newest.
    fn columns(&self) -> [&[u16]; 3] {
        let (least, rest) = self.values.split_at(self.values.len() / 3);
        let (greatest, newest) = rest.split_at(least.len());
        [least, greatest, newest]
    }

    /// Takes in values between these least and greatest ones, the newest of which are given.
    fn extend(&mut self, (least, most): (&[u16], &[u16]), newest: &[u16]) {
        let (own_least, rest) = self.values.split_at_mut(newest.len());
        let (own_greatest, own_newest) = rest.split_at_mut(newest.len());
        own_least.iter_mut().zip(least).for_each(|(own, new)| *own = (*own).min(*new));
        own_greatest.iter_mut().zip(most).for_each(|(own, new)| *own = (*own).max(*new));
        own_newest.copy_from_slice(newest);
    }
}

impl Bucket for BlockBucket {
    fn merge(&mut self, later: &Self) {
        if later.count == 0 {
            return;
        }
        if self.count == 0 {
            self.clone_from(later);
            return;
        }
        self.count += later.count;
        let [least, greatest, newest] = later.columns();
        self.extend((least, greatest), newest);
    }
}

impl Counts {
    fn add(&mut self, is_write: bool, position: i64) {
        *(if is_write { &mut self.writes } else { &mut self.reads }) += 1;
        self.newest = position;
    }

    fn merge(&mut self, later: Self) {
        self.reads += later.reads;
        self.writes += later.writes;
        self.newest = later.newest;
    }
}

impl Point {
    fn new(part: &ReadingView<'_>, shift: u32) -> Self {
        let point = part.compiled.map(|(_, compiled)| compiled);
        let instance = part.transaction.points.as_ref();
        Self {
            name: point.map(|compiled| compiled.name.clone()),
            unit_of_measure: point.zip(instance).and_then(|(compiled, instance)| instance.plan.point(compiled).unit.clone()),
            counts: Counts::default(),
            changes: 0,
            first: part.raw.clone(),
            raw: Vec::new(),
            text: None,
            number: None,
            series: Series::new(shift),
        }
    }

    fn add(&mut self, part: &ReadingView<'_>, place: Place) {
        let is_first = self.counts.reads + self.counts.writes == 0;
        self.counts.add(part.is_write, place.position);
        // A value is converted only where its bytes are others.
        if is_first || self.raw != part.raw {
            self.changes += u64::from(!is_first);
            self.raw.clone_from(&part.raw);
            let value = part.value();
            (self.text, self.number) = (value.text(), value.number().filter(|number| number.is_finite()));
        }
        if let Some(number) = self.number {
            let bucket = self.series.at(place.position, place.most);
            bucket.merge(&PointBucket { count: 1, least: number, most: number, last: number });
        }
    }

    fn merge(&mut self, later: &Self, most: usize) {
        self.changes += later.changes + u64::from(self.raw != later.first);
        (self.raw, self.text, self.number) = (later.raw.clone(), later.text.clone(), later.number);
        self.counts.merge(later.counts);
        self.series.merge(&later.series, most);
    }

    fn row(&self, range: Range) -> Row {
        Row {
            name: self.name.clone(),
            unit_of_measure: self.unit_of_measure.clone(),
            counts: self.counts,
            changes: self.changes,
            text: self.text.clone(),
            number: self.number,
            buckets: self.series.cut_to(range),
        }
    }
}

impl Bucket for PointBucket {
    fn merge(&mut self, later: &Self) {
        if later.count == 0 {
            return;
        }
        if self.count == 0 {
            *self = *later;
            return;
        }
        self.count += later.count;
        (self.least, self.most, self.last) = (self.least.min(later.least), self.most.max(later.most), later.last);
    }
}

/// A value as it is shown.
struct Row {
    name: Option<String>,
    unit_of_measure: Option<String>,
    counts: Counts,
    changes: u64,
    text: Option<String>,
    number: Option<f64>,
    buckets: Vec<PointBucket>,
}

impl Row {
    /// Adds the same register of another block, or of the time since its unit has a profile.
    fn merge(&mut self, other: Self) {
        let newest = self.counts.newest.max(other.counts.newest);
        if other.counts.newest >= self.counts.newest {
            (self.number, self.text) = (other.number, other.text);
        }
        self.counts.merge(other.counts);
        self.counts.newest = newest;
        self.changes += other.changes;
        self.buckets.iter_mut().zip(&other.buckets).for_each(|(own, more)| own.merge(more));
    }

    fn json(&self, unit: u8, space: Space, address: u16) -> Json {
        let seen: Vec<&PointBucket> = self.buckets.iter().filter(|bucket| bucket.count > 0).collect();
        let least = seen.iter().map(|bucket| bucket.least).reduce(f64::min);
        let most = seen.iter().map(|bucket| bucket.most).reduce(f64::max);
        let column = |read: fn(&PointBucket) -> f64| -> Json {
            self.buckets.iter().map(|bucket| if bucket.count == 0 { Json::Null } else { number(read(bucket)) }).collect()
        };
        let is_course = least != most && seen.len() > 1;
        let course = is_course
            .then(|| json!({"min": column(|one| one.least), "max": column(|one| one.most), "last": column(|one| one.last)}));
        let mut row = json!({
            "unit": unit, "register_type": space.long_name(), "address": address, "name": self.name,
            "unit_of_measure": self.unit_of_measure, "reads": self.counts.reads, "writes": self.counts.writes,
            "changes": self.changes, "value": self.number.map(number), "value_text": self.text,
            "min": least.map(number), "max": most.map(number), "course": null,
        });
        // Large: the macro would copy it.
        row["course"] = course.into();
        row
    }
}

/// A number; a whole one where it is.
fn number(value: f64) -> Json {
    if value.fract() == 0.0 && value.abs() < 9e15 {
        (value as i64).into()
    } else {
        value.into()
    }
}
