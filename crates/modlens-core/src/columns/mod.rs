//! Columns: how a row is read. One line a column; `analyzer/columns.toml` has their types and words.
//!
//! Writers, filters and the border see rows only through `Table::cell`.

use std::sync::{Arc, OnceLock};

use serde_json::Value as Json;

mod blocks;
mod content;
mod readings;
mod shown;
mod tables;

pub use content::{exception_name, read_data, read_range, row_of, write_data, write_range, Fields};

use crate::finding::Finding;
use crate::functions::Functions;
use crate::points::Value;
use crate::records::{Batch, FindingRow, Frame, Place, Transaction};
use crate::Ns;
use blocks::{Item, Readings};
use content::Exchange;
use readings::READINGS;
pub use readings::{each_value, Part};
use tables::{Findings, Frames, Pass, PassExchange, Transactions, OF_THE_BUS};

/// The embedded columns.
pub const COLUMNS: &str = include_str!("../../../../analyzer/columns.toml");

/// Names of the tables, as options spell them.
pub const TABLES: [&str; 4] = ["frames", "transactions", "readings", "findings"];

/// The version of the columns, which travels in files that have a place for it.
pub fn version() -> u64 {
    static VERSION: OnceLock<u64> = OnceLock::new();
    *VERSION.get_or_init(|| {
        let file: Json = toml::from_str(COLUMNS).expect("the embedded columns are tested");
        file["version"].as_u64().expect("a version")
    })
}

/// A list of numbers that still stands on the wire.
#[derive(Clone, Copy, Debug)]
pub enum Items<'a> {
    /// Two bytes each.
    Words(&'a [u8]),
    /// So many bits, lowest first.
    Bits(&'a [u8], usize),
    /// One number.
    One(i32),
}

impl Items<'_> {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Words(bytes) => bytes.len() / 2,
            Self::Bits(bytes, count) => (*count).min(bytes.len() * 8),
            Self::One(_) => 1,
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them.
    #[inline]
    pub fn get(&self, index: usize) -> i32 {
        match self {
            Self::Words(bytes) => i32::from(u16::from_be_bytes([bytes[2 * index], bytes[2 * index + 1]])),
            Self::Bits(bytes, _) => i32::from(bytes[index / 8] >> (index % 8) & 1),
            Self::One(value) => *value,
        }
    }
}

/// One value of a row.
#[derive(Clone, Debug)]
pub enum Cell<'a> {
    /// Nothing.
    Null,
    /// A number.
    Int(i64),
    /// A number with a fraction.
    Float(f64),
    /// A value of a point, in letters.
    Value(Value<'a>),
    /// A duration; columns show microseconds.
    Us(Ns),
    /// A time: ns since 1970.
    Time(Ns),
    /// Yes or no.
    Bool(bool),
    /// A word of ours: it needs no escaping.
    Word(&'a str),
    /// Text from outside.
    Text(&'a str),
    /// Bytes as hex.
    Hex(&'a [u8]),
    /// Numbers.
    Ints(Items<'a>),
    /// Codes of findings.
    Codes(&'a [Finding]),
    /// Decoded fields.
    Fields(Fields<'a>),
    /// Named values.
    Map(Json),
    /// Where it stands: file, kind of place, number.
    Source(&'a str, Place, u64),
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// int64.
    Int,
    /// Microseconds, float64.
    Us,
    /// timestamp[ns, UTC].
    Time,
    /// float64.
    Float,
    /// bool.
    Bool,
    /// utf8, bytes as hex among them.
    Text,
    /// list of int32.
    Ints,
    /// list of utf8.
    Texts,
    /// JSON text.
    Map,
}

/// A column as `columns.toml` has it.
#[derive(Clone, Debug)]
pub struct Column {
    /// Name.
    pub key: String,
    /// Type.
    pub kind: Kind,
}

/// Which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// One row a frame.
    Frames,
    /// One row a transaction.
    Transactions,
    /// One row a register or bit.
    Readings,
    /// One row a finding.
    Findings,
}

impl TableKind {
    /// The table of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let kinds = [Self::Frames, Self::Transactions, Self::Readings, Self::Findings];
        TABLES.iter().position(|table| *table == name).map(|i| kinds[i])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        TABLES[self as usize]
    }

    /// Its columns, in order.
    pub fn columns(self) -> &'static [Column] {
        static ALL: OnceLock<Vec<Vec<Column>>> = OnceLock::new();
        let all = ALL.get_or_init(|| {
            let file: Json = toml::from_str(COLUMNS).expect("the embedded columns are tested");
            TABLES.iter().map(|table| file[*table].as_array().expect("a list").iter().map(column).collect()).collect()
        });
        &all[self as usize]
    }

    /// How a column is read for writers of this kind.
    pub fn reader<S: Put>(self, column: usize) -> Reader<S> {
        Reader(match self {
            Self::Frames => Way::Frame(Frames::pass(column)),
            Self::Transactions => Way::Transaction(Transactions::pass(column)),
            Self::Findings => Way::Finding(Findings::pass(column)),
            Self::Readings => Way::Reading(column),
        })
    }

    /// Whether all rows of a bus have the same value in this column.
    pub fn of_the_bus(self, column: usize) -> bool {
        self != Self::Readings && OF_THE_BUS.contains(&self.columns()[column].key.as_str())
    }

    /// The place of a column, or all known names in the error.
    pub fn column(self, key: &str) -> Result<usize, String> {
        let columns = self.columns();
        columns.iter().position(|column| column.key == key).ok_or_else(|| {
            let known: Vec<&str> = columns.iter().map(|column| column.key.as_str()).collect();
            format!("{} has no column {key:?}; it has {}", self.name(), known.join(", "))
        })
    }
}

fn column(row: &Json) -> Column {
    let kind = match row["type"].as_str() {
        Some("int") => Kind::Int,
        Some("us") => Kind::Us,
        Some("time") => Kind::Time,
        Some("float") => Kind::Float,
        Some("bool") => Kind::Bool,
        Some("ints") => Kind::Ints,
        Some("texts") => Kind::Texts,
        Some("map") => Kind::Map,
        Some("text" | "hex") => Kind::Text,
        other => panic!("columns.toml: unknown type {other:?}"),
    };
    Column { key: row["key"].as_str().expect("a key").to_owned(), kind }
}

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
            crate::write::push_time(day * 86_400_000_000_000, &mut text);
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
pub(crate) fn functions(batch: &Batch) -> &Functions {
    batch.functions.as_deref().unwrap_or_else(|| Functions::embedded())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_of_the_file_has_its_line_here() {
        let here: [Vec<&str>; 4] =
            [Frames::KEYS.to_vec(), Transactions::KEYS.to_vec(), READINGS.iter().map(|c| c.0).collect(), Findings::KEYS.to_vec()];
        for (kind, here) in
            [TableKind::Frames, TableKind::Transactions, TableKind::Readings, TableKind::Findings].iter().zip(here)
        {
            let there: Vec<&str> = kind.columns().iter().map(|column| column.key.as_str()).collect();
            assert_eq!(here, there, "{}", kind.name());
        }
    }
}
