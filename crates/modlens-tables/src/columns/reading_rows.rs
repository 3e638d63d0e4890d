//! The rows of the readings table, or those that a filter has kept. A single row is looked up on demand.

use std::sync::Arc;

use crate::columns::cell::Items;
use crate::columns::reading_blocks::{Data, ReadingBlock, ReadingBlocks};
use crate::columns::transaction_view::TransactionView;
use modlens_engine::records::Batch;
use modlens_profiles::points::{LayoutEntry, NumberBuffer, RegisterBuffer};

/// The rows of the table, or those that a filter has kept.
#[derive(Clone, Debug)]
pub(super) struct ReadingRows {
    all: Arc<ReadingBlocks>,
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

impl ReadingRows {
    /// Lists the rows of a batch. Writes that were refused or not answered are listed as well; their status shows them
    /// apart.
    pub fn new(batch: &Batch) -> Self {
        Self { all: Arc::new(ReadingBlocks::new(batch)), kept: None }
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
        let (mut buffer, mut registers) = (NumberBuffer::default(), RegisterBuffer::default());
        // A block of bits can be skipped at once if neither of the two possible numbers is kept.
        let no_bit = !keep(0.0) && !keep(1.0);
        for (at, block) in self.all.blocks.iter().enumerate() {
            let count = self.all.rows_of(at);
            let mut has_number = |bytes: &[u8]| self.all.has_number(block, count, bytes, &mut registers, &keep);
            let may_be_kept = match block.data {
                Data::Bits(..) => !no_bit,
                // Most filters keep few rows, so all numbers are first tested without their order.
                Data::Words(span) => has_number(span.of(&batch.arena)),
                Data::Register(value) => has_number(&(value as u16).to_be_bytes()),
                Data::Coil(_) => true,
            };
            if may_be_kept {
                let mut from = block.row;
                self.all.block_numbers(batch, block, count, &mut buffer, |numbers| {
                    rows.extend((from..).zip(numbers).filter(|(_, number)| keep(**number)).map(|(row, _)| row));
                    from += numbers.len() as u32;
                });
            }
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

    /// Looks up a row: its block by the directory, then its layout entry.
    #[inline]
    pub fn item(&self, row: usize) -> ReadingRef<'_> {
        let (all, row) = (&*self.all, self.number(row));
        let block = all.block_of(row);
        ReadingRef { block, entry: all.entry(block, row) }
    }
}

/// Calls `part` for each value, bare register and bit that a transaction wrote or read: with the values of the block,
/// the index of the first register or bit, and the layout entry.
pub(super) fn each_part<'a>(
    batch: &'a Batch,
    exchange: TransactionView<'_>,
    is_write: bool,
    mut part: impl FnMut(&Items<'a>, u16, LayoutEntry),
) {
    let block = if is_write { exchange.written(batch) } else { exchange.read(batch) };
    let Some((first, items)) = block else { return };
    let space = exchange.space();
    let mut part_at = |entry: LayoutEntry| part(&items, entry.address.wrapping_sub(first), entry);
    match exchange.points.zip(space) {
        Some((instance, space)) => instance.plan.block(space, first, items.len(), part_at),
        None => (0..items.len()).for_each(|item| part_at(LayoutEntry::bare(first.wrapping_add(item as u16)))),
    }
}
