//! Tables, their rows, and filters.

use std::sync::Arc;

use arrow_array::ffi::{FFI_ArrowArray, FFI_ArrowSchema};
use arrow_array::{Array, RecordBatch, RecordBatchIterator, StructArray};
use modlens_engine::records::Frame;
use modlens_tables::cell_text::{cell_text, source_text};
use modlens_tables::columns::{Cell, ColumnType, RowRef, Table as Core, TableKind};
use modlens_tables::predicate::Predicate as CorePredicate;
use modlens_writers::{influx, zeek};
use pyo3::exceptions::{PyAttributeError, PyIndexError, PyRuntimeError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule, PyDict, PyList, PyString, PyTuple};
use pyo3::IntoPyObjectExt;

use crate::arguments::value_error;
use crate::capsule::stream_capsule;
use crate::lines::{as_bytes, Encoder, Pieces};

/// A compiled filter for one table.
#[pyclass(frozen, module = "_modlens")]
pub struct Predicate {
    pub(crate) core: CorePredicate,
}

#[pymethods]
impl Predicate {
    #[new]
    fn new(table: &str, tree: &str) -> PyResult<Self> {
        Ok(Self { core: CorePredicate::new(table, tree).map_err(value_error)? })
    }
}

/// Rows of one table.
#[pyclass(frozen, module = "_modlens")]
pub struct Table {
    pub(crate) core: Core,
}

/// The indices of columns given by name.
pub(crate) fn column_indices(kind: TableKind, columns: &[String]) -> PyResult<Vec<usize>> {
    columns.iter().map(|key| kind.column(key).map_err(value_error)).collect()
}

#[pymethods]
impl Table {
    #[getter]
    fn name(&self) -> &'static str {
        self.core.kind.name()
    }

    fn __len__(&self) -> usize {
        self.core.len()
    }

    fn __getitem__(&self, index: isize) -> PyResult<Row> {
        let length = self.core.len() as isize;
        let at = if index < 0 { index + length } else { index };
        if !(0..length).contains(&at) {
            return Err(PyIndexError::new_err(format!("row {index} of {length}")));
        }
        Ok(Row { table: self.core.clone(), row: at as usize })
    }

    fn __iter__(&self) -> Rows {
        Rows { table: self.core.clone(), next: 0 }
    }

    #[pyo3(name = "where")]
    fn filter(&self, py: Python<'_>, predicate: &Predicate) -> PyResult<Self> {
        if predicate.core.kind != self.core.kind {
            return Err(value_error(format!("a filter for {} on {}", predicate.core.kind.name(), self.core.kind.name())));
        }
        let core = py.detach(|| predicate.core.filter(&self.core));
        Ok(Self { core })
    }

    fn slice(&self, start: usize, count: usize) -> Self {
        Self { core: self.core.slice(start, count) }
    }

    /// For each of these columns whether a row has a value in it.
    fn have_values(&self, py: Python<'_>, columns: Vec<String>) -> PyResult<Vec<bool>> {
        let columns = column_indices(self.core.kind, &columns)?;
        Ok(py.detach(|| columns.into_iter().map(|column| self.core.has_value(column)).collect()))
    }

    #[pyo3(signature = (format, columns, *, header=false))]
    fn lines(&self, format: &str, columns: Vec<String>, header: bool) -> PyResult<Pieces> {
        Ok(Encoder::new(format, self.core.kind, &columns)?.pieces(&self.core, header))
    }

    #[pyo3(signature = (columns, start=0, count=usize::MAX))]
    fn tuples<'py>(
        &self,
        py: Python<'py>,
        columns: Vec<String>,
        start: usize,
        count: usize,
    ) -> PyResult<Vec<Bound<'py, PyTuple>>> {
        let indices = column_indices(self.core.kind, &columns)?;
        let end = self.core.len().min(start.saturating_add(count));
        (start..end).map(|row| PyTuple::new(py, indices.iter().map(|&column| self.database_value(py, row, column)))).collect()
    }

    /// For each frame of the table: its file, its number, its transaction, and the numbers of all packets that it came in.
    fn origins(&self) -> Vec<(String, u64, Option<u64>, Vec<u64>)> {
        let batch = &self.core.batch;
        let mut between = batch.inner_packets.iter().peekable();
        let mut packets = |frame: &Frame| {
            let mut packets = vec![frame.origin];
            while between.next_if(|(number, _)| *number < frame.number).is_some() {}
            while let Some((_, packet)) = between.next_if(|(number, _)| *number == frame.number) {
                packets.push(*packet);
            }
            packets.push(frame.last_origin);
            packets.dedup();
            packets
        };
        let source = |frame: &Frame| batch.buses[frame.bus as usize].source.clone();
        let frames = (0..self.core.len()).filter_map(|row| self.core.frame(row));
        frames.map(|frame| (source(frame), frame.number, frame.txn, packets(frame))).collect()
    }

    fn influx<'py>(&self, py: Python<'py>) -> (Bound<'py, PyBytes>, usize) {
        let mut left_out = 0;
        let bytes = as_bytes(py, |out| left_out = influx::rows(&self.core, out));
        (bytes, left_out)
    }

    #[pyo3(signature = (log, *, json, header))]
    fn zeek<'py>(&self, py: Python<'py>, log: &str, json: bool, header: bool) -> PyResult<Bound<'py, PyBytes>> {
        let log = match log {
            "modbus" => zeek::Log::Modbus,
            "modbus_detailed" => zeek::Log::Detailed,
            other => return Err(value_error(format!("log {other:?} is neither modbus nor modbus_detailed"))),
        };
        Ok(as_bytes(py, |out| {
            if header && !json {
                log.head(out);
            }
            log.rows(&self.core, json, out);
        }))
    }

    fn partitions(&self, py: Python<'_>) -> Vec<(Option<String>, String, Self)> {
        let parts = py.detach(|| self.core.partitions());
        parts.into_iter().map(|(date, bus, core)| (date, bus, Self { core })).collect()
    }

    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        schema_capsule(py, self.core.kind)
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_array__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyCapsule>, Bound<'py, PyCapsule>)> {
        let _ = requested_schema;
        let data = StructArray::from(self.arrow(py)).to_data();
        let array = PyCapsule::new_with_value(py, FFI_ArrowArray::new(&data), c"arrow_array")?;
        Ok((schema_capsule(py, self.core.kind)?, array))
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        let schema = Arc::new(modlens_arrow::batch::schema(self.core.kind));
        stream_capsule(py, RecordBatchIterator::new([Ok(self.arrow(py))], schema))
    }
}

