//! The rows of the readings table, kept as runs: what a transaction read or wrote is one block, and its rows are a slice
//! of what the plan of its unit has laid out. A row itself is looked up when somebody asks for it.

use std::ops::Range;
use std::sync::Arc;

use crate::columns::content::Exchange;
use crate::columns::Items;
use modlens_engine::records::{Batch, Span, Transaction};
use modlens_profiles::points::{Bound, Part, Piece, Plan, Step};
use modlens_protocol::functions::Operation;
use modlens_protocol::register_type::Space;

/// What one transaction read or wrote: looked up once for all of its rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// In `Batch::transactions`.
    pub txn: u32,
    /// Whether it was written.
    pub write: bool,
    /// Its first register or bit.
    pub first: u16,
    data: Data,
}

/// Where the registers or bits of a block are in the arena.
#[derive(Clone, Copy, Debug)]
enum Data {
    Words(Span),
    Bits(Span, usize),
    /// A single write carries its register as a number.
    Register(i32),
    Coil(i32),
}

/// Rows one behind the other in one block.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// The first of them.
    row: u32,
    /// In `All::blocks`.
    block: u32,
    steps: Steps,
}

/// Where the steps of a run are.
#[derive(Clone, Copy, Debug)]
enum Steps {
    /// Bare registers or bits from this address on.
    Bare(u16),
    /// In the steps of the transaction's plan.
    Plan(u32),
    /// In `All::own`.
    Own(u32),
}

#[derive(Debug, Default)]
struct All {
    blocks: Vec<Block>,
    runs: Vec<Run>,
    own: Vec<Step>,
    /// The run of every so many rows, to find a row from.
    directory: Vec<u32>,
    rows: u32,
}

/// Rows between two entries of the directory.
const STRIDE: u32 = 16;

/// The rows of the table.
#[derive(Clone, Debug)]
pub(super) struct Readings {
    all: Arc<All>,
    /// Those that a filter has kept.
    some: Option<Arc<Vec<u32>>>,
}

/// A row with its block.
#[derive(Clone, Copy)]
pub(super) struct Item<'a> {
    pub block: &'a Block,
    pub step: Step,
}

impl Item<'_> {
    /// Its place in the block.
    pub fn place(&self) -> usize {
        usize::from(self.step.address.wrapping_sub(self.block.first))
    }
}

impl Block {
    #[inline]
    pub fn items<'a>(&self, batch: &'a Batch) -> Items<'a> {
        match self.data {
            Data::Words(span) => Items::Words(span.of(&batch.arena)),
            Data::Bits(span, count) => Items::Bits(span.of(&batch.arena), count),
            Data::Register(value) | Data::Coil(value) => Items::One(value),
        }
    }
}

impl Readings {
    /// The rows of a batch. Refused and unanswered writes are listed too, with their status.
    pub fn new(batch: &Batch) -> Self {
        let mut all = All::default();
        all.blocks.reserve(batch.transactions.len());
        all.runs.reserve(2 * batch.transactions.len());
        all.directory.reserve(batch.arena.len() / 2 / STRIDE as usize);
        for (txn, t) in batch.transactions.iter().enumerate() {
            let exchange = Exchange::new(batch, t);
            let space = exchange.space();
            let plan = t.points.as_deref().zip(space).map(|(bound, space)| (&*bound.plan, space));
            let sides = match exchange.operation() {
                Operation::Read => &[false][..],
                Operation::Write => &[true],
                Operation::ReadWrite => &[true, false],
                Operation::Other => &[],
            };
            for &write in sides {
                let block = if write { exchange.written(batch) } else { exchange.read(batch) };
                let Some((first, items)) = block else { continue };
                let data = match items {
                    Items::Words(bytes) => Data::Words(batch.span_of(bytes)),
                    Items::Bits(bytes, count) => Data::Bits(batch.span_of(bytes), count),
                    Items::One(value) if space.is_some_and(Space::bits) => Data::Coil(value),
                    Items::One(value) => Data::Register(value),
                };
                all.blocks.push(Block { txn: txn as u32, write, first, data });
                all.add(plan, first, items.len());
            }
        }
        Self { all: Arc::new(all), some: None }
    }

    /// Some of the rows.
    pub fn some(&self, rows: &[usize]) -> Self {
        let rows = rows.iter().map(|&row| self.number(row)).collect();
        Self { all: Arc::clone(&self.all), some: Some(Arc::new(rows)) }
    }

    /// The rows whose number is right; those without a number are left out.
    pub fn with_numbers(&self, batch: &Batch, keep: impl Fn(f64) -> bool) -> Self {
        let mut rows = Vec::new();
        let mut part = Part::default();
        // Bits are one of two numbers.
        let no_bit = !keep(0.0) && !keep(1.0);
        for (at, run) in self.all.runs.iter().enumerate() {
            if no_bit && matches!(self.all.blocks[run.block as usize].data, Data::Bits(..)) {
                continue;
            }
            let mut from = run.row;
            self.all.numbers(batch, run, self.all.length(at), &mut part, |some| {
                // Most filters keep few: whole stretches are left out without a look at each.
                if some.iter().fold(false, |any, &number| any | keep(number)) {
                    rows.extend((from..).zip(some).filter(|(_, number)| keep(**number)).map(|(row, _)| row));
                }
                from += some.len() as u32;
            });
        }
        if let Some(some) = &self.some {
            rows.retain(|row| some.binary_search(row).is_ok());
        }
        Self { all: Arc::clone(&self.all), some: Some(Arc::new(rows)) }
    }

