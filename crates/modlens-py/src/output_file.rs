//! Files that rows are written to. What is in them, under which name, and what becomes of them after an error is decided in Python.

use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind, Write};
use std::path::PathBuf;

use modlens_writers::TextBlock;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::arguments::value_error;
use crate::lines::Pieces;

/// In blocks of this size, each at a multiple of it, Linux takes a file fastest: no page of its cache is written twice, and eight are
/// as many in one block as it keeps ready. Larger ones it has to look for, which may be memory that nobody has used for long.
const PIECE_BYTES: usize = 1 << 15;

/// A file that is open for writing.
#[pyclass(module = "_modlens")]
pub struct OutputFile {
    /// Until it is closed.
    file: Option<File>,
    way: Way,
    /// Lines of a whole file that are not written yet.
    block: Option<TextBlock>,
}

/// How a file is written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    /// Nobody reads it before it is complete, so that its lines may be written in blocks of `PIECE_BYTES`.
    Whole,
    /// It is new, and whoever reads it finds whole rows at any time.
    Growing,
    /// A device, a pipe or the like.
    Special,
}

/// Why bytes were not written.
enum Failure {
    /// The system says so.
    System(Error),
    /// A signal that Python raises for.
    Signal(PyErr),
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::System(error) => os_error(&error),
            Failure::Signal(error) => error,
        }
    }
}

/// The `OSError` that Python's own functions raise for this.
fn os_error(error: &Error) -> PyErr {
    let text = error.to_string();
    let Some(code) = error.raw_os_error() else { return PyOSError::new_err(text) };
    let reason = text.strip_suffix(&format!(" (os error {code})")).unwrap_or(&text).to_owned();
    // The last one is the number on Windows, where it is of another kind; elsewhere nobody looks at it.
    PyOSError::new_err((code, reason, None::<String>, code))
}

/// Writes all bytes, while other threads may run. As with Python's own functions, a signal is handled before it goes on. With an error
/// comes the number of bytes that were written.
fn write_all(py: Python<'_>, file: &mut File, bytes: &[u8]) -> Result<(), (usize, Failure)> {
    let mut done = 0;
    while done < bytes.len() {
        match py.detach(|| file.write(&bytes[done..])) {
            Ok(0) => return Err((done, Failure::System(ErrorKind::WriteZero.into()))),
            Ok(count) => done += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {
                py.check_signals().map_err(|error| (done, Failure::Signal(error)))?;
            }
            Err(error) => return Err((done, Failure::System(error))),
        }
    }
    Ok(())
}

#[pymethods]
impl OutputFile {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, way: &str) -> PyResult<Self> {
        let mut options = OpenOptions::new();
        let way = match way {
            "whole" => (Way::Whole, options.write(true).create(true).truncate(true)).0,
            "growing" => (Way::Growing, options.append(true).create_new(true)).0,
            "special" => (Way::Special, options.write(true)).0,
            other => return Err(value_error(format!("{other:?} is neither whole, growing nor special"))),
        };
        loop {
            // A named pipe waits for its reader.
            match py.detach(|| options.open(&path)) {
                Ok(file) => return Ok(Self { file: Some(file), way, block: None }),
                Err(error) if error.kind() == ErrorKind::Interrupted => py.check_signals()?,
                Err(error) => return Err(os_error(&error)),
            }
        }
    }

    fn append(&mut self, py: Python<'_>, data: &[u8]) -> PyResult<()> {
        self.write_collected(py)?;
        self.write(py, data)
    }

    fn append_lines(&mut self, py: Python<'_>, mut lines: PyRefMut<'_, Pieces>) -> PyResult<()> {
        let lines: &mut Pieces = &mut lines;
        let mut block = self.block.take().unwrap_or_default();
        while lines.has_more() {
            py.detach(|| lines.fill(&mut block));
            let length = block.text().len();
            let ready = if self.way == Way::Whole { length / PIECE_BYTES * PIECE_BYTES } else { length };
            let piece_bytes = if self.way == Way::Whole { PIECE_BYTES } else { ready.max(1) };
            block.text()[..ready].chunks(piece_bytes).try_for_each(|piece| self.write(py, piece))?;
            block.drop_first(ready);
        }
        self.block = Some(block);
        Ok(())
    }

    fn close(&mut self, py: Python<'_>) -> PyResult<()> {
        let written = self.write_collected(py);
        self.file = None;
        written
    }

    fn discard(&mut self) {
        (self.file, self.block) = (None, None);
    }
}

impl OutputFile {
    /// Writes the lines that are not written yet.
    fn write_collected(&mut self, py: Python<'_>) -> PyResult<()> {
        match self.block.take() {
            Some(block) => self.write(py, block.text()),
            None => Ok(()),
        }
    }

    /// Writes bytes. Of a growing file, what does not fit is taken off to the last one: it is the beginning of rows.
    fn write(&mut self, py: Python<'_>, bytes: &[u8]) -> PyResult<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        write_all(py, file, bytes).map_err(|(done, failure)| {
            if self.way == Way::Growing && done > 0 {
                if let Ok(metadata) = file.metadata() {
                    // What cannot be taken off stays; the error says that the file is not whole.
                    drop(file.set_len(metadata.len().saturating_sub(done as u64)));
                }
            }
            failure.into()
        })
    }
}
