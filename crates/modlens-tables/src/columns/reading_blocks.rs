//! The blocks of registers or bits that the transactions of a batch read or wrote, from which the rows of the readings table
//! follow: a row for each layout entry of a block.

use std::mem::ManuallyDrop;
use std::sync::{Arc, OnceLock};

use crate::columns::cell::Items;
use crate::columns::function_rows::functions;
use crate::columns::transaction_view::TransactionView;
use modlens_engine::records::{Batch, ExchangeFrame, ExchangeRun, Part, Span};
use modlens_profiles::points::{
    BlockEntries, BlockPlan, BlockPlans, LayoutEntry, NumberBuffer, PlanInstance, RegisterBuffer, UnitPlans,
};
use modlens_protocol::functions::{Functions, Operation};
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
    /// The number of its first row.
    pub row: u32,
    contents: Contents,
    pub data: Data,
}

/// Where the layout entries of a block's rows are found.
#[derive(Clone, Copy, Debug)]
enum Contents {
    /// Each register or bit is a row.
    Bare,
    /// In the plan with this index in `ReadingBlocks::plans`.
    Known(u32),
    /// Those of this index in `ReadingBlocks::others`.
    Other(u32),
}

/// Where the values of a block are stored.
#[derive(Clone, Copy, Debug)]
pub(super) enum Data {
    /// Registers in the batch's arena.
    Words(Span),
    /// This many packed bits in the batch's arena.
    Bits(Span, u32),
    /// The value of a single register write.
    Register(i32),
    /// The value of a single coil write.
    Coil(i32),
}

/// The blocks of a batch, in the order of their rows. Shared by the views on it that filters make.
#[derive(Debug, Default)]
pub(super) struct ReadingBlocks {
    pub blocks: Vec<ReadingBlock>,
    /// What blocks with points contain that came before.
    plans: Vec<Arc<BlockPlan>>,
    /// Of each other block with points the index of its plan in `instances`, and of its first entry in `entries`.
    others: Vec<(u32, u32)>,
    instances: Vec<Arc<PlanInstance>>,
    /// The entries of those, block by block.
    entries: Vec<LayoutEntry>,
    pub rows: u32,
    /// The index of the block that contains each `STRIDE`th row, from which a row's block is found in a few steps; once somebody
    /// has asked for a row.
    directory: OnceLock<Vec<u32>>,
}

/// The number of rows between two entries of the directory.
const STRIDE: u32 = 16;

impl ReadingBlock {
    /// The values of the block.
    #[inline]
    pub fn items<'a>(&self, batch: &'a Batch) -> Items<'a> {
        match self.data {
            Data::Words(span) => Items::Words(span.of(&batch.arena)),
            Data::Bits(span, count) => Items::Bits(span.of(&batch.arena), count as usize),
            Data::Register(value) | Data::Coil(value) => Items::One(value),
        }
    }
}

impl ReadingBlocks {
    /// Those of a batch. Writes that were refused or not answered are among them as well.
    pub fn new(batch: &Batch) -> Self {
        let mut listing = Listing::new(batch);
        listing.add_all();
        listing.all
    }

    /// The layout entry of a row of this block.
    #[inline]
    pub fn entry(&self, block: &ReadingBlock, row: u32) -> LayoutEntry {
        let in_block = (row - block.row) as usize;
        match self.plan_of(block) {
            Some((_, entries)) => entries[in_block],
            None => LayoutEntry::bare(block.first.wrapping_add(in_block as u16)),
        }
    }

    /// The plan of a block with points, and the entries from its first one on.
    #[inline]
    fn plan_of(&self, block: &ReadingBlock) -> Option<(&PlanInstance, &[LayoutEntry])> {
        match block.contents {
            Contents::Bare => None,
            Contents::Known(at) => self.plans.get(at as usize).map(|plan| (&*plan.instance, &plan.entries[..])),
            Contents::Other(at) => {
                let (instance, first) = *self.others.get(at as usize)?;
                Some((&self.instances[instance as usize], &self.entries[first as usize..]))
            }
        }
    }

    /// The block that contains a row.
    #[inline]
    pub fn block_of(&self, row: u32) -> &ReadingBlock {
        let mut index = self.directory()[(row / STRIDE) as usize] as usize;
        while self.blocks.get(index + 1).is_some_and(|next| next.row <= row) {
            index += 1;
        }
        &self.blocks[index]
    }

    /// The index of the block of each `STRIDE`th row.
    fn directory(&self) -> &[u32] {
        self.directory.get_or_init(|| {
            let mut directory = Vec::with_capacity(self.rows.div_ceil(STRIDE) as usize);
            for at in 0..self.blocks.len() {
                let end = self.blocks[at].row + self.rows_of(at) as u32;
                directory.resize(end.div_ceil(STRIDE) as usize, at as u32);
            }
            directory
        })
    }