impl Table {
    /// A value in a form that databases accept: lists and maps become text, as CSV spells them.
    fn database_value(&self, py: Python<'_>, row: usize, column: usize) -> Py<PyAny> {
        let cell = self.core.cell(row, column);
        let kind = self.core.kind.columns()[column].kind;
        let number = match (&cell, kind) {
            (Cell::Null, _) => return py.None(),
            (Cell::Int(n), ColumnType::Float) => (*n as f64).into_py_any(py),
            (Cell::Float(number), _) => number.into_py_any(py),
            (Cell::Int(n), ColumnType::Int) => n.into_py_any(py),
            (Cell::Us(ns), _) => (*ns as f64 / 1000.0).into_py_any(py),
            (Cell::Bool(yes), _) => i64::from(*yes).into_py_any(py),
            _ => cell_text(&cell).into_py_any(py),
        };
        number.unwrap_or_else(|_| py.None())
    }

    fn arrow(&self, py: Python<'_>) -> RecordBatch {
        py.detach(|| modlens_arrow::batch::batch(&self.core))
    }
}

fn schema_capsule(py: Python<'_>, kind: TableKind) -> PyResult<Bound<'_, PyCapsule>> {
    let schema =
        FFI_ArrowSchema::try_from(&modlens_arrow::batch::schema(kind)).map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
    PyCapsule::new_with_value(py, schema, c"arrow_schema")
}

/// An iterator over the rows of a table.
#[pyclass(module = "_modlens")]
pub struct Rows {
    table: Core,
    next: usize,
}

#[pymethods]
impl Rows {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__(&mut self) -> Option<Row> {
        let row = self.next;
        (row < self.table.len()).then(|| {
            self.next += 1;
            Row { table: self.table.clone(), row }
        })
    }
}

/// One row of a table, whose columns are attributes.
#[pyclass(frozen, module = "_modlens")]
pub struct Row {
    pub(crate) table: Core,
    row: usize,
}

#[pymethods]
impl Row {
    /// Looks for the name among the columns first, because a search among the methods that finds nothing costs more than
    /// reading a column.
    fn __getattribute__<'py>(slf: &Bound<'py, Self>, name: &Bound<'py, PyString>) -> PyResult<Bound<'py, PyAny>> {
        let row = slf.get();
        let found = row.table.kind.columns().iter().position(|column| name == column.key.as_str());
        match found {
            Some(column) => row.value(slf.py(), column),
            None => slf.py().get_type::<PyAny>().call_method1(intern!(slf.py(), "__getattribute__"), (slf, name)),
        }
    }

    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let column = self.table.kind.column(name).map_err(PyAttributeError::new_err)?;
        self.value(py, column)
    }

    fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (i, column) in self.table.kind.columns().iter().enumerate() {
            dict.set_item(&column.key, self.value(py, i)?)?;
        }
        Ok(dict)
    }

    fn __dir__(&self) -> Vec<&'static str> {
        self.table.kind.columns().iter().map(|column| column.key.as_str()).chain(["as_dict"]).collect()
    }

    fn __repr__(&self) -> String {
        let columns = self.table.kind.columns().iter().enumerate();
        let shown = columns.filter_map(|(i, column)| {
            let cell = self.table.cell(self.row, i);
            let text = cell_text(&cell);
            (!text.is_empty()).then(|| format!("{}={text}", column.key))
        });
        format!("<{} {}>", self.table.kind.row_name(), shown.collect::<Vec<_>>().join(" "))
    }
}

