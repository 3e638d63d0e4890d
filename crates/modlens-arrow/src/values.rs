//! Builds the arrays of a column, in the form that Arrow and Parquet need.
#![allow(clippy::inline_always)]
// Reduces the match of each `put` to one arm in each caller.

use std::mem::ManuallyDrop;

use arrow_buffer::Buffer;

use crate::validity::Validity;
use modlens_protocol::decimal::push_short;
use modlens_protocol::hex::push_hex;
use modlens_tables::cell_text::{push_plain, push_source};
use modlens_tables::columns::{Cell, CellSink, ColumnReader, Items, ReadData, RowRef};

/// The values of a column: items, offsets and which rows have one.
pub(super) struct ColumnBuilder<T> {
    /// The values; for lists and texts, the items of all rows one after the other. A row without a value has a default
    /// value here.
    pub(super) items: Vec<T>,
    pub(super) validity: Validity,
    /// For lists and texts: a zero, then the end of each row's items.
    pub(super) offsets: Vec<i32>,
    /// Rows without a value after the others, which are not in the vectors yet: many columns never have one.
    nothing: usize,
}

/// What the values of a column are made of.
pub(super) trait Item: Clone + Default {
    /// Whether a row has any number of items, for which there are offsets, or one.
    const MANY: bool;
    /// Whether a row without a value has an empty list: a list of texts is empty rather than null.
    const EMPTY: bool = false;

    /// The memory of a buffer of such items that nobody else reads; `None` if somebody does, or buffers are made otherwise.
    fn vector_of(_: Buffer) -> Option<Vec<Self>> {
        None
    }
}

macro_rules! items {
    ($($kind:ty: $many:literal),*) => {$(
        impl Item for $kind {
            const MANY: bool = $many;

            fn vector_of(buffer: Buffer) -> Option<Vec<Self>> {
                buffer.into_vec().ok()
            }
        }
    )*};
}

items!(i64: false, f64: false, u8: true, i32: true);

impl Item for bool {
    const MANY: bool = false;
}

impl Item for &'static str {
    const MANY: bool = true;
    const EMPTY: bool = true;
}

impl<T: Item> ColumnBuilder<T> {
    /// With room for so many rows and so many items.
    pub(super) fn with_capacity(rows: usize, items: usize) -> Self {
        let mut offsets = Vec::new();
        if T::MANY {
            offsets.reserve(rows + 1);
            offsets.push(0);
        }
        Self { items: Vec::with_capacity(items), validity: Validity::with_capacity(rows), offsets, nothing: 0 }
    }

