//! Rows as lines of CSV or JSON, in blocks.

use std::cell::RefCell;

use modlens_tables::columns::Table as Core;
use modlens_writers::csv::{self, Csv};
use modlens_writers::jsonl::Jsonl;
use modlens_writers::lines::LineWriter;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;

/// A block ends with the row that makes it longer than this. Blocks of this size stay in the processor's cache until they
/// are written, and their memory is reused: that of larger ones, malloc gives back to the system, which clears it each time. A
/// file takes smaller ones more slowly, a third in blocks of half the size.
pub const BLOCK_BYTES: usize = 1 << 17;

thread_local! {
    /// Memory in which blocks are made. It is reused, because allocating it costs more than writing the text.
    static SCRATCH: RefCell<Vec<u8>> = RefCell::default();
}

/// Calls `fill` with an empty buffer, without the lock of the interpreter, and returns a copy of its content as `bytes`.
pub fn as_bytes(py: Python<'_>, fill: impl FnOnce(&mut Vec<u8>) + Send) -> Bound<'_, PyBytes> {
    let mut out = SCRATCH.take();
    py.detach(|| fill(&mut out));
    let bytes = PyBytes::new(py, &out);
    out.clear();
    SCRATCH.set(out);
    bytes
}

/// The writer of one format.
enum Format {
    Csv(LineWriter<Csv>),
    Jsonl(LineWriter<Jsonl>),
}

/// The lines of a table's rows, a block at a time.
#[pyclass(module = "_modlens")]
pub struct Pieces {
    table: Core,
    format: Format,
    header: Vec<u8>,
    next: usize,
}

impl Pieces {
    /// The lines of a table with these columns. `header` puts the names of the columns in front, if the format is CSV.
    pub fn new(table: &Core, format: &str, columns: &[String], header: bool) -> PyResult<Self> {
        let columns_by_index: Vec<usize> =
            columns.iter().map(|key| table.kind.column(key)).collect::<Result<_, _>>().map_err(value_error)?;
        let mut names = Vec::new();
        let format = match format {
            "csv" => {
                if header {
                    csv::header(&columns.iter().map(String::as_str).collect::<Vec<_>>(), &mut names);
                }
                Format::Csv(LineWriter::new(table, &columns_by_index))
            }
            "jsonl" => Format::Jsonl(LineWriter::new(table, &columns_by_index)),
            other => return Err(value_error(format!("format {other:?} is neither csv nor jsonl"))),
        };
        Ok(Self { table: table.clone(), format, header: names, next: 0 })
    }

    fn fill(&mut self, out: &mut Vec<u8>) {
        out.append(&mut self.header);
        let (table, rows) = (&self.table, self.next..self.table.len());
        self.next = match &mut self.format {
            Format::Csv(lines) => lines.rows(table, rows, BLOCK_BYTES, out),
            Format::Jsonl(lines) => lines.rows(table, rows, BLOCK_BYTES, out),
        };
    }
}

#[pymethods]
impl Pieces {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        let more = !self.header.is_empty() || self.next < self.table.len();
        more.then(|| as_bytes(py, |out| self.fill(out)))
    }
}
