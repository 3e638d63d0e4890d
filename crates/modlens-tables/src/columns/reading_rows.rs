//! The rows of the readings table, stored compactly. What a transaction read or wrote is one block, and its rows are
//! runs of consecutive entries in the layout of the unit's plan. A single row is looked up on demand.

use std::ops::Range;
use std::sync::Arc;

use crate::columns::cell::Items;
use crate::columns::transaction_view::TransactionView;
use modlens_engine::records::{Batch, Span, Transaction};
use modlens_profiles::points::{LayoutEntry, LayoutPart, NumberBuffer, Plan, PlanInstance};
use modlens_protocol::functions::Operation;
use modlens_protocol::register_type::Space;

/// The registers or bits that one transaction read or wrote, shared by all of its rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReadingBlock {
    /// Index of the transaction in `Batch::transactions`.
    pub txn: u32,
    /// Whether they were written rather than read.
    pub is_write: bool,
    /// The address of the first register or bit.
    pub first: u16,
    data: Data,
}

/// Where the values of a block are stored.
#[derive(Clone, Copy, Debug)]
enum Data {
    /// Registers in the batch's arena.
    Words(Span),
    /// This many packed bits in the batch's arena.
    Bits(Span, usize),
    /// The value of a single register write.
    Register(i32),
    /// The value of a single coil write.
    Coil(i32),
}

/// Consecutive rows of one block whose layout entries are consecutive, too.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// The number of the first row.
    row: u32,
    /// Index in `AllRows::blocks`.
    block: u32,
    entries: EntrySource,
}

/// Where the layout entries of a run's rows are found.
#[derive(Clone, Copy, Debug)]
enum EntrySource {
    /// Registers or bits without a point, from this address on.
    Bare(u16),
    /// Consecutive entries of the transaction's plan, from this index on.
    Plan(u32),
    /// Consecutive entries of `AllRows::cut_entries`, from this index on. These belong to blocks that begin or end
    /// inside a value.
    CutEntries(u32),
}

/// All rows of a batch. Shared by the views on it that filters make.
#[derive(Debug, Default)]
struct AllRows {
    blocks: Vec<ReadingBlock>,
    runs: Vec<Run>,
    cut_entries: Vec<LayoutEntry>,
    /// The index of the run that contains each `STRIDE`th row, from which a row's run is found in a few steps.
    directory: Vec<u32>,
    rows: u32,
}

/// The number of rows between two entries of the directory.
const STRIDE: u32 = 16;

/// The rows of the table, or those that a filter has kept.
#[derive(Clone, Debug)]
pub(super) struct ReadingRows {
    all: Arc<AllRows>,
    /// The numbers of the rows that a filter has kept, in ascending order; `None` if there is no filter.
    kept: Option<Arc<Vec<u32>>>,
}

/// One row: its layout entry and the block that contains it.
#[derive(Clone, Copy)]
pub(super) struct ReadingRef<'a> {
    pub block: &'a ReadingBlock,
    pub entry: LayoutEntry,
}

impl ReadingRef<'_> {
    /// The index of its first register or bit in the block.
    pub fn index_in_block(&self) -> usize {
        usize::from(self.entry.address.wrapping_sub(self.block.first))
    }
}

impl ReadingBlock {
    /// The values of the block.
    #[inline]
    pub fn items<'a>(&self, batch: &'a Batch) -> Items<'a> {
        match self.data {
            Data::Words(span) => Items::Words(span.of(&batch.arena)),
            Data::Bits(span, count) => Items::Bits(span.of(&batch.arena), count),
            Data::Register(value) | Data::Coil(value) => Items::One(value),
        }
    }
}