    /// A column without rows, with room for as much as this one has, and a bit more; for its items in the memory of earlier
    /// ones, if there is some.
    pub(super) fn next(&self, given: Option<Vec<T>>) -> Self {
        if self.rows_of_nothing().is_some() {
            return Self::with_capacity(0, 0);
        }
        let with_room = |count: usize| count + count / 8;
        let mut next = Self::with_capacity(with_room(self.rows()), 0);
        next.items = given.unwrap_or_default();
        next.items.reserve(with_room(self.items.len()));
        next
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

    /// Appends so many rows without a value.
    #[inline(always)]
    pub(super) fn push_nothing(&mut self, rows: usize) {
        self.nothing += rows;
    }

    /// Appends the items of rows of another column, as if all of them had a value.
    pub(super) fn push_items(&mut self, of: &Self, rows: &[u32]) {
        if !T::MANY {
            return self.items.extend(rows.iter().map(|&row| of.items[row as usize].clone()));
        }
        for &row in rows {
            let range = of.offsets[row as usize] as usize..of.offsets[row as usize + 1] as usize;
            self.items.extend_from_slice(&of.items[range]);
            self.offsets.push(self.items.len() as i32);
        }
    }

    /// Adds the rows without a value to the others.
    #[inline(always)]
    pub(super) fn add_nothing(&mut self) {
        if self.nothing > 0 {
            self.add_rows_without_value();
        }
    }

    #[inline(never)]
    fn add_rows_without_value(&mut self) {
        let rows = std::mem::take(&mut self.nothing);
        if T::EMPTY {
            self.validity.push_values(rows);
        } else {
            self.validity.push_nothing(rows);
        }
        if T::MANY {
            self.offsets.resize(self.offsets.len() + rows, self.items.len() as i32);
        } else {
            self.items.resize(self.items.len() + rows, T::default());
        }
    }

    /// How many rows there are.
    pub(super) fn rows(&self) -> usize {
        self.nothing + if T::MANY { self.offsets.len() - 1 } else { self.items.len() }
    }

    /// Whether the last row has no value, and has not been added to the others yet.
    pub(super) fn ends_with_nothing(&self) -> bool {
        self.nothing > 0
    }

    /// How many rows there are, if none of them has a value.
    pub(super) fn rows_of_nothing(&self) -> Option<usize> {
        (!T::EMPTY && self.rows() == self.nothing).then_some(self.nothing)
    }

    /// Appends a value of fixed size, or null.
    #[inline(always)]
    fn push_value(&mut self, value: Option<T>) {
        let Some(value) = value else { return self.push_nothing(1) };
        self.add_nothing();
        self.validity.push_values(1);
        self.items.push(value);
    }

    /// Ends the items of a row.
    #[inline(always)]
    pub(super) fn end_row(&mut self) {
        self.offsets.push(self.items.len() as i32);
        self.validity.push_values(1);
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
        if matches!(*cell, Cell::Null) {
            return self.push_nothing(1);
        }
        self.add_nothing();
        match *cell {
            Cell::Word(text) | Cell::Text(text) => push_short(text.as_bytes(), &mut self.items),
            Cell::Hex(bytes) => push_hex(bytes, &mut self.items),
            Cell::Source(file, place, number) => push_source(file, place, number, &mut self.items),
            _ => push_plain(&ManuallyDrop::into_inner(cell), &mut self.items),
        }
        self.end_row();
    }
}

/// Lists of numbers. The kind of list is examined once per list, not per number.
impl CellSink for ColumnBuilder<i32> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        let Cell::Ints(items) = *ManuallyDrop::new(cell) else { return self.push_nothing(1) };
        self.add_nothing();
        match items {
            Items::Words(bytes) => self.push_registers(bytes.len() / 2, bytes),
            Items::Bits(bytes, _) => self.push_bits(items.len(), bytes),
            items => self.items.extend((0..items.len()).map(|i| items.get(i))),
        }
        self.end_row();
    }
}

impl CellSink for ColumnBuilder<&'static str> {
    #[inline(always)]
    fn put_cell(&mut self, cell: Cell<'_>) {
        self.add_nothing();
        if let Cell::Codes(codes) = *ManuallyDrop::new(cell) {
            self.items.extend(codes.iter().map(|code| code.doc().code));
        }
        self.end_row();
    }
}

impl ColumnBuilder<i32> {
    /// Appends the items of what an exchange has read.
    #[inline(always)]
    pub(super) fn push_read(&mut self, read: Option<ReadData<'_>>) {
        match read {
            Some(ReadData { count, are_bits: false, from }) => self.push_registers(count, from),
            Some(ReadData { count, are_bits: true, from }) => self.push_bits(count, from),
            None => {}
        }
        self.offsets.push(self.items.len() as i32);
    }

    /// Appends so many registers of two bytes each. Eight are read at a time, as long as there are bytes, and those after the
    /// last are taken off again: a loop for the rest would cost more than all others.
    #[inline(always)]
    fn push_registers(&mut self, count: usize, from: &[u8]) {
        let end = self.items.len() + count;
        let mut eights = from.chunks_exact(16);
        while self.items.len() < end {
            let Some(eight) = eights.next() else {
                let rest = eights.remainder().chunks_exact(2).take(end - self.items.len());
                return self.items.extend(rest.map(|bytes| i32::from(u16::from_be_bytes([bytes[0], bytes[1]]))));
            };
            let register = |at: usize| i32::from(u16::from_be_bytes([eight[2 * at], eight[2 * at + 1]]));
            self.items.extend_from_slice(&std::array::from_fn::<i32, 8, _>(register));
        }
        self.items.truncate(end);
    }

    /// Appends so many bits. Room is made once for all of them, so that a byte is a copy of its eight.
    #[inline(always)]
    fn push_bits(&mut self, count: usize, from: &[u8]) {
        let end = self.items.len() + count;
        self.items.extend(from[..count.div_ceil(8)].iter().flat_map(|&byte| BITS_OF[usize::from(byte)]));
        self.items.truncate(end);
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