    /// The number of rows of a block.
    pub fn rows_of(&self, block: usize) -> usize {
        (self.blocks.get(block + 1).map_or(self.rows, |next| next.row) - self.blocks[block].row) as usize
    }

    /// Whether a number of this block of registers, which has these bytes, is wanted, as no NaN is.
    #[inline]
    pub fn has_number(
        &self,
        block: &ReadingBlock,
        rows: usize,
        bytes: &[u8],
        buffer: &mut RegisterBuffer,
        is_wanted: impl Fn(f64) -> bool,
    ) -> bool {
        match block.contents {
            Contents::Known(at) => self.plans[at as usize].has_number(bytes, buffer, is_wanted),
            Contents::Other(_) => self.plan_of(block).is_some_and(|(instance, entries)| {
                entries[..rows].iter().any(|entry| is_wanted(instance.entry_number(*entry, block.first, bytes)))
            }),
            Contents::Bare => {
                let number = |pair: &[u8; 2]| f64::from(u16::from_be_bytes(*pair));
                bytes.as_chunks().0.iter().fold(false, |any, pair| any | is_wanted(number(pair)))
            }
        }
    }

    /// Passes the numbers of a block's rows to `each`, a buffer at a time.
    #[inline]
    pub fn block_numbers(
        &self,
        batch: &Batch,
        block: &ReadingBlock,
        rows: usize,
        buffer: &mut NumberBuffer,
        each: impl FnMut(&[f64]),
    ) {
        let Some((instance, entries)) = self.plan_of(block) else {
            return bare_numbers(&block.items(batch), rows, buffer, each);
        };
        let entries = &entries[..rows];
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

/// Passes on the numbers of the `count` registers or bits of a block without points.
fn bare_numbers(items: &Items<'_>, count: usize, buffer: &mut NumberBuffer, mut each: impl FnMut(&[f64])) {
    match items {
        Items::Words(bytes) => {
            let pairs = bytes[..2 * count].as_chunks().0;
            buffer.for_each_chunk(pairs, each, |pair| f64::from(u16::from_be_bytes(*pair)));
        }
        Items::Bits(bytes, _) => {
            let bit = |place: usize| [0.0, 1.0][usize::from(bytes[place / 8] >> (place % 8) & 1)];
            (0..count).for_each(|place| each(&[bit(place)]));
        }
        Items::One(value) => each(&[f64::from(*value)]),
        Items::Numbers(_) => {}
    }
}

/// A function that reads one block of registers or bits and does nothing else, whatever the request.
#[derive(Clone, Copy)]
struct PlainRead {
    space: Option<Space>,
    /// Bytes before the block in the body of the response.
    before: u32,
    is_bits: bool,
}

/// Function codes without the exception bit.
const FUNCTIONS: usize = 128;

fn plain_read(functions: &Functions, code: u8) -> Option<PlainRead> {
    let row = functions.row(code, &[]).filter(|row| functions.leading_bytes(code) == 0 && row.operation == Operation::Read)?;
    let (before, is_bits) = row.offsets.response_block?;
    Some(PlainRead { space: row.space, before: before as u32, is_bits })
}

/// What is known of blocks, and the number of the list that refers to it.
struct BlockCache<'a> {
    blocks: &'a mut BlockPlans,
    list: u64,
}

/// Lists the blocks of a batch.
struct Listing<'a> {
    all: ReadingBlocks,
    batch: &'a Batch,
    /// The number of transactions so far.
    transactions: u32,
    /// By function code.
    plain_reads: [Option<PlainRead>; FUNCTIONS],
}

impl<'a> Listing<'a> {
    fn new(batch: &'a Batch) -> Self {
        let mut all = ReadingBlocks::default();
        all.blocks.reserve(batch.transaction_count());
        let plain_reads = std::array::from_fn(|code| plain_read(functions(batch), code as u8));
        Self { all, batch, transactions: 0, plain_reads }
    }

    /// Adds the blocks of all transactions.
    fn add_all(&mut self) {
        let mut of_rows = BlockPlans::default();
        let mut of_rows = BlockCache { list: of_rows.begin_list(), blocks: &mut of_rows };
        // The plans of the last run, and the number of the list that refers to its blocks.
        let mut previous: Option<(&Arc<UnitPlans>, u64)> = None;
        for part in self.batch.transaction_parts() {
            match part {
                Part::Rows(rows) => rows.iter().for_each(|row| self.add(TransactionView::new(self.batch, row), &mut of_rows)),
                Part::Compact(run) => {
                    let Some(points) = &run.points else {
                        self.add_run(run, &mut of_rows);
                        continue;
                    };
                    let blocks = &mut *points.known_blocks();
                    let list = match previous {
                        Some((plans, number)) if Arc::ptr_eq(plans, points) => number,
                        _ => blocks.begin_list(),
                    };
                    previous = Some((points, list));
                    self.add_run(run, &mut BlockCache { blocks, list });
                }
            }
        }
    }

