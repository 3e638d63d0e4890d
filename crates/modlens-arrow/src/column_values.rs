//! The values of a column, from rows and from compact exchanges.

use crate::of_exchanges::{Numbers, OfExchanges, ReadValues};
use crate::values::{ColumnBuilder, Item};
use modlens_tables::columns::{CellSink, ColumnReader, ExchangeChunk, ExchangeNumber, ExchangeRef, RowRef, TableKind};

/// A column that takes the values of rows.
pub(super) trait TakeRows {
    /// Appends the values of further rows.
    fn take(&mut self, rows: &[RowRef<'_>]);

    /// Takes the value of an exchange of the next kind of compact exchanges: that of its kind.
    fn learn(&mut self, exchange: &ExchangeRef<'_>);

    /// Forgets the kinds of compact exchanges.
    fn forget_kinds(&mut self);

    /// Whether `take_exchanges` needs compact exchanges one by one.
    fn reads_each(&self) -> bool;

    /// Appends the values of further compact exchanges. `kinds` are the numbers of their kinds, in the order in which these were
    /// learned; `each` are the same exchanges, if they are needed one by one.
    fn take_exchanges(&mut self, exchanges: &ExchangeChunk<'_>, kinds: &[u32], each: &[ExchangeRef<'_>]);
}

/// What has the values of a column.
pub(super) trait HasRows {
    /// These.
    fn rows(&mut self) -> &mut dyn TakeRows;
}

/// Where the values of compact exchanges come from. What their kinds have says which of them have none.
enum Source<T> {
    /// They are those of their kinds.
    Kind,
    /// From all exchanges at once.
    Chunk(Box<dyn OfExchanges<T>>),
    /// From the reader of the column, one by one.
    Reader,
}

/// A column, and how its values are read.
pub(super) struct ColumnValues<T> {
    key: &'static str,
    pub(super) values: ColumnBuilder<T>,
    /// A row for each kind of compact exchanges.
    of_kinds: ColumnBuilder<T>,
    /// For each kind 1 if it has a value, else 0.
    has_value: Vec<u8>,
    source: Source<T>,
    reader: ColumnReader<ColumnBuilder<T>>,
}

/// What a column of these values may be made of, beside its reader.
pub(super) trait ColumnItem: Item + Send + 'static {
    /// The values of this column of many compact exchanges at once, if there is a way to get them.
    fn of_exchanges(_: TableKind, _: usize) -> Option<Box<dyn OfExchanges<Self>>> {
        None
    }
}

impl ColumnItem for f64 {}
impl ColumnItem for bool {}
impl ColumnItem for u8 {}
impl ColumnItem for &'static str {}

impl ColumnItem for i64 {
    fn of_exchanges(table: TableKind, column: usize) -> Option<Box<dyn OfExchanges<Self>>> {
        let number = ExchangeNumber::of_column(&table.columns()[column].key).filter(|_| table == TableKind::Transactions)?;
        Some(Box::new(Numbers(number)))
    }
}

impl ColumnItem for i32 {
    fn of_exchanges(table: TableKind, column: usize) -> Option<Box<dyn OfExchanges<Self>>> {
        let is_read = table == TableKind::Transactions && table.columns()[column].key == "data";
        is_read.then(|| Box::<ReadValues>::default() as Box<dyn OfExchanges<Self>>)
    }
}

impl<T: ColumnItem> ColumnValues<T>
where
    ColumnBuilder<T>: CellSink,
{
    /// Of a column of this table.
    pub(super) fn new(table: TableKind, column: usize) -> Self {
        let source = match T::of_exchanges(table, column) {
            Some(values) => Source::Chunk(values),
            None if table.is_constant_per_exchange_kind(column) => Source::Kind,
            None => Source::Reader,
        };
        let empty = || ColumnBuilder::with_capacity(0, 0);
        let key = &table.columns()[column].key;
        Self { key, values: empty(), of_kinds: empty(), has_value: Vec::new(), source, reader: table.reader(column) }
    }
}

impl<T: ColumnItem> TakeRows for ColumnValues<T>
where
    ColumnBuilder<T>: CellSink,
{
    fn take(&mut self, rows: &[RowRef<'_>]) {
        self.values.take(rows, &self.reader);
    }

    fn learn(&mut self, exchange: &ExchangeRef<'_>) {
        self.reader.pass_exchanges(std::slice::from_ref(&exchange.with_known_times()), &mut self.of_kinds);
        self.has_value.push(u8::from(!self.of_kinds.ends_with_nothing() || exchange.shows_profile(self.key)));
        self.of_kinds.add_nothing();
        if let Source::Chunk(values) = &mut self.source {
            values.learn(exchange);
        }
    }

    fn forget_kinds(&mut self) {
        self.of_kinds = ColumnBuilder::with_capacity(0, 0);
        self.has_value.clear();
        if let Source::Chunk(values) = &mut self.source {
            values.forget_kinds();
        }
    }

    fn reads_each(&self) -> bool {
        matches!(self.source, Source::Reader) && self.has_value.contains(&1)
    }

    fn take_exchanges(&mut self, exchanges: &ExchangeChunk<'_>, kinds: &[u32], each: &[ExchangeRef<'_>]) {
        if !self.has_value.contains(&1) {
            return self.values.push_nothing(kinds.len());
        }
        if matches!(self.source, Source::Reader) {
            return self.reader.pass_exchanges(each, &mut self.values);
        }
        self.values.add_nothing();
        match &self.source {
            Source::Chunk(values) => values.push_items(exchanges, kinds, &self.has_value, &mut self.values),
            Source::Kind | Source::Reader => self.values.push_items(&self.of_kinds, kinds),
        }
        if self.has_value.contains(&0) {
            self.values.validity.push_kinds(&self.has_value, kinds);
        } else {
            self.values.validity.push_values(kinds.len());
        }
    }
}
