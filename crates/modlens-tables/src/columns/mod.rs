//! Columns: how a row is read. One line a column; `analyzer/columns.toml` has their types and words.
//!
//! Writers, filters and the border see rows only through `Table::cell`.

use std::sync::Arc;

mod blocks;
mod cell;
mod content;
mod kind;
mod readings;
mod shown;
mod tables;

pub use cell::{Cell, Items};
pub use content::{exception_name, read_data, read_range, row_of, write_data, write_range, Fields};
pub use kind::{version, Column, Kind, TableKind, COLUMNS, TABLES};

use blocks::{Item, Readings};
use content::Exchange;
use modlens_engine::records::{Batch, FindingRow, Frame, Transaction};
use modlens_protocol::functions::Functions;
use readings::READINGS;
pub use readings::{each_value, Part};
use tables::{Findings, Frames, Pass, PassExchange, Transactions};

/// A view on rows of a batch.
#[derive(Clone, Debug)]
pub struct Table {
    /// The batch.
    pub batch: Arc<Batch>,
    /// Which table.
    pub kind: TableKind,
    rows: Rows,
}

/// One row of a table.
#[derive(Clone, Copy)]
pub struct RowRef<'a> {
    batch: &'a Batch,
    of: RowOf<'a>,
}

#[derive(Clone, Copy)]
enum RowOf<'a> {
    Frame(&'a Frame),
    Transaction(Exchange<'a>),
    Finding(&'a FindingRow),
    Reading(Item<'a>),
}

/// Takes the values of columns: a writer.
pub trait Put {
    /// Takes one. Its callers know the kind of value, so it should be inlined into them.
    fn put(&mut self, cell: Cell<'_>);
}

/// How a column of a table is read for one kind of writer.
pub struct Reader<S>(Way<S>);

enum Way<S> {
    Frame(Pass<Frame, S>),
    Transaction(PassExchange<S>),
    Finding(Pass<FindingRow, S>),
    Reading(usize),
}

impl<'a> RowRef<'a> {
    /// One of its values.
    #[inline]
    pub fn cell(&self, column: usize) -> Cell<'a> {
        match self.of {
            RowOf::Frame(row) => Frames::READ[column](self.batch, row),
            RowOf::Transaction(row) => Transactions::READ[column](self.batch, row),
            RowOf::Finding(row) => Findings::READ[column](self.batch, row),
            RowOf::Reading(row) => READINGS[column].1(self.batch, row),
        }
    }

    /// Passes one of its values on.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A few instructions in the innermost loop of every writer.
    pub fn pass<S: Put>(&self, column: &Reader<S>, to: &mut S) {
        match (self.of, &column.0) {
            (RowOf::Frame(row), Way::Frame(pass)) => pass(self.batch, row, to),
            (RowOf::Transaction(row), Way::Transaction(pass)) => pass(self.batch, row, to),
            (RowOf::Finding(row), Way::Finding(pass)) => pass(self.batch, row, to),
            (RowOf::Reading(row), Way::Reading(column)) => to.put(READINGS[*column].1(self.batch, row)),
            // A reader of another table: it has nothing to say of this row.
            _ => to.put(Cell::Null),
        }
    }

    /// The number of its bus; readings have none of their own.
    #[inline]
    pub fn bus(&self) -> Option<u32> {
        match self.of {
            RowOf::Frame(row) => Some(row.bus),
            RowOf::Transaction(row) => Some(row.bus),
            RowOf::Finding(row) => Some(row.bus),
            RowOf::Reading(_) => None,
        }
    }
}

#[derive(Clone, Debug)]
enum Rows {
    All(usize),
    Some(Arc<Vec<u32>>),
    Readings(Readings),
}

impl Table {
    /// All rows of this kind.
    pub fn new(batch: Arc<Batch>, kind: TableKind) -> Self {
        let rows = match kind {
            TableKind::Frames => Rows::All(batch.frames.len()),
            TableKind::Transactions => Rows::All(batch.transactions.len()),
            TableKind::Findings => Rows::All(batch.findings.len()),
            TableKind::Readings => Rows::Readings(Readings::new(&batch)),
        };
        Self { batch, kind, rows }
    }

    /// The rows for which `keep` says yes.
    #[must_use]
    pub fn filter(&self, mut keep: impl FnMut(&Self, usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&row| keep(self, row)).collect();
        let rows = match &self.rows {
            Rows::Readings(readings) => Rows::Readings(readings.some(&kept)),
            _ => Rows::Some(Arc::new(kept.into_iter().map(|row| self.index(row) as u32).collect())),
        };
        Self { batch: Arc::clone(&self.batch), kind: self.kind, rows }
    }

    /// The rows by day (UTC, where the clock is) and bus, in the order in which these first come.
    pub fn partitions(&self) -> Vec<(Option<String>, String, Self)> {
        let key = |name: &str| self.kind.column(name).expect("every table has it");
        let (time, bus) = (key("time"), key("bus"));
        let of = |table: &Self, row: usize| {
            let day = match table.cell(row, time) {
                Cell::Time(ns) => Some(ns.div_euclid(86_400_000_000_000)),
                _ => None,
            };
            let bus = if let Cell::Text(name) = table.cell(row, bus) { name.to_owned() } else { String::new() };
            (day, bus)
        };
        let mut keys: Vec<(Option<i64>, String)> = Vec::new();
        for row in 0..self.len() {
            let key = of(self, row);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let date = |day: i64| {
            let mut text = Vec::new();
            modlens_protocol::timestamp::push_time(day * 86_400_000_000_000, &mut text);
            String::from_utf8_lossy(&text[..10]).into_owned()
        };
        let part = |key: (Option<i64>, String)| {
            let rows = self.filter(|table, row| of(table, row) == key);
            (key.0.map(date), key.1, rows)
        };
        keys.into_iter().map(part).collect()
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        match &self.rows {
            Rows::All(count) => *count,
            Rows::Some(rows) => rows.len(),
            Rows::Readings(rows) => rows.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn index(&self, row: usize) -> usize {
        match &self.rows {
            Rows::Some(rows) => rows[row] as usize,
            _ => row,
        }
    }

    /// One value.
    #[inline]
    pub fn cell(&self, row: usize, column: usize) -> Cell<'_> {
        self.row(row).cell(column)
    }

    /// One row, for those who read several of its values.
    #[inline]
    pub fn row(&self, row: usize) -> RowRef<'_> {
        let batch = &*self.batch;
        let of = match (&self.rows, self.kind) {
            (Rows::Readings(rows), _) => RowOf::Reading(rows.item(batch, row)),
            (_, TableKind::Frames) => RowOf::Frame(&batch.frames[self.index(row)]),
            (_, TableKind::Findings) => RowOf::Finding(&batch.findings[self.index(row)]),
            _ => RowOf::Transaction(Exchange::new(batch, &batch.transactions[self.index(row)])),
        };
        RowRef { batch, of }
    }

    /// The rows whose number in a column is right, where the numbers are to be had without a `Cell` between: the values
    /// of readings. Rows without a number are left out.
    pub fn with_numbers(&self, column: usize, keep: impl Fn(f64) -> bool) -> Option<Self> {
        match &self.rows {
            Rows::Readings(readings) if READINGS[column].0 == "value" => {
                let rows = Rows::Readings(readings.with_numbers(&self.batch, keep));
                Some(Self { batch: Arc::clone(&self.batch), kind: self.kind, rows })
            }
            _ => None,
        }
    }

    /// The number of a row's frame or transaction, where rows are frames or transactions.
    pub fn number(&self, row: usize) -> Option<u64> {
        match self.kind {
            TableKind::Frames => self.frame(row).map(|row| row.number),
            _ => self.transaction(row).map(|row| row.number),
        }
    }

    /// The frame behind a row, where rows are frames.
    pub fn frame(&self, row: usize) -> Option<&Frame> {
        (self.kind == TableKind::Frames).then(|| &self.batch.frames[self.index(row)])
    }

    /// The transaction behind a row, where rows are transactions.
    pub fn transaction(&self, row: usize) -> Option<&Transaction> {
        (self.kind == TableKind::Transactions).then(|| &self.batch.transactions[self.index(row)])
    }
}

/// The table that decodes the rows of a batch.
pub fn functions(batch: &Batch) -> &Functions {
    batch.functions.as_deref().unwrap_or_else(|| Functions::embedded())
}
