//! Writes tables in text formats with one row per line: the columns of each row, one after the other. What all rows of
//! a bus share is formatted once and copied.

use std::ops::Range;

use modlens_protocol::decimal::push_short;
use modlens_tables::columns::{CellSink, ColumnReader, RowRef, Table};

/// A text format: writes the values of a line.
pub trait LineFormat: CellSink + Default + 'static {
    /// Tells the format the names of the columns, before the first line.
    fn columns(&mut self, keys: &[&str]);

    /// The output. A writer exchanges its own buffer for this one, so that the format does not need to borrow it.
    fn out(&mut self) -> &mut Vec<u8>;

    /// Announces the column (by index) of the next value.
    fn column(&mut self, at: usize);

    /// Ends a value.
    fn end_value(&mut self);

    /// Begins a line.
    fn begin(&mut self);

    /// Ends a line.
    fn end(&mut self);
}

/// Remembers whether the name of the input file needs quoting or escaping. It is mostly the same as in the row before.
#[derive(Default)]
pub struct FileNameCheck {
    /// Address and length of the name last checked, and whether it needs neither quotes nor escapes.
    known: Option<(usize, usize, bool)>,
}

impl FileNameCheck {
    /// Whether the name contains nothing that `special` reports.
    #[inline]
    pub fn plain(&mut self, file: &str, special: fn(&[u8]) -> bool) -> bool {
        let (at, length) = (file.as_ptr() as usize, file.len());
        match self.known {
            Some((known, size, is_plain)) if (known, size) == (at, length) => is_plain,
            _ => {
                let is_plain = !special(file.as_bytes());
                self.known = Some((at, length, is_plain));
                is_plain
            }
        }
    }
}

/// One column, or adjacent columns with values that all rows of a bus share.
enum ColumnGroup<F> {
    /// The index of a column whose value differs from row to row, and whether exchanges in short have one.
    Own(usize, ColumnReader<F>, bool),
    /// Columns that have the same values in all rows of a bus, and their text for the current bus.
    Shared(Vec<(usize, ColumnReader<F>)>, Vec<u8>),
}

/// Writes rows of one table as lines.
pub struct LineWriter<F> {
    format: F,
    steps: Vec<ColumnGroup<F>>,
    /// The bus to which the kept texts belong.
    bus: Option<u32>,
}

impl<F: LineFormat> LineWriter<F> {
    /// A writer for these columns of a table, to be used for one batch only: the next batch may number its buses
    /// differently.
    pub fn new(table: &Table, columns: &[usize]) -> Self {
        let keys: Vec<&str> = columns.iter().map(|&column| table.kind.columns()[column].key.as_str()).collect();
        let mut format = F::default();
        format.columns(&keys);
        let mut steps: Vec<ColumnGroup<F>> = Vec::with_capacity(columns.len());
        for (at, &column) in columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            match (steps.last_mut(), table.kind.is_constant_per_bus(column)) {
                (Some(ColumnGroup::Shared(shared, _)), true) => shared.push((at, reader)),
                (_, true) => steps.push(ColumnGroup::Shared(vec![(at, reader)], Vec::new())),
                _ => steps.push(ColumnGroup::Own(at, reader, table.has_value_in_short(column))),
            }
        }
        Self { format, steps, bus: None }
    }

    /// Appends rows until `out` holds `enough` bytes. Returns the next row to be written.
    pub fn rows(&mut self, table: &Table, rows: Range<usize>, enough: usize, out: &mut Vec<u8>) -> usize {
        std::mem::swap(self.format.out(), out);
        let next = table.each_row(rows, |row, is_short| {
            self.row(row, is_short);
            self.format.out().len() < enough
        });
        std::mem::swap(self.format.out(), out);
        next
    }

    /// Appends one row, which may be an exchange in short.
    #[inline]
    fn row(&mut self, row: &RowRef<'_>, is_short: bool) {
        if row.bus() != self.bus {
            self.change_bus(row);
        }
        let format = &mut self.format;
        format.begin();
        for step in &self.steps {
            match step {
                ColumnGroup::Own(_, _, false) if is_short => format.end_value(),
                ColumnGroup::Own(at, reader, _) => {
                    format.column(*at);
                    row.emit(reader, format);
                    format.end_value();
                }
                ColumnGroup::Shared(_, text) => push_short(text, format.out()),
            }
        }
        format.end();
    }

    /// Formats the shared columns anew for the bus of this row.
    #[cold]
    fn change_bus(&mut self, row: &RowRef<'_>) {
        self.bus = row.bus();
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
