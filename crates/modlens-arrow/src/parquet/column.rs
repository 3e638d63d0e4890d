//! A column of a row group: rows become values and levels, which the library's column writer makes into pages.
//!
//! A definition level says how much of a value is there, a repetition level whether it begins a row or continues the
//! list of the row (parquet-format, "Nested Encoding").

use std::sync::{Arc, Mutex, PoisonError};

use arrow_buffer::NullBuffer;
use bytes::Bytes;
use parquet::column::page::{CompressedPage, PageWriteSpec, PageWriter};
use parquet::column::writer::{ColumnCloseResult, ColumnWriterImpl};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterPropertiesPtr;
use parquet::file::writer::{SerializedPageWriter, TrackedWrite};
use parquet::schema::types::ColumnDescPtr;

use crate::column_values::{ColumnItem, ColumnValues, HasRows, TakeRows};
use crate::values::ColumnBuilder;
use modlens_tables::columns::{CellSink, ColumnType, TableKind};

/// A column of the row group that is being filled.
pub(super) trait Column: HasRows + Send {
    /// Writes the values of the rows that it has got.
    fn write(&mut self) -> Result<()>;

    /// All rows of the row group are there: gives its pages and what is to be said of them; the next row group begins.
    fn close(&mut self) -> Result<(Bytes, ColumnCloseResult)>;
}

/// The column of a table that a leaf of the schema stands for.
pub(super) fn column(table: TableKind, column: usize, leaf: &ColumnDescPtr, properties: &WriterPropertiesPtr) -> Box<dyn Column> {
    match table.columns()[column].kind {
        ColumnType::Int | ColumnType::Time => Chunk::<i64, Int64Type>::boxed(table, column, leaf, properties),
        ColumnType::Us | ColumnType::Float => Chunk::<f64, DoubleType>::boxed(table, column, leaf, properties),
        ColumnType::Bool => Chunk::<bool, BoolType>::boxed(table, column, leaf, properties),
        ColumnType::Text | ColumnType::Map => Chunk::<u8, ByteArrayType>::boxed(table, column, leaf, properties),
        ColumnType::Ints => Chunk::<i32, Int32Type>::boxed(table, column, leaf, properties),
        ColumnType::Texts => Chunk::<&'static str, ByteArrayType>::boxed(table, column, leaf, properties),
    }
}

struct Chunk<T, P: DataType> {
    leaf: ColumnDescPtr,
    properties: WriterPropertiesPtr,
    rows: ColumnValues<T>,
    /// Those of `rows` that are not null, as the library takes them.
    values: Vec<P::T>,
    definition: Vec<i16>,
    repetition: Vec<i16>,
    pages: Pages,
    writer: ColumnWriterImpl<'static, P>,
}

impl<T: ColumnItem, P: DataType> Chunk<T, P>
where
    Self: Column + 'static,
    ColumnBuilder<T>: CellSink,
{
    fn boxed(table: TableKind, column: usize, leaf: &ColumnDescPtr, properties: &WriterPropertiesPtr) -> Box<dyn Column> {
        let pages = Pages::default();
        Box::new(Self {
            leaf: Arc::clone(leaf),
            properties: Arc::clone(properties),
            rows: ColumnValues::new(table, column),
            values: Vec::new(),
            definition: Vec::new(),
            repetition: Vec::new(),
            writer: pages.writer(leaf, properties),
            pages,
        })
    }
}

impl<T: ColumnItem, P: DataType> HasRows for Chunk<T, P>
where
    ColumnBuilder<T>: CellSink,
{
    fn rows(&mut self) -> &mut dyn TakeRows {
        &mut self.rows
    }
}

impl<T: ColumnItem, P: DataType> Column for Chunk<T, P>
where
    ColumnBuilder<T>: CellSink + Leaf<P::T>,
{
    fn write(&mut self) -> Result<()> {
        let rows = &mut self.rows.values;
        rows.add_nothing();
        let nulls = rows.validity.finish();
        self.definition.clear();
        self.repetition.clear();
        let repeated = self.leaf.max_rep_level() > 0;
        if repeated {
            list_levels(&rows.offsets, nulls.as_ref(), &mut self.definition, &mut self.repetition);
        } else {
            levels(rows.rows(), nulls.as_ref(), &mut self.definition);
        }
        rows.leaves(nulls.as_ref(), &mut self.values);
        self.writer.write_batch(&self.values, Some(&self.definition), repeated.then_some(&self.repetition))?;
        self.values.clear();
        rows.items.clear();
        rows.offsets.truncate(1);
        Ok(())
    }

    fn close(&mut self) -> Result<(Bytes, ColumnCloseResult)> {
        let next = self.pages.writer(&self.leaf, &self.properties);
        let close = std::mem::replace(&mut self.writer, next).close()?;
        Ok((self.pages.take(), close))
    }
}

