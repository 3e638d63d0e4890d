//! The array of a column that gets its values.

use arrow_array::ArrayRef;

use crate::arrays::{bool_array, float_array, int_array, int_list_array, text_array, text_list_array, time_array};
use crate::of_exchanges::{Numbers, OfExchanges, ReadValues};
use crate::values::{ColumnBuilder, Item};
use modlens_tables::columns::{
    CellSink, ColumnReader, ColumnType, ExchangeChunk, ExchangeNumber, ExchangeRef, RowRef, TableKind,
};

/// An array of a column that gets its values.
pub(super) trait ArrayInMaking: Send {
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

    /// The array of all rows so far; the next one begins.
    fn finish(&mut self) -> ArrayRef;
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

struct Column<T> {
    values: ColumnBuilder<T>,
    /// A row for each kind of compact exchanges.
    of_kinds: ColumnBuilder<T>,
    /// For each kind 1 if it has a value, else 0.
    has_value: Vec<u8>,
    source: Source<T>,
    reader: ColumnReader<ColumnBuilder<T>>,
    finish: fn(ColumnBuilder<T>) -> ArrayRef,
}

impl<T: Item + Send> ArrayInMaking for Column<T>
where
    ColumnBuilder<T>: CellSink,
{
    fn take(&mut self, rows: &[RowRef<'_>]) {
        self.values.take(rows, &self.reader);
    }

    fn learn(&mut self, exchange: &ExchangeRef<'_>) {
        self.reader.pass_exchanges(std::slice::from_ref(&exchange.with_known_times()), &mut self.of_kinds);
        self.has_value.push(u8::from(!self.of_kinds.ends_with_nothing()));
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

    fn finish(&mut self) -> ArrayRef {
        let next = self.values.next();
        (self.finish)(std::mem::replace(&mut self.values, next))
    }
}

/// The array of a column of this table.
pub(super) fn in_making(table: TableKind, column: usize) -> Box<dyn ArrayInMaking> {
    let key = table.columns()[column].key.as_str();
    let number = ExchangeNumber::of_column(key).filter(|_| table == TableKind::Transactions);
    match table.columns()[column].kind {
        ColumnType::Int => match number {
            Some(number) => with_source(table, column, Source::Chunk(Box::new(Numbers(number))), int_array),
            None => boxed(table, column, int_array),
        },
        ColumnType::Time => boxed(table, column, time_array),
        ColumnType::Us | ColumnType::Float => boxed(table, column, float_array),
        ColumnType::Bool => boxed(table, column, bool_array),
        ColumnType::Text | ColumnType::Map => boxed(table, column, text_array),
        ColumnType::Ints if table == TableKind::Transactions && key == "data" => {
            with_source(table, column, Source::Chunk(Box::new(ReadValues::default())), int_list_array)
        }
        ColumnType::Ints => boxed(table, column, int_list_array),
        ColumnType::Texts => boxed(table, column, text_list_array),
    }
}

/// A column whose reader reads compact exchanges, too.
fn boxed<T: Item + Send + 'static>(
    table: TableKind,
    column: usize,
    finish: fn(ColumnBuilder<T>) -> ArrayRef,
) -> Box<dyn ArrayInMaking>
where
    ColumnBuilder<T>: CellSink,
{
    let source = if table.is_constant_per_exchange_kind(column) { Source::Kind } else { Source::Reader };
    with_source(table, column, source, finish)
}

fn with_source<T: Item + Send + 'static>(
    table: TableKind,
    column: usize,
    source: Source<T>,
    finish: fn(ColumnBuilder<T>) -> ArrayRef,
) -> Box<dyn ArrayInMaking>
where
    ColumnBuilder<T>: CellSink,
{
    let empty = || ColumnBuilder::with_capacity(0, 0);
    Box::new(Column { values: empty(), of_kinds: empty(), has_value: Vec::new(), source, reader: table.reader(column), finish })
}