    pub fn len(&self) -> usize {
        self.some.as_ref().map_or(self.all.rows as usize, |rows| rows.len())
    }

    fn number(&self, row: usize) -> u32 {
        self.some.as_ref().map_or(row as u32, |rows| rows[row])
    }

    #[inline]
    pub fn item<'a>(&'a self, batch: &'a Batch, row: usize) -> Item<'a> {
        let (all, row) = (&*self.all, self.number(row));
        let mut at = all.directory[(row / STRIDE) as usize] as usize;
        while all.runs.get(at + 1).is_some_and(|next| next.row <= row) {
            at += 1;
        }
        let run = &all.runs[at];
        let (block, behind) = (&all.blocks[run.block as usize], row - run.row);
        let step = match run.steps {
            Steps::Bare(address) => Step::bare(address.wrapping_add(behind as u16)),
            Steps::Plan(from) => match &batch.transactions[block.txn as usize].points {
                Some(bound) => bound.plan.steps()[(from + behind) as usize],
                None => Step::bare(block.first),
            },
            Steps::Own(from) => all.own[(from + behind) as usize],
        };
        Item { block, step }
    }
}

impl All {
    /// The rows of the last block.
    fn add(&mut self, plan: Option<(&Plan, Space)>, first: u16, count: usize) {
        let Some((plan, space)) = plan else { return self.run(Steps::Bare(first), count) };
        plan.pieces(space, first, count, |piece| match piece {
            Piece::Bare(Range { start, end }) => self.run(Steps::Bare(start as u16), end - start),
            Piece::Steps(Range { start, end }) => self.run(Steps::Plan(start as u32), end - start),
            Piece::Edge(edge) => {
                let from = self.own.len();
                plan.edge(&edge, |step| self.own.push(step));
                self.run(Steps::Own(from as u32), self.own.len() - from);
            }
        });
    }

    fn run(&mut self, steps: Steps, rows: usize) {
        if rows == 0 {
            return;
        }
        let run = self.runs.len() as u32;
        self.runs.push(Run { row: self.rows, block: self.blocks.len() as u32 - 1, steps });
        self.rows += rows as u32;
        self.directory.resize(self.rows.div_ceil(STRIDE) as usize, run);
    }

    fn length(&self, run: usize) -> usize {
        (self.runs.get(run + 1).map_or(self.rows, |next| next.row) - self.runs[run].row) as usize
    }

    /// The numbers of a run, some at a time.
    #[inline]
    fn numbers(&self, batch: &Batch, run: &Run, count: usize, part: &mut Part, each: impl FnMut(&[f64])) {
        let block = &self.blocks[run.block as usize];
        let bound = batch.transactions[block.txn as usize].points.as_deref();
        let steps = match run.steps {
            Steps::Bare(address) => return bare(&block.items(batch), address.wrapping_sub(block.first), count, part, each),
            Steps::Plan(from) => bound.map_or(&[][..], |bound| &bound.plan.steps()[from as usize..][..count]),
            Steps::Own(from) => &self.own[from as usize..][..count],
        };
        let Some(bound) = bound else { return };
        match block.data {
            Data::Words(span) => bound.numbers(steps, block.first, span.of(&batch.arena), part, each),
            Data::Register(value) => bound.numbers(steps, block.first, &(value as u16).to_be_bytes(), part, each),
            Data::Bits(..) | Data::Coil(_) => {
                let items = block.items(batch);
                let bit = |step: &Step| f64::from(items.get(usize::from(step.address.wrapping_sub(block.first))));
                part.of(steps, each, bit);
            }
        }
    }
}

fn bare(items: &Items<'_>, place: u16, count: usize, part: &mut Part, mut each: impl FnMut(&[f64])) {
    let places = usize::from(place)..usize::from(place) + count;
    match items {
        Items::Words(bytes) => {
            let pairs = bytes[2 * places.start..2 * places.end].as_chunks().0;
            part.of(pairs, each, |pair| f64::from(u16::from_be_bytes(*pair)));
        }
        Items::Bits(bytes, _) => {
            let bit = |place: usize| [0.0, 1.0][usize::from(bytes[place / 8] >> (place % 8) & 1)];
            places.for_each(|place| each(&[bit(place)]));
        }
        Items::One(value) => each(&[f64::from(*value)]),
    }
}

/// The parts of what a transaction wrote or read: registers, bits, and values of the plan.
pub(super) fn parts<'a>(batch: &'a Batch, t: &Transaction, write: bool, mut part: impl FnMut(&Items<'a>, u16, Step)) {
    let exchange = Exchange::new(batch, t);
    let block = if write { exchange.written(batch) } else { exchange.read(batch) };
    let Some((first, items)) = block else { return };
    let space = exchange.space();
    let mut one = |step: Step| part(&items, step.address.wrapping_sub(first), step);
    match t.points.as_deref().zip(space) {
        Some((Bound { plan, .. }, space)) => plan.block(space, first, items.len(), one),
        None => (0..items.len()).for_each(|item| one(Step::bare(first.wrapping_add(item as u16)))),
    }
}