impl ReadingRows {
    /// Lists the rows of a batch. Writes that were refused or not answered are listed, too; their status tells them
    /// apart.
    pub fn new(batch: &Batch) -> Self {
        let mut all = AllRows::default();
        all.blocks.reserve(batch.transaction_count());
        all.runs.reserve(2 * batch.transaction_count());
        all.directory.reserve(batch.arena.len() / 2 / STRIDE as usize);
        for (txn, t) in batch.all_transactions().iter().enumerate() {
            let exchange = TransactionView::new(batch, t);
            let space = exchange.space();
            let plan = t.points.as_deref().zip(space).map(|(instance, space)| (&*instance.plan, space));
            let sides = match exchange.operation() {
                Operation::Read => &[false][..],
                Operation::Write => &[true],
                Operation::ReadWrite => &[true, false],
                Operation::Other => &[],
            };
            for &is_write in sides {
                let block = if is_write { exchange.written(batch) } else { exchange.read(batch) };
                let Some((first, items)) = block else { continue };
                let data = match items {
                    Items::Words(bytes) => Data::Words(batch.span_of(bytes)),
                    Items::Bits(bytes, count) => Data::Bits(batch.span_of(bytes), count),
                    Items::One(value) if space.is_some_and(Space::is_bits) => Data::Coil(value),
                    Items::One(value) => Data::Register(value),
                    Items::Numbers(_) => continue, // Of rows; no transaction carries them.
                };
                all.blocks.push(ReadingBlock { txn: txn as u32, is_write, first, data });
                all.add_block_rows(plan, first, items.len());
            }
        }
        Self { all: Arc::new(all), kept: None }
    }

    /// The given rows only; `rows` are indices into this view.
    pub fn select(&self, rows: &[usize]) -> Self {
        let rows = rows.iter().map(|&row| self.number(row)).collect();
        Self { all: Arc::clone(&self.all), kept: Some(Arc::new(rows)) }
    }

    /// The rows whose number satisfies `keep`. Rows without a number (NaN) are left out, because every comparison with
    /// NaN is false.
    pub fn with_numbers(&self, batch: &Batch, keep: impl Fn(f64) -> bool) -> Self {
        let mut rows = Vec::new();
        let mut buffer = NumberBuffer::default();
        // A block of bits can be skipped at once if neither of the two possible numbers is kept.
        let no_bit = !keep(0.0) && !keep(1.0);
        for (at, run) in self.all.runs.iter().enumerate() {
            if no_bit && matches!(self.all.blocks[run.block as usize].data, Data::Bits(..)) {
                continue;
            }
            let mut from = run.row;
            self.all.run_numbers(batch, run, self.all.run_length(at), &mut buffer, |kept| {
                // Most filters keep few rows, so a whole buffer is first tested without branches.
                if kept.iter().fold(false, |any, &number| any | keep(number)) {
                    rows.extend((from..).zip(kept).filter(|(_, number)| keep(**number)).map(|(row, _)| row));
                }
                from += kept.len() as u32;
            });
        }
        if let Some(kept) = &self.kept {
            rows.retain(|row| kept.binary_search(row).is_ok());
        }
        Self { all: Arc::clone(&self.all), kept: Some(Arc::new(rows)) }
    }

    pub fn len(&self) -> usize {
        self.kept.as_ref().map_or(self.all.rows as usize, |rows| rows.len())
    }

    /// The number of a row of this view among all rows.
    fn number(&self, row: usize) -> u32 {
        self.kept.as_ref().map_or(row as u32, |rows| rows[row])
    }

    /// Looks up a row: its run by the directory, then its layout entry.
    #[inline]
    pub fn item<'a>(&'a self, batch: &'a Batch, row: usize) -> ReadingRef<'a> {
        let (all, row) = (&*self.all, self.number(row));
        let mut run_index = all.directory[(row / STRIDE) as usize] as usize;
        while all.runs.get(run_index + 1).is_some_and(|next| next.row <= row) {
            run_index += 1;
        }
        let run = &all.runs[run_index];
        let (block, index_in_run) = (&all.blocks[run.block as usize], row - run.row);
        let entry = match run.entries {
            EntrySource::Bare(address) => LayoutEntry::bare(address.wrapping_add(index_in_run as u16)),
            EntrySource::Plan(from) => match &batch.all_transactions()[block.txn as usize].points {
                Some(instance) => instance.plan.entries()[(from + index_in_run) as usize],
                None => LayoutEntry::bare(block.first),
            },
            EntrySource::CutEntries(from) => all.cut_entries[(from + index_in_run) as usize],
        };
        ReadingRef { block, entry }
    }
}

