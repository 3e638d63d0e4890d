//! The values of columns, with a type for each variant of `Cell`, so that the variant is known when the reader of a
//! column is compiled for a writer.
//!
//! `pass` is inlined, so the writer's `match` on `Cell` is reduced to one arm and no `Cell` is built in memory. That is
//! why an `Option` is branched on before a `Cell` is created: otherwise the variant would be known only at run time.
#![allow(clippy::inline_always)]

use crate::columns::cell::{Cell, Items};
use crate::columns::sink::CellSink;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::FunctionRow;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;

/// A value that a column has.
pub(super) trait ColumnValue<'a>: Sized {
    /// The value as a `Cell`.
    fn cell(self) -> Cell<'a>;

    /// Passes the value to a writer.
    #[inline(always)]
    fn emit<S: CellSink>(self, to: &mut S) {
        to.put_cell(self.cell());
    }
}

impl<'a, T: ColumnValue<'a>> ColumnValue<'a> for Option<T> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        self.map_or(Cell::Null, T::cell)
    }

    #[inline(always)]
    fn emit<S: CellSink>(self, to: &mut S) {
        match self {
            Some(value) => value.emit(to),
            None => to.put_cell(Cell::Null),
        }
    }
}

impl<'a> ColumnValue<'a> for Cell<'a> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        self
    }
}

/// The name of a function, which only some formats have to quote.
pub(super) struct FunctionName<'a>(pub(super) &'a FunctionRow);

impl<'a> ColumnValue<'a> for FunctionName<'a> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        Cell::Text(&self.0.name)
    }

    #[inline(always)]
    fn emit<S: CellSink>(self, to: &mut S) {
        if self.0.needs_no_quoting {
            to.put_cell(Cell::Word(&self.0.name));
        } else {
            to.put_cell(Cell::Text(&self.0.name));
        }
    }
}

macro_rules! shown {
    ($($name:ident$(<$life:lifetime>)?($($part:ident: $kind:ty),*) is $kind_of_cell:ident: $words:literal;)*) => {$(
        #[doc = $words]
        pub(super) struct $name$(<$life>)?($(pub(super) $kind),*);

        impl<'a> ColumnValue<'a> for $name$(<$life>)? {
            #[inline(always)]
            fn cell(self) -> Cell<'a> {
                let Self($($part),*) = self;
                Cell::$kind_of_cell($($part),*)
            }
        }
    )*};
}

shown! {
    Us(ns: Ns) is Us: "A duration in ns.";
    Time(ns: Ns) is Time: "A time in ns since 1970.";
    Word<'a>(text: &'a str) is Word: "Text from the fixed vocabulary of modlens.";
    Text<'a>(text: &'a str) is Text: "Text from the input.";
    Hex<'a>(bytes: &'a [u8]) is Hex: "Bytes, shown as hex.";
    Ints<'a>(items: Items<'a>) is Ints: "A list of numbers.";
    Codes<'a>(codes: &'a [Finding]) is Codes: "Finding codes.";
    Source<'a>(file: &'a str, place: Place, number: u64) is Source: "The position in the input.";
}

macro_rules! numbers {
    ($($kind:ty),*) => {$(
        impl<'a> ColumnValue<'a> for $kind {
            #[inline(always)]
            fn cell(self) -> Cell<'a> {
                Cell::Int(self as i64)
            }
        }
    )*};
}

numbers!(u8, u16, u32, u64);

impl<'a> ColumnValue<'a> for bool {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        Cell::Bool(self)
    }
}
