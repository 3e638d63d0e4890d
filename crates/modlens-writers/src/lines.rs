//! What text formats with a row a line share: the columns as each of them reads them, row after row.

use std::ops::Range;

use modlens_protocol::decimal::push_short;
use modlens_tables::columns::{Put, Reader, RowRef, Table};

/// A format: how a value stands in its line.
pub trait Line: Put + Default + 'static {
    /// What the format has to know of its columns.
    fn columns(&mut self, keys: &[&str]);

    /// Where the lines go; whoever has a buffer lends it.
    fn out(&mut self) -> &mut Vec<u8>;

    /// The next value stands in this column.
    fn column(&mut self, at: usize);

    /// The value has been put: its end.
    fn end_value(&mut self);

    /// A line begins.
    fn begin(&mut self);

    /// And ends.
    fn end(&mut self);
}

/// The file that rows come from, which mostly is that of the row before.
#[derive(Default)]
pub struct Source {
    /// Where its name is in memory, and how long it is; whether it needs neither quotes nor escapes.
    known: Option<(usize, usize, bool)>,
}

impl Source {
    /// Whether the name of the file needs nothing of what `special` looks for.
    #[inline]
    pub fn plain(&mut self, file: &str, special: fn(&[u8]) -> bool) -> bool {
        let (at, length) = (file.as_ptr() as usize, file.len());
        match self.known {
            Some((known, size, plain)) if (known, size) == (at, length) => plain,
            _ => {
                let plain = !special(file.as_bytes());
                self.known = Some((at, length, plain));
                plain
            }
        }
    }
}

/// Columns that stand side by side.
enum Step<F> {
    /// One that every row has for itself.
    Own(usize, Reader<F>),
    /// Those whose values a row shares with all others of its bus: their text is kept.
    Shared(Vec<(usize, Reader<F>)>, Vec<u8>),
}

/// Writes rows of one table as lines.
pub struct Lines<F> {
    format: F,
    steps: Vec<Step<F>>,
    /// The bus that the kept texts are of.
    bus: Option<u32>,
}

impl<F: Line> Lines<F> {
    /// For these columns of a table, and for one batch only: the next one may number its buses in another way.
    pub fn new(table: &Table, columns: &[usize]) -> Self {
        let keys: Vec<&str> = columns.iter().map(|&column| table.kind.columns()[column].key.as_str()).collect();
        let mut format = F::default();
        format.columns(&keys);
        let mut steps: Vec<Step<F>> = Vec::with_capacity(columns.len());
        for (at, &column) in columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            match (steps.last_mut(), table.kind.of_the_bus(column)) {
                (Some(Step::Shared(shared, _)), true) => shared.push((at, reader)),
                (_, true) => steps.push(Step::Shared(vec![(at, reader)], Vec::new())),
                _ => steps.push(Step::Own(at, reader)),
            }
        }
        Self { format, steps, bus: None }
    }

    /// Appends rows until `out` holds so many bytes; gives the row that comes next.
    pub fn rows(&mut self, table: &Table, rows: Range<usize>, enough: usize, out: &mut Vec<u8>) -> usize {
        std::mem::swap(self.format.out(), out);
        let mut next = rows.start;
        while next < rows.end && self.format.out().len() < enough {
            self.row(&table.row(next));
            next += 1;
        }
        std::mem::swap(self.format.out(), out);
        next
    }

    #[inline]
    fn row(&mut self, row: &RowRef<'_>) {
        if row.bus() != self.bus {
            self.turn(row);
        }
        let format = &mut self.format;
        format.begin();
        for step in &self.steps {
            match step {
                Step::Own(at, reader) => {
                    format.column(*at);
                    row.pass(reader, format);
                    format.end_value();
                }
                Step::Shared(_, text) => push_short(text, format.out()),
            }
        }
        format.end();
    }

    /// A row of another bus: its texts are made.
    #[cold]
    fn turn(&mut self, row: &RowRef<'_>) {
        self.bus = row.bus();
        for step in &mut self.steps {
            let Step::Shared(columns, text) = step else { continue };
            let start = self.format.out().len();
            for (at, reader) in columns.iter() {
                self.format.column(*at);
                row.pass(reader, &mut self.format);
                self.format.end_value();
            }
            text.clear();
            text.extend_from_slice(&self.format.out()[start..]);
            self.format.out().truncate(start);
        }
    }
}
