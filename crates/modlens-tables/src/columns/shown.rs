//! What stands in the columns, each kind a type of its own, so that a reader of a column says which kind it gives.
//!
//! A writer that takes a `Cell` apart as soon as it gets one costs nothing then: the compiler sees which arm is meant.
//! What may be missing is asked for first; a `Cell` that may be one thing or the other would have to be made.
#![allow(clippy::inline_always)]

use crate::columns::{Cell, Items, Put};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::Row;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;

/// A value that a column gives.
pub(super) trait Shown<'a>: Sized {
    /// As any of them.
    fn cell(self) -> Cell<'a>;

    /// Passes it on.
    #[inline(always)]
    fn pass<S: Put>(self, to: &mut S) {
        to.put(self.cell());
    }
}

impl<'a, T: Shown<'a>> Shown<'a> for Option<T> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        self.map_or(Cell::Null, T::cell)
    }

    #[inline(always)]
    fn pass<S: Put>(self, to: &mut S) {
        match self {
            Some(value) => value.pass(to),
            None => to.put(Cell::Null),
        }
    }
}

impl<'a> Shown<'a> for Cell<'a> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        self
    }
}

/// A function by the name of its row.
pub(super) struct Name<'a>(pub(super) &'a Row);

impl<'a> Shown<'a> for Name<'a> {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        Cell::Text(&self.0.name)
    }

    #[inline(always)]
    fn pass<S: Put>(self, to: &mut S) {
        if self.0.unquoted {
            to.put(Cell::Word(&self.0.name));
        } else {
            to.put(Cell::Text(&self.0.name));
        }
    }
}

macro_rules! shown {
    ($($name:ident$(<$life:lifetime>)?($($part:ident: $kind:ty),*) is $kind_of_cell:ident: $words:literal;)*) => {$(
        #[doc = $words]
        pub(super) struct $name$(<$life>)?($(pub(super) $kind),*);

        impl<'a> Shown<'a> for $name$(<$life>)? {
            #[inline(always)]
            fn cell(self) -> Cell<'a> {
                let Self($($part),*) = self;
                Cell::$kind_of_cell($($part),*)
            }
        }
    )*};
}

shown! {
    Us(ns: Ns) is Us: "A duration.";
    Time(ns: Ns) is Time: "A time.";
    Word<'a>(text: &'a str) is Word: "A word of ours.";
    Text<'a>(text: &'a str) is Text: "Text from outside.";
    Hex<'a>(bytes: &'a [u8]) is Hex: "Bytes.";
    Ints<'a>(items: Items<'a>) is Ints: "Numbers.";
    Codes<'a>(codes: &'a [Finding]) is Codes: "Codes of findings.";
    Source<'a>(file: &'a str, place: Place, number: u64) is Source: "Where it stands.";
}

macro_rules! numbers {
    ($($kind:ty),*) => {$(
        impl<'a> Shown<'a> for $kind {
            #[inline(always)]
            fn cell(self) -> Cell<'a> {
                Cell::Int(self as i64)
            }
        }
    )*};
}

numbers!(u8, u16, u32, u64);

impl<'a> Shown<'a> for bool {
    #[inline(always)]
    fn cell(self) -> Cell<'a> {
        Cell::Bool(self)
    }
}