/// What is not null of the rows of a column, as Parquet has it.
trait Leaf<L> {
    fn leaves(&mut self, nulls: Option<&NullBuffer>, out: &mut Vec<L>);
}

macro_rules! leaves_are_items {
    ($($kind:ty),*) => {$(
        impl Leaf<$kind> for ColumnBuilder<$kind> {
            fn leaves(&mut self, nulls: Option<&NullBuffer>, out: &mut Vec<$kind>) {
                match nulls {
                    None => out.extend_from_slice(&self.items),
                    Some(nulls) => out.extend(nulls.valid_indices().map(|row| self.items[row])),
                }
            }
        }
    )*};
}

leaves_are_items!(i64, f64, bool);

/// Lists: a row that is null has no items.
impl Leaf<i32> for ColumnBuilder<i32> {
    fn leaves(&mut self, _: Option<&NullBuffer>, out: &mut Vec<i32>) {
        out.extend_from_slice(&self.items);
    }
}

impl Leaf<ByteArray> for ColumnBuilder<&'static str> {
    fn leaves(&mut self, _: Option<&NullBuffer>, out: &mut Vec<ByteArray>) {
        out.extend(self.items.iter().map(|item| Bytes::from_static(item.as_bytes()).into()));
    }
}

/// Texts share the memory that they were written to.
impl Leaf<ByteArray> for ColumnBuilder<u8> {
    fn leaves(&mut self, nulls: Option<&NullBuffer>, out: &mut Vec<ByteArray>) {
        let room = self.items.len();
        let text = Bytes::from(std::mem::replace(&mut self.items, Vec::with_capacity(room)));
        let one = |row: usize| text.slice(self.offsets[row] as usize..self.offsets[row + 1] as usize).into();
        match nulls {
            None => out.extend((0..self.offsets.len() - 1).map(one)),
            Some(nulls) => out.extend(nulls.valid_indices().map(one)),
        }
    }
}

/// Which rows have a value: 1, or 0 for null.
fn levels(rows: usize, nulls: Option<&NullBuffer>, definition: &mut Vec<i16>) {
    match nulls {
        None => definition.resize(rows, 1),
        Some(nulls) => definition.extend(nulls.iter().map(i16::from)),
    }
}

/// Where lists begin, and what is in them: 0 for null, 1 for an empty one, 3 for an item.
fn list_levels(offsets: &[i32], nulls: Option<&NullBuffer>, definition: &mut Vec<i16>, repetition: &mut Vec<i16>) {
    for (row, ends) in offsets.windows(2).enumerate() {
        let length = (ends[1] - ends[0]) as usize;
        repetition.push(0);
        if length == 0 {
            definition.push(i16::from(nulls.is_none_or(|nulls| nulls.is_valid(row))));
        } else {
            repetition.resize(repetition.len() + length - 1, 1);
            definition.resize(definition.len() + length, 3);
        }
    }
}

/// The pages of a column, compressed, until the row group is complete: in the file its columns are one after the other.
#[derive(Default)]
struct Pages(Arc<Mutex<Vec<u8>>>);

impl Pages {
    fn writer<P: DataType>(&self, leaf: &ColumnDescPtr, properties: &WriterPropertiesPtr) -> ColumnWriterImpl<'static, P> {
        let pages = Box::new(Self(Arc::clone(&self.0)));
        ColumnWriterImpl::new(Arc::clone(leaf), Arc::clone(properties), pages)
    }

    fn take(&self) -> Bytes {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner)).into()
    }
}

impl PageWriter for Pages {
    fn write_page(&mut self, page: CompressedPage) -> Result<PageWriteSpec> {
        let mut pages = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let before = pages.len() as u64;
        let mut out = TrackedWrite::new(&mut *pages);
        let mut writer = SerializedPageWriter::new(&mut out);
        let mut written = writer.write_page(page)?;
        writer.close()?;
        written.offset += before;
        Ok(written)
    }

    fn close(&mut self) -> Result<()> {
        Ok(())
    }
}
