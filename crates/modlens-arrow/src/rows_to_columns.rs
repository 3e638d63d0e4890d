//! Rows of tables, as the columns take them.

use std::ops::Range;

use crate::column_values::HasRows;
use crate::kinds::Kinds;
use modlens_tables::columns::{ExchangeChunk, ExchangeRef, RowChunk, SharedByRows, Table};

/// Gives rows of tables to columns, which are always the same ones.
#[derive(Default)]
pub(super) struct RowsToColumns {
    kinds: Kinds,
    /// What was shared by the rows whose kinds are known.
    shared: Option<SharedByRows>,
}

impl RowsToColumns {
    /// Appends rows of a table to the columns.
    pub(super) fn add<C: HasRows + ?Sized>(&mut self, table: &Table, rows: Range<usize>, columns: &mut [Box<C>]) {
        if !self.shared.as_ref().is_some_and(|shared| shared.is_shared_by(table)) {
            self.shared = Some(SharedByRows::of(table));
            self.kinds.clear();
            for column in columns.iter_mut() {
                column.rows().forget_kinds();
            }
        }
        table.each_chunk(rows, |rows| match rows {
            RowChunk::Whole(rows) => columns.iter_mut().for_each(|column| column.rows().take(rows)),
            RowChunk::Compact(exchanges) => self.add_exchanges(&exchanges, columns),
        });
    }

    fn add_exchanges<C: HasRows + ?Sized>(&mut self, exchanges: &ExchangeChunk<'_>, columns: &mut [Box<C>]) {
        let kinds = self.kinds.of(exchanges, |first| columns.iter_mut().for_each(|column| column.rows().learn(first)));
        let are_needed = columns.iter_mut().any(|column| column.rows().reads_each());
        let each: Vec<ExchangeRef<'_>> = if are_needed { exchanges.all().collect() } else { Vec::new() };
        for column in columns {
            column.rows().take_exchanges(exchanges, kinds, &each);
        }
    }
}
