//! The receiver of the values of columns.

use crate::columns::cell::Cell;

/// Receives the values of columns: implemented by every writer.
pub trait CellSink {
    /// Takes one value. Each caller passes a known variant of `Cell`, so an implementation should be inlined: its
    /// `match` is then reduced to one arm.
    fn put_cell(&mut self, cell: Cell<'_>);
}
