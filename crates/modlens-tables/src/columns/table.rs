//! The rows of a table, and how their values are read.

use std::sync::Arc;

use modlens_engine::records::{Batch, Connection, DiagnosisRow, FindingRow, Frame, Transaction};

use crate::columns::cell::Cell;
use crate::columns::reader::{ColumnReader, RowReader};
use crate::columns::reading_columns::READINGS;
use crate::columns::reading_rows::{ReadingRef, ReadingRows};
use crate::columns::row_columns::{Connections, Diagnoses, Findings, Frames, Transactions};
use crate::columns::schema::TableKind;
use crate::columns::sink::CellSink;
use crate::columns::transaction_view::TransactionView;

/// The rows of one table in a batch, or those that a filter has kept.
#[derive(Clone, Debug)]
pub struct Table {
    /// The batch that holds the rows.
    pub batch: Arc<Batch>,
    /// The table.
    pub kind: TableKind,
    pub(super) rows: Rows,
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
    Transaction(TransactionView<'a>),
    Finding(&'a FindingRow),
    Connection(&'a Connection),
    Diagnosis(&'a DiagnosisRow),
    Reading(ReadingRef<'a>),
}

impl<'a> RowRef<'a> {
    /// The row of a transaction of this batch.
    #[inline]
    pub fn of_transaction(batch: &'a Batch, row: &'a Transaction) -> Self {
        Self { batch, of: RowOf::Transaction(TransactionView::new(batch, row)) }
    }

    /// The value of a column.
    #[inline]
    pub fn cell(&self, column: usize) -> Cell<'a> {
        match self.of {
            RowOf::Frame(row) => Frames::READ[column](self.batch, row),
            RowOf::Transaction(row) => Transactions::READ[column](self.batch, row),
            RowOf::Finding(row) => Findings::READ[column](self.batch, row),
            RowOf::Connection(row) => Connections::READ[column](self.batch, row),
            RowOf::Diagnosis(row) => Diagnoses::READ[column](self.batch, row),
            RowOf::Reading(row) => READINGS[column].1(self.batch, row),
        }
    }

    /// Passes the value of a column to a writer.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A few instructions in the innermost loop of every writer.
    pub fn emit<S: CellSink>(&self, column: &ColumnReader<S>, to: &mut S) {
        match (self.of, &column.0) {
            (RowOf::Frame(row), RowReader::Frame(pass)) => pass(self.batch, row, to),
            (RowOf::Transaction(row), RowReader::Transaction(pass, _)) => pass(self.batch, row, to),
            (RowOf::Finding(row), RowReader::Finding(pass)) => pass(self.batch, row, to),
            (RowOf::Connection(row), RowReader::Connection(pass)) => pass(self.batch, row, to),
            (RowOf::Diagnosis(row), RowReader::Diagnosis(pass)) => pass(self.batch, row, to),
            (RowOf::Reading(row), RowReader::Reading(column)) => to.put_cell(READINGS[*column].1(self.batch, row)),
            // The reader belongs to another table.
            _ => to.put_cell(Cell::Null),
        }
    }

    /// The number of the rows with which it shares some values: those of its bus or, of readings, those of what its transaction
    /// has read or written. `None` for connections, which carry their ends themselves, and for diagnoses.
    #[inline]
    pub fn group(&self) -> Option<u32> {
        match self.of {
            RowOf::Frame(row) => Some(row.bus),
            RowOf::Transaction(row) => Some(row.bus),
            RowOf::Finding(row) => Some(row.bus),
            RowOf::Reading(row) => Some(row.block.row),
            RowOf::Connection(_) | RowOf::Diagnosis(_) => None,
        }
    }
}

/// The rows of a view: all, all with compact exchanges among them, those with these indices, or readings.
#[derive(Clone, Debug)]
pub(super) enum Rows {
    All(usize),
    AllAndCompact(usize),
    Some(Arc<Vec<u32>>),
    Readings(ReadingRows),
}

impl Table {
    /// All rows of one table of a batch.
    pub fn new(batch: Arc<Batch>, kind: TableKind) -> Self {
        let rows = match kind {
            TableKind::Frames => Rows::All(batch.frames.len()),
            TableKind::Transactions if batch.exchange_runs.is_empty() => Rows::All(batch.transactions.len()),
            TableKind::Transactions => Rows::AllAndCompact(batch.transaction_count()),
            TableKind::Findings => Rows::All(batch.findings.len()),
            TableKind::Connections => Rows::All(batch.connections.len()),
            TableKind::Diagnoses => Rows::All(batch.diagnoses.len()),
            TableKind::Readings => Rows::Readings(ReadingRows::new(&batch)),
        };
        Self { batch, kind, rows }
    }

    /// The rows for which `keep` returns true.
    #[must_use]
    pub fn filter(&self, mut keep: impl FnMut(&Self, usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&row| keep(self, row)).collect();
        self.with_rows(&kept)
    }

    /// At most `count` rows from row `start` on, which may be after the last one.
    #[must_use]
    pub fn slice(&self, start: usize, count: usize) -> Self {
        let kept: Vec<usize> = (0..self.len()).skip(start).take(count).collect();
        self.with_rows(&kept)
    }

    /// The rows of these indices, which rise.
    fn with_rows(&self, kept: &[usize]) -> Self {
        let rows = match &self.rows {
            Rows::Readings(readings) => Rows::Readings(readings.select(kept)),
            _ => Rows::Some(Arc::new(kept.iter().map(|&row| self.index(row) as u32).collect())),
        };
        Self { batch: Arc::clone(&self.batch), kind: self.kind, rows }
    }

    /// Splits the rows by day and bus, in the order in which these first occur. The day is that of UTC; without a clock that is
    /// known, there is none.
    pub fn partitions(&self) -> Vec<(Option<String>, String, Self)> {
        let key = |name: &str| self.kind.column(name).expect("every table has it");
        let (time, bus) = (key(self.kind.time_column()), key("bus"));
        let mut parts: Vec<(Option<i64>, String, Vec<usize>)> = Vec::new();
        let mut last = 0;
        for row in 0..self.len() {
            let day = match self.cell(row, time) {
                Cell::Time(ns) => Some(ns.div_euclid(86_400_000_000_000)),
                _ => None,
            };
            let cell = self.cell(row, bus);
            let bus = if let Cell::Text(name) = cell { name } else { "" };
            // Rows of a day and bus mostly stand one after the other.
            if parts.get(last).is_none_or(|part| part.0 != day || part.1 != bus) {
                last = parts.iter().position(|part| part.0 == day && part.1 == bus).unwrap_or_else(|| {
                    parts.push((day, bus.to_owned(), Vec::new()));
                    parts.len() - 1
                });
            }
            parts[last].2.push(row);
        }
        let date = |day: i64| {
            let mut text = Vec::new();
            modlens_protocol::timestamp::push_time(day * 86_400_000_000_000, &mut text);
            String::from_utf8_lossy(&text[..10]).into_owned()
        };
        parts.into_iter().map(|(day, bus, rows)| (day.map(date), bus, self.with_rows(&rows))).collect()
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        match &self.rows {
            Rows::All(count) | Rows::AllAndCompact(count) => *count,
            Rows::Some(rows) => rows.len(),
            Rows::Readings(rows) => rows.len(),
        }
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The index in the batch of a row of this view.
    fn index(&self, row: usize) -> usize {
        match &self.rows {
            Rows::Some(rows) => rows[row] as usize,
            _ => row,
        }
    }

    /// The value of a column in a row.
    #[inline]
    pub fn cell(&self, row: usize, column: usize) -> Cell<'_> {
        self.row(row).cell(column)
    }

    /// The transactions to which the indices of rows refer.
    fn transactions(&self) -> &[Transaction] {
        self.batch.all_transactions()
    }

    /// One row. Use this to read several of its values.
    #[inline]
    pub fn row(&self, row: usize) -> RowRef<'_> {
        let batch = &*self.batch;
        let of = match (&self.rows, self.kind) {
            (Rows::Readings(rows), _) => RowOf::Reading(rows.item(row)),
            (_, TableKind::Frames) => RowOf::Frame(&batch.frames[self.index(row)]),
            (_, TableKind::Findings) => RowOf::Finding(&batch.findings[self.index(row)]),
            (_, TableKind::Connections) => RowOf::Connection(&batch.connections[self.index(row)]),
            (_, TableKind::Diagnoses) => RowOf::Diagnosis(&batch.diagnoses[self.index(row)]),
            _ => RowOf::Transaction(TransactionView::new(batch, &self.transactions()[self.index(row)])),
        };
        RowRef { batch, of }
    }

    /// The rows whose number in a column satisfies `keep`; rows without a number are left out. `None` if the column's
    /// numbers cannot be computed without a `Cell` for each row, which is possible only for the values of readings.
    pub fn with_numbers(&self, column: usize, keep: impl Fn(f64) -> bool) -> Option<Self> {
        match &self.rows {
            Rows::Readings(readings) if READINGS[column].0 == "value" => {
                let rows = Rows::Readings(readings.with_numbers(&self.batch, keep));
                Some(Self { batch: Arc::clone(&self.batch), kind: self.kind, rows })
            }
            _ => None,
        }
    }

    /// The number of a row's frame or transaction, in the tables of frames and transactions.
    pub fn number(&self, row: usize) -> Option<u64> {
        match self.kind {
            TableKind::Frames => self.frame(row).map(|row| row.number),
            _ => self.transaction(row).map(|row| row.number),
        }
    }

    /// The frame of a row in the table of frames.
    pub fn frame(&self, row: usize) -> Option<&Frame> {
        (self.kind == TableKind::Frames).then(|| &self.batch.frames[self.index(row)])
    }

    /// The transaction of a row in the table of transactions.
    pub fn transaction(&self, row: usize) -> Option<&Transaction> {
        (self.kind == TableKind::Transactions).then(|| &self.transactions()[self.index(row)])
    }
}
