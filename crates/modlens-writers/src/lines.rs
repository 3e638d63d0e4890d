//! Writes tables in text formats with one row per line: the columns of each row, one after the other. What all rows of
//! a bus share, or all readings of a block, is formatted once and copied.

use std::ops::Range;
use std::slice;

use modlens_protocol::decimal::push_short;
use modlens_tables::columns::{ColumnReader, RowRef, SharedByRows, Table, TableKind, TableRow};

use crate::exchange_lines::ExchangeLines;
use crate::line_format::LineFormat;
use crate::text_block::TextBlock;

/// One column, or adjacent columns with values that all rows of a group share (`RowRef::group`).
enum ColumnGroup<F> {
    /// The index of a column whose value differs from row to row.
    Own(usize, ColumnReader<F>),
    /// Columns that have the same values in all rows of a group, and their text for the current one.
    Shared(Vec<(usize, ColumnReader<F>)>, Vec<u8>),
}

/// Writes rows of one table as lines, batch by batch.
pub struct LineWriter<F> {
    kind: TableKind,
    columns: Vec<usize>,
    /// What the rows before shared, to which the texts that are kept belong.
    shared: Option<SharedByRows>,
    format: F,
    steps: Vec<ColumnGroup<F>>,
    /// The group to which the kept texts of `steps` belong.
    group: Option<u32>,
    exchange_lines: ExchangeLines<F>,
}

impl<F: LineFormat> LineWriter<F> {
    /// A writer for these columns of a table.
    pub fn new(kind: TableKind, columns: &[usize]) -> Self {
        let keys: Vec<&str> = columns.iter().map(|&column| kind.columns()[column].key.as_str()).collect();
        let mut format = F::default();
        format.columns(&keys);
        let mut steps: Vec<ColumnGroup<F>> = Vec::with_capacity(columns.len());
        for (at, &column) in columns.iter().enumerate() {
            let reader = kind.reader(column);
            match (steps.last_mut(), kind.is_constant_per_group(column)) {
                (Some(ColumnGroup::Shared(shared, _)), true) => shared.push((at, reader)),
                (_, true) => steps.push(ColumnGroup::Shared(vec![(at, reader)], Vec::new())),
                _ => steps.push(ColumnGroup::Own(at, reader)),
            }
        }
        let exchange_lines = ExchangeLines::new(columns);
        Self { kind, columns: columns.to_vec(), shared: None, format, steps, group: None, exchange_lines }
    }

    /// Appends rows until the block is full. Returns the next row to be written.
    pub fn rows(&mut self, table: &Table, rows: Range<usize>, block: &mut TextBlock) -> usize {
        self.keep_or_forget(table);
        // What readings share is numbered in each batch again.
        self.group = self.group.filter(|_| self.kind != TableKind::Readings);
        table.each_row(rows, |row| {
            match row {
                TableRow::Compact(exchange) if self.exchange_lines.push(table, exchange, &mut self.format, block).is_some() => {}
                row => row.with_whole(|row| self.row(row, block)),
            }
            !block.is_full()
        })
    }

    /// Appends all rows.
    pub(crate) fn all(&mut self, table: &Table, out: &mut Vec<u8>) {
        let (mut block, mut next) = (TextBlock::default(), 0);
        while next < table.len() {
            block.clear();
            next = self.rows(table, next..table.len(), &mut block);
            out.extend_from_slice(block.text());
        }
    }

    /// Begins again where the rows of a table share something other than those before: only then may the texts that are kept be
    /// others.
    fn keep_or_forget(&mut self, table: &Table) {
        if !self.shared.as_ref().is_some_and(|shared| shared.is_shared_by(table)) {
            *self = Self { shared: Some(SharedByRows::of(table)), ..Self::new(self.kind, &self.columns) };
        }
    }

    /// Appends one row.
    fn row(&mut self, row: &RowRef<'_>, block: &mut TextBlock) {
        if row.group() != self.group {
            self.change_group(row);
        }
        let format = &mut self.format;
        format.out().clear();
        for step in &self.steps {
            match step {
                ColumnGroup::Own(at, reader) => {
                    format.column(*at);
                    row.emit(reader, format);
                    format.end_value();
                }
                ColumnGroup::Shared(_, text) => push_short(text, format.out()),
            }
        }
        F::complete(slice::from_mut(format.out()));
        block.append(format.out());
    }

    /// Formats the shared columns again for the group of this row.
    #[inline(never)]
    fn change_group(&mut self, row: &RowRef<'_>) {
        self.group = row.group();
        for step in &mut self.steps {
            let ColumnGroup::Shared(columns, text) = step else { continue };
            self.format.out().clear();
            for (at, reader) in columns.iter() {
                self.format.column(*at);
                row.emit(reader, &mut self.format);
                self.format.end_value();
            }
            text.clone_from(self.format.out());
        }
    }
}