    /// Adds the blocks of compact exchanges.
    fn add_run(&mut self, run: &ExchangeRun, known: &mut BlockCache<'_>) {
        let exchanges = run.exchanges.of(&self.batch.exchanges);
        let [before, behind] = run.around_pdu();
        for (at, exchange) in exchanges.iter().enumerate() {
            let plain_read = self.plain_reads[usize::from(exchange.function) % FUNCTIONS];
            let Some(PlainRead { space, before: header, is_bits }) = plain_read.filter(|_| exchange.exception == 0) else {
                // There is nothing to drop: the row has no profile of its own.
                let row = ManuallyDrop::new(run.transaction_of(exchange, at, exchanges[0].start, None));
                let function = functions(self.batch)
                    .row(exchange.function, exchange.body(ExchangeFrame::Request, &self.batch.arena, run.mode()));
                self.add(TransactionView::of_exchange(&row, function, run.points_of(exchange.unit)), known);
                continue;
            };
            let [request, response] = exchange.lengths.map(u32::from);
            let before = before + 1 + header;
            let span = Span { start: exchange.start + request + before, length: response - before - behind };
            let (data, count) = if is_bits {
                let count = u32::from(exchange.quantity).min(8 * span.length);
                (Data::Bits(span, count), count)
            } else {
                (Data::Words(span), span.length / 2)
            };
            let plan = space.zip(run.points_of(exchange.unit));
            self.add_block(false, exchange.address, data, count as usize, plan, known);
            self.transactions += 1;
        }
    }

    /// Adds the blocks of a transaction.
    fn add(&mut self, exchange: TransactionView<'_>, known: &mut BlockCache<'_>) {
        let (batch, space) = (self.batch, exchange.space());
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
                Items::Bits(bytes, count) => Data::Bits(batch.span_of(bytes), count as u32),
                Items::One(value) if space.is_some_and(Space::is_bits) => Data::Coil(value),
                Items::One(value) => Data::Register(value),
                Items::Numbers(_) => continue, // Of rows; no transaction carries them.
            };
            self.add_block(is_write, first, data, items.len(), space.zip(exchange.points), known);
        }
        self.transactions += 1;
    }

    /// Adds a block of `count` registers or bits of the transaction at hand, with the profile of its unit, if there is one.
    #[inline(always)]
    #[allow(clippy::inline_always)] // What a block consists of would be written to memory twice, and read too early.
    fn add_block(
        &mut self,
        is_write: bool,
        first: u16,
        data: Data,
        count: usize,
        plan: Option<(Space, &Arc<PlanInstance>)>,
        known: &mut BlockCache<'_>,
    ) {
        let row = self.all.rows;
        let contents = match plan {
            None => {
                self.all.rows += count as u32;
                Contents::Bare
            }
            Some((space, instance)) => self.contents(instance, (space, first, count), known),
        };
        self.all.blocks.push(ReadingBlock { txn: self.transactions, is_write, first, row, contents, data });
    }

    /// What a block contains by a plan; counts its rows.
    #[inline]
    fn contents(
        &mut self,
        instance: &Arc<PlanInstance>,
        (space, first, count): (Space, u16, usize),
        BlockCache { blocks, list }: &mut BlockCache<'_>,
    ) -> Contents {
        // No block of a PDU has more bits than a number of 16 bits counts. A single register hardly costs more to find out about
        // than to remember.
        let entries = match count {
            1 => BlockEntries::Unknown,
            _ => blocks.entries_of((*list, &mut self.all.plans), instance, (space, first, count as u16)),
        };
        match entries {
            BlockEntries::Listed(place, rows) => {
                self.all.rows += rows;
                Contents::Known(place)
            }
            BlockEntries::Bare => {
                self.all.rows += count as u32;
                Contents::Bare
            }
            BlockEntries::Unknown => self.other_contents(instance, (space, first, count)),
        }
    }

    /// The same of a block that did not come before.
    #[inline(never)]
    fn other_contents(&mut self, instance: &Arc<PlanInstance>, block: (Space, u16, usize)) -> Contents {
        let (all, (space, first, count)) = (&mut self.all, block);
        if !instance.plan.has_point_near(space, first, count) {
            all.rows += count as u32;
            return Contents::Bare;
        }
        let start = all.entries.len();
        instance.plan.extend_by_block(block, &mut all.entries);
        all.rows += (all.entries.len() - start) as u32;
        let known = all.instances.iter().position(|known| Arc::ptr_eq(known, instance));
        let of_instance = known.unwrap_or_else(|| {
            all.instances.push(Arc::clone(instance));
            all.instances.len() - 1
        });
        all.others.push((of_instance as u32, start as u32));
        Contents::Other(all.others.len() as u32 - 1)
    }
}
