//! Writes tables in text formats with one row per line: the columns of each row, one after the other. What all rows of
//! a bus share, or all readings of a block, is formatted once and copied.

use std::ops::Range;

use modlens_protocol::decimal::push_short;
use modlens_tables::columns::{ColumnReader, RowRef, Table, TableRow};

use crate::exchange_lines::ExchangeLines;
use crate::line_format::LineFormat;

/// One column, or adjacent columns with values that all rows of a group share (`RowRef::group`).
enum ColumnGroup<F> {
    /// The index of a column whose value differs from row to row.
    Own(usize, ColumnReader<F>),
    /// Columns that have the same values in all rows of a group, and their text for the current one.
    Shared(Vec<(usize, ColumnReader<F>)>, Vec<u8>),
}

/// Writes rows of one table as lines.
pub struct LineWriter<F> {
    format: F,
    steps: Vec<ColumnGroup<F>>,
    /// The group to which the kept texts belong.
    group: Option<u32>,
    exchange_lines: ExchangeLines<F>,
}

impl<F: LineFormat> LineWriter<F> {
    /// A writer for these columns of a table, to be used for one batch only: the next batch may number its groups
    /// differently.
    pub fn new(table: &Table, columns: &[usize]) -> Self {
        let keys: Vec<&str> = columns.iter().map(|&column| table.kind.columns()[column].key.as_str()).collect();
        let mut format = F::default();
        format.columns(&keys);
        let mut steps: Vec<ColumnGroup<F>> = Vec::with_capacity(columns.len());
        for (at, &column) in columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            match (steps.last_mut(), table.kind.is_constant_per_group(column)) {
                (Some(ColumnGroup::Shared(shared, _)), true) => shared.push((at, reader)),
                (_, true) => steps.push(ColumnGroup::Shared(vec![(at, reader)], Vec::new())),
                _ => steps.push(ColumnGroup::Own(at, reader)),
            }
        }
        Self { format, steps, group: None, exchange_lines: ExchangeLines::new(columns) }
    }

    /// Appends rows until `out` holds `enough` bytes. Returns the next row to be written.
    pub fn rows(&mut self, table: &Table, rows: Range<usize>, enough: usize, out: &mut Vec<u8>) -> usize {
        std::mem::swap(self.format.out(), out);
        let next = table.each_row(rows, |row| {
            match row {
                TableRow::Whole(row) => self.row(row),
                TableRow::Compact(exchange) => self.exchange_lines.push(table, exchange, &mut self.format),
            }
            self.format.out().len() < enough
        });
        std::mem::swap(self.format.out(), out);
        next
    }

    /// Appends one row.
    #[inline]
    fn row(&mut self, row: &RowRef<'_>) {
        if row.group() != self.group {
            self.change_group(row);
        }
        let format = &mut self.format;
        format.begin();
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
        format.end();
    }

    /// Formats the shared columns anew for the group of this row.
    #[inline(never)]
    fn change_group(&mut self, row: &RowRef<'_>) {
        self.group = row.group();
        for step in &mut self.steps {
            let ColumnGroup::Shared(columns, text) = step else { continue };
            let start = self.format.out().len();
            for (at, reader) in columns.iter() {
                self.format.column(*at);
                row.emit(reader, &mut self.format);
                self.format.end_value();
            }
            text.clear();
            text.extend_from_slice(&self.format.out()[start..]);
            self.format.out().truncate(start);
        }
    }
}
