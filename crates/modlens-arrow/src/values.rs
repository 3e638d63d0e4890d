//! Builds the arrays of a column, in the form that Arrow and Parquet need.
#![allow(clippy::inline_always)]
// Reduces the match of each `put` to one arm in each caller.

use std::mem::ManuallyDrop;

use arrow_buffer::NullBufferBuilder;

use modlens_protocol::decimal::push_short;
use modlens_protocol::hex::push_hex;
use modlens_tables::cell_text::{push_plain, push_source};
use modlens_tables::columns::{Cell, CellSink, ColumnReader, Items, RowRef};

/// The values of a column: items, offsets and nulls.
pub(super) struct ColumnBuilder<T> {
    /// The values; for lists and texts, the items of all rows one after the other. A row without a value has a default
    /// value here.
    pub(super) items: Vec<T>,
    pub(super) nulls: NullBufferBuilder,
    /// For lists and texts: a zero, then the end of each row's items.
    pub(super) offsets: Vec<i32>,
}

impl<T> ColumnBuilder<T> {
    pub(super) fn with_capacity(rows: usize) -> Self {
        let mut offsets = Vec::with_capacity(rows + 1);
        offsets.push(0);
        Self { items: Vec::with_capacity(rows), nulls: NullBufferBuilder::new(rows), offsets }
    }

    /// Appends the values of further rows.
    pub(super) fn take(&mut self, rows: &[RowRef<'_>], reader: &ColumnReader<Self>)
    where
        Self: CellSink,
    {
        for row in rows {
            row.emit(reader, self);
        }
    }
}

impl<T: Clone + Default> ColumnBuilder<T> {
    /// Appends a value of fixed size, or null.
    #[inline(always)]
    fn push_value(&mut self, value: Option<T>) {
        self.nulls.append(value.is_some());
        self.items.push(value.unwrap_or_default());
    }

    /// Appends so many nulls of fixed size.
    fn push_nulls(&mut self, rows: usize) {
        self.nulls.append_n_nulls(rows);
        self.items.resize(self.items.len() + rows, T::default());
    }

    /// Ends so many rows without items.
    fn end_nulls(&mut self, rows: usize) {
        self.nulls.append_n_nulls(rows);
        self.offsets.resize(self.offsets.len() + rows, self.items.len() as i32);
    }

    /// Ends the items of a row; `there` is false for null.
    #[inline(always)]
    fn end_row(&mut self, there: bool) {
        self.offsets.push(self.items.len() as i32);
        self.nulls.append(there);
    }
}

/// Takes many rows without a value at once, as `CellSink` takes each of them.
pub(super) trait TakeNothing {
    /// Appends so many rows without a value.
    fn take_nothing(&mut self, rows: usize);
}

macro_rules! take_nothing {
    ($($kind:ty: $nulls:ident),*) => {$(
        impl TakeNothing for ColumnBuilder<$kind> {
            fn take_nothing(&mut self, rows: usize) {
                self.$nulls(rows);
            }
        }
    )*};
}

take_nothing!(i64: push_nulls, f64: push_nulls, bool: push_nulls, u8: end_nulls, i32: end_nulls);

/// A list of texts is empty rather than null.
impl TakeNothing for ColumnBuilder<&'static str> {
    fn take_nothing(&mut self, rows: usize) {
        (0..rows).for_each(|_| self.end_row(true));
    }
}

impl CellSink for ColumnBuilder<i64> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        self.push_value(match *ManuallyDrop::new(cell) {
            Cell::Int(n) | Cell::Time(n) => Some(n),
            _ => None,
        });
    }
}

impl CellSink for ColumnBuilder<f64> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        self.push_value(match *ManuallyDrop::new(cell) {
            Cell::Us(ns) => Some(ns as f64 / 1000.0),
            Cell::Float(value) => Some(value),
            Cell::Int(n) | Cell::Time(n) => Some(n as f64),
            _ => None,
        });
    }
}

impl CellSink for ColumnBuilder<bool> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        self.push_value(if let Cell::Bool(yes) = *ManuallyDrop::new(cell) { Some(yes) } else { None });
    }
}

impl CellSink for ColumnBuilder<u8> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        let cell = ManuallyDrop::new(cell);
        match *cell {
            Cell::Null => return self.end_row(false),
            Cell::Word(text) | Cell::Text(text) => push_short(text.as_bytes(), &mut self.items),
            Cell::Hex(bytes) => push_hex(bytes, &mut self.items),
            Cell::Source(file, place, number) => push_source(file, place, number, &mut self.items),
            _ => push_plain(&ManuallyDrop::into_inner(cell), &mut self.items),
        }
        self.end_row(true);
    }
}

/// Lists of numbers. The kind of list is examined once per list, not per number.
impl CellSink for ColumnBuilder<i32> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        let Cell::Ints(items) = *ManuallyDrop::new(cell) else { return self.end_row(false) };
        match items {
            Items::Words(bytes) => {
                self.items.extend(bytes.chunks_exact(2).map(|word| i32::from(u16::from_be_bytes([word[0], word[1]]))));
            }
            Items::Bits(bytes, _) => {
                let (start, count) = (self.items.len(), items.len());
                for byte in &bytes[..count.div_ceil(8)] {
                    self.items.extend_from_slice(&BITS_OF[usize::from(*byte)]);
                }
                self.items.truncate(start + count);
            }
            items => self.items.extend((0..items.len()).map(|i| items.get(i))),
        }
        self.end_row(true);
    }
}

impl CellSink for ColumnBuilder<&'static str> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        if let Cell::Codes(codes) = *ManuallyDrop::new(cell) {
            self.items.extend(codes.iter().map(|code| code.doc().code));
        }
        self.end_row(true);
    }
}

/// The bits of each byte, the lowest first.
static BITS_OF: [[i32; 8]; 256] = {
    let mut all = [[0; 8]; 256];
    let mut at = 0;
    while at < 8 * 256 {
        all[at / 8][at % 8] = ((at / 8) >> (at % 8)) as i32 & 1;
        at += 1;
    }
    all
};
