//! Rows as lines of CSV or JSON, in blocks.

use std::cell::RefCell;
use std::mem::take;
use std::sync::{Arc, Mutex, PoisonError};

use modlens_tables::columns::{Table as Core, TableKind};
use modlens_writers::csv::{self, Csv};
use modlens_writers::jsonl::Jsonl;
use modlens_writers::{LineWriter, TextBlock};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;

thread_local! {
    /// Memory in which bytes are made. It is reused, because allocating it costs more than writing the text.
    static SCRATCH: RefCell<Vec<u8>> = RefCell::default();

    /// The same for blocks of lines.
    static BLOCK: RefCell<Option<TextBlock>> = const { RefCell::new(None) };
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
enum Writer {
    Csv(Box<LineWriter<Csv>>),
    Jsonl(Box<LineWriter<Jsonl>>),
}

/// Makes lines of rows of a table, batch by batch.
pub(crate) struct Encoder {
    /// The table whose rows it takes.
    pub(crate) kind: TableKind,
    columns: Vec<usize>,
    is_csv: bool,
    /// The names of the columns, as they are in front of the rows.
    header: Vec<u8>,
    /// Writers that nobody uses. They keep texts from one batch to the next.
    free: Arc<Mutex<Vec<Writer>>>,
}

impl Encoder {
    /// For this format and these columns of a table.
    pub(crate) fn new(format: &str, kind: TableKind, keys: &[String]) -> PyResult<Self> {
        let is_csv = match format {
            "csv" => true,
            "jsonl" => false,
            other => return Err(value_error(format!("format {other:?} is neither csv nor jsonl"))),
        };
        let columns = keys.iter().map(|key| kind.column(key)).collect::<Result<_, _>>().map_err(value_error)?;
        let mut header = Vec::new();
        if is_csv {
            csv::header(&keys.iter().map(String::as_str).collect::<Vec<_>>(), &mut header);
        }
        Ok(Self { kind, columns, is_csv, header, free: Arc::default() })
    }

    /// The lines of a table. `header` puts the names of the columns in front, if the format is CSV.
    pub(crate) fn pieces(&self, table: &Core, header: bool) -> Pieces {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let writer = free.unwrap_or_else(|| {
            if self.is_csv {
                Writer::Csv(Box::new(LineWriter::new(self.kind, &self.columns)))
            } else {
                Writer::Jsonl(Box::new(LineWriter::new(self.kind, &self.columns)))
            }
        });
        let header = if header { self.header.clone() } else { Vec::new() };
        Pieces { table: table.clone(), writer: Some(writer), free: Arc::clone(&self.free), header, next: 0 }
    }
}

/// The lines of a table's rows, a block at a time.
#[pyclass(module = "_modlens")]
pub struct Pieces {
    table: Core,
    /// Until it is given back.
    writer: Option<Writer>,
    free: Arc<Mutex<Vec<Writer>>>,
    header: Vec<u8>,
    next: usize,
}

impl Pieces {
    /// Whether there is text left.
    pub(crate) fn has_more(&self) -> bool {
        !self.header.is_empty() || self.next < self.table.len()
    }

    /// Appends lines until the block is full, or there are no more.
    pub(crate) fn fill(&mut self, block: &mut TextBlock) {
        block.append(&take(&mut self.header));
        let (table, rows) = (&self.table, self.next..self.table.len());
        self.next = match &mut self.writer {
            Some(Writer::Csv(lines)) => lines.rows(table, rows, block),
            Some(Writer::Jsonl(lines)) => lines.rows(table, rows, block),
            None => rows.end,
        };
    }
}

impl Drop for Pieces {
    fn drop(&mut self) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).extend(self.writer.take());
    }
}

#[pymethods]
impl Pieces {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> Option<Bound<'py, PyBytes>> {
        self.has_more().then(|| {
            let mut block = BLOCK.take().unwrap_or_default();
            py.detach(|| self.fill(&mut block));
            let bytes = PyBytes::new(py, block.text());
            block.clear();
            BLOCK.set(Some(block));
            bytes
        })
    }
}
