//! Rows as lines of text, piece by piece.

use std::cell::RefCell;

use modlens_tables::columns::Table as Core;
use modlens_writers::csv::{self, Csv};
use modlens_writers::jsonl::Jsonl;
use modlens_writers::lines::LineWriter;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;

/// Bytes after which a piece ends with its row: it stays in the processor's cache until it is written, and its memory
/// is used again for the next one.
pub const PIECE: usize = 1 << 16;

thread_local! {
    /// What pieces are made in: fresh memory costs more than the text.
    static SCRATCH: RefCell<Vec<u8>> = RefCell::default();
}

/// Gives `fill` an empty buffer that is used again, and what is then in it to Python.
pub fn as_bytes(py: Python<'_>, fill: impl FnOnce(&mut Vec<u8>) + Send) -> Bound<'_, PyBytes> {
    let mut out = SCRATCH.take();
    py.detach(|| fill(&mut out));
    let bytes = PyBytes::new(py, &out);
    out.clear();
    SCRATCH.set(out);
    bytes
}

enum Format {
    Csv(LineWriter<Csv>),
    Jsonl(LineWriter<Jsonl>),
}

/// The lines of a table's rows, about 64 KiB at a time.
#[pyclass(module = "_modlens")]
pub struct Pieces {
    table: Core,
    format: Format,
    header: Vec<u8>,
    next: usize,
}

impl Pieces {
    /// For these columns; `header` puts their names in front, where the format has a place for them.
    pub fn new(table: &Core, format: &str, columns: &[String], header: bool) -> PyResult<Self> {
        let places: Vec<usize> =
            columns.iter().map(|key| table.kind.column(key)).collect::<Result<_, _>>().map_err(value_error)?;
        let mut names = Vec::new();
        let format = match format {
            "csv" => {
                if header {
                    csv::header(&columns.iter().map(String::as_str).collect::<Vec<_>>(), &mut names);
                }
                Format::Csv(LineWriter::new(table, &places))
            }
            "jsonl" => Format::Jsonl(LineWriter::new(table, &places)),
            other => return Err(value_error(format!("format {other:?} is neither csv nor jsonl"))),
        };
        Ok(Self { table: table.clone(), format, header: names, next: 0 })
    }

    fn fill(&mut self, out: &mut Vec<u8>) {
        out.append(&mut self.header);
        let (table, rows) = (&self.table, self.next..self.table.len());
        self.next = match &mut self.format {
            Format::Csv(lines) => lines.rows(table, rows, PIECE, out),
            Format::Jsonl(lines) => lines.rows(table, rows, PIECE, out),
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