impl Row {
    pub(crate) fn core(&self) -> RowRef<'_> {
        self.table.row(self.row)
    }

    /// The value of a column as a Python object.
    fn value<'py>(&self, py: Python<'py>, column: usize) -> PyResult<Bound<'py, PyAny>> {
        let cell = self.table.cell(self.row, column);
        let float = matches!(self.table.kind.columns()[column].kind, ColumnType::Float);
        Ok(match cell {
            Cell::Null => py.None().into_bound(py),
            Cell::Int(n) if float => (n as f64).into_pyobject(py)?.into_any(),
            Cell::Int(n) if self.table.kind.columns()[column].kind == ColumnType::Text => {
                n.to_string().into_pyobject(py)?.into_any()
            }
            Cell::Int(n) => n.into_pyobject(py)?.into_any(),
            Cell::Float(value) => value.into_pyobject(py)?.into_any(),
            Cell::Value(value) => value.text().into_pyobject(py)?.into_any(),
            Cell::Us(ns) => (ns as f64 / 1000.0).into_pyobject(py)?.into_any(),
            Cell::Time(ns) => datetime(py, ns)?,
            Cell::Bool(yes) => yes.into_pyobject(py)?.to_owned().into_any(),
            Cell::Word(text) | Cell::Text(text) => text.into_pyobject(py)?.into_any(),
            Cell::Hex(bytes) => PyBytes::new(py, bytes).into_any(),
            Cell::Ints(items) => PyList::new(py, (0..items.len()).map(|i| items.get(i)))?.into_any(),
            Cell::Codes(codes) => PyList::new(py, codes.iter().map(|code| code.doc().code))?.into_any(),
            Cell::Fields(fields) => {
                let mut text = Vec::new();
                fields.push_json(&mut text);
                py.import("json")?.call_method1("loads", (PyBytes::new(py, &text),))?
            }
            Cell::Map(map) => py.import("json")?.call_method1("loads", (map.to_string(),))?,
            Cell::Source(file, place, number) => source_text(file, place, number).into_pyobject(py)?.into_any(),
        })
    }
}

/// A `datetime` in UTC, which has microseconds, while the columns of files have nanoseconds.
fn datetime(py: Python<'_>, ns: i64) -> PyResult<Bound<'_, PyAny>> {
    let module = py.import("datetime")?;
    let utc = module.getattr("timezone")?.getattr("utc")?;
    let epoch = module.getattr("datetime")?.call1((1970, 1, 1, 0, 0, 0, 0, utc))?;
    let delta = module.getattr("timedelta")?.call1((0, ns.div_euclid(1_000_000_000), ns.rem_euclid(1_000_000_000) / 1000))?;
    epoch.call_method1("__add__", (delta,))
}

/// One table of a batch.
pub fn table(batch: &Arc<modlens_engine::records::Batch>, kind: TableKind) -> Table {
    Table { core: Core::new(Arc::clone(batch), kind) }
}