impl AllRows {
    /// Adds the rows of the last block in `blocks`, which has `count` registers or bits from address `first`. Without a
    /// plan each of them is a row.
    fn add_block_rows(&mut self, plan: Option<(&Plan, Space)>, first: u16, count: usize) {
        let Some((plan, space)) = plan else { return self.add_run(EntrySource::Bare(first), count) };
        plan.split_block(space, first, count, |piece| match piece {
            LayoutPart::Bare(Range { start, end }) => self.add_run(EntrySource::Bare(start as u16), end - start),
            LayoutPart::Entries(Range { start, end }) => self.add_run(EntrySource::Plan(start as u32), end - start),
            LayoutPart::PartialBlock(edge) => {
                let from = self.cut_entries.len();
                plan.partial_block(&edge, |entry| self.cut_entries.push(entry));
                self.add_run(EntrySource::CutEntries(from as u32), self.cut_entries.len() - from);
            }
        });
    }

    /// Adds a run of rows to the last block, and extends the directory.
    fn add_run(&mut self, entries: EntrySource, rows: usize) {
        if rows == 0 {
            return;
        }
        let run = self.runs.len() as u32;
        self.runs.push(Run { row: self.rows, block: self.blocks.len() as u32 - 1, entries });
        self.rows += rows as u32;
        self.directory.resize(self.rows.div_ceil(STRIDE) as usize, run);
    }

    /// The number of rows in a run.
    fn run_length(&self, run: usize) -> usize {
        (self.runs.get(run + 1).map_or(self.rows, |next| next.row) - self.runs[run].row) as usize
    }

    /// Passes the numbers of a run's rows to `each`, a buffer at a time.
    #[inline]
    fn run_numbers(&self, batch: &Batch, run: &Run, count: usize, buffer: &mut NumberBuffer, each: impl FnMut(&[f64])) {
        let block = &self.blocks[run.block as usize];
        let instance = batch.all_transactions()[block.txn as usize].points.as_deref();
        let entries = match run.entries {
            EntrySource::Bare(address) => {
                return bare_numbers(&block.items(batch), address.wrapping_sub(block.first), count, buffer, each)
            }
            EntrySource::Plan(from) => instance.map_or(&[][..], |instance| &instance.plan.entries()[from as usize..][..count]),
            EntrySource::CutEntries(from) => &self.cut_entries[from as usize..][..count],
        };
        let Some(instance) = instance else { return };
        match block.data {
            Data::Words(span) => instance.numbers(entries, block.first, span.of(&batch.arena), buffer, each),
            Data::Register(value) => instance.numbers(entries, block.first, &(value as u16).to_be_bytes(), buffer, each),
            Data::Bits(..) | Data::Coil(_) => {
                let items = block.items(batch);
                let bit = |entry: &LayoutEntry| f64::from(items.get(usize::from(entry.address.wrapping_sub(block.first))));
                buffer.for_each_chunk(entries, each, bit);
            }
        }
    }
}

/// Passes on the numbers of `count` registers or bits without a point, from index `place` in the block.
fn bare_numbers(items: &Items<'_>, place: u16, count: usize, buffer: &mut NumberBuffer, mut each: impl FnMut(&[f64])) {
    let places = usize::from(place)..usize::from(place) + count;
    match items {
        Items::Words(bytes) => {
            let pairs = bytes[2 * places.start..2 * places.end].as_chunks().0;
            buffer.for_each_chunk(pairs, each, |pair| f64::from(u16::from_be_bytes(*pair)));
        }
        Items::Bits(bytes, _) => {
            let bit = |place: usize| [0.0, 1.0][usize::from(bytes[place / 8] >> (place % 8) & 1)];
            places.for_each(|place| each(&[bit(place)]));
        }
        Items::One(value) => each(&[f64::from(*value)]),
        Items::Numbers(_) => {}
    }
}

/// Calls `part` for each value, bare register and bit that a transaction wrote or read: with the values of the block,
/// the index of the first register or bit, and the layout entry.
pub(super) fn each_part<'a>(
    batch: &'a Batch,
    t: &Transaction,
    is_write: bool,
    mut part: impl FnMut(&Items<'a>, u16, LayoutEntry),
) {
    let exchange = TransactionView::new(batch, t);
    let block = if is_write { exchange.written(batch) } else { exchange.read(batch) };
    let Some((first, items)) = block else { return };
    let space = exchange.space();
    let mut part_at = |entry: LayoutEntry| part(&items, entry.address.wrapping_sub(first), entry);
    match t.points.as_deref().zip(space) {
        Some((PlanInstance { plan, .. }, space)) => plan.block(space, first, items.len(), part_at),
        None => (0..items.len()).for_each(|item| part_at(LayoutEntry::bare(first.wrapping_add(item as u16)))),
    }
}
