//! Rows as lines for people.

use std::ops::Range;

use modlens_tables::columns::RowRef;
use modlens_writers::view as lines;
use modlens_writers::view::{AddressNotation, StyledText, TableOptions, TimeDisplay, Zone};
use pyo3::prelude::*;

use crate::arguments::value_error;
use crate::table::{Row, Table};

/// A text and the name of its style.
type Named = (String, &'static str);

fn base(name: &str) -> PyResult<AddressNotation> {
    AddressNotation::from_name(name).ok_or_else(|| value_error(format!("address {name:?} is none of wire, 5digit, 6digit, hex")))
}

/// A function of Python's as one of the core's; what it cannot tell is UTC.
fn zone(shift: Option<Py<PyAny>>) -> Zone {
    let Some(shift) = shift else { return Box::new(|_| 0) };
    Box::new(move |ns| {
        Python::attach(|py| {
            let found = shift.call1(py, (ns,)).and_then(|found| found.extract(py));
            found.unwrap_or_else(|error: PyErr| {
                error.write_unraisable(py, Some(shift.bind(py)));
                0
            })
        })
    })
}

fn named(parts: Vec<StyledText>) -> Vec<Named> {
    parts.into_iter().map(|(text, style)| (text, style.name())).collect()
}

/// The lines of one table, while it grows.
#[pyclass(module = "_modlens")]
pub struct Lines {
    core: lines::TableLines,
    kind: &'static str,
}

#[pymethods]
impl Lines {
    #[new]
    #[pyo3(signature = (rows, width, *, address="wire", times="elapsed", labels=None, shift=None))]
    fn new(
        rows: Vec<PyRef<'_, Row>>,
        width: usize,
        address: &str,
        times: &str,
        labels: Option<Vec<(String, String)>>,
        shift: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let times = match times {
            "clock" => TimeDisplay::Clock,
            "elapsed" => TimeDisplay::Elapsed,
            "delta" => TimeDisplay::Delta,
            other => return Err(value_error(format!("times {other:?} are none of clock, elapsed, delta"))),
        };
        let kind = rows.first().ok_or_else(|| value_error("a table begins with a row".into()))?.table.kind;
        if rows.iter().any(|row| row.table.kind != kind) {
            return Err(value_error("rows of several tables".into()));
        }
        let first: Vec<RowRef<'_>> = rows.iter().map(|row| row.core()).collect();
        let look = TableOptions { base: base(address)?, times, zone: zone(shift), width, labels };
        Ok(Self { core: lines::TableLines::new(kind, &first, look), kind: kind.name() })
    }

    #[pyo3(signature = (table, start=0, count=usize::MAX))]
    fn text(&mut self, table: &Table, start: usize, count: usize) -> PyResult<String> {
        let mut out = String::new();
        let range = self.range(table, start, count)?;
        self.core.rows(&table.core, range, |line| lines::push_plain(&line, &mut out));
        Ok(out)
    }

    #[pyo3(signature = (table, start=0, count=usize::MAX))]
    fn parts(&mut self, table: &Table, start: usize, count: usize) -> PyResult<Vec<Vec<Named>>> {
        let mut out = Vec::new();
        let range = self.range(table, start, count)?;
        self.core.rows(&table.core, range, |line| out.push(named(line)));
        Ok(out)
    }

    fn head(&self) -> Vec<Named> {
        named(self.core.head())
    }

    fn row(&mut self, row: &Row) -> PyResult<Vec<Named>> {
        self.check(row.table.kind.name())?;
        Ok(named(self.core.row(&row.core())))
    }
}

impl Lines {
    fn check(&self, kind: &str) -> PyResult<()> {
        if kind == self.kind {
            Ok(())
        } else {
            Err(value_error(format!("lines of {}, a row of {kind}", self.kind)))
        }
    }

    fn range(&self, table: &Table, start: usize, count: usize) -> PyResult<Range<usize>> {
        self.check(table.core.kind.name())?;
        let end = table.core.len().min(start.saturating_add(count));
        Ok(start.min(end)..end)
    }
}

/// The values that a transaction carried, as many as fit.
#[pyfunction]
pub fn carried(row: &Row, address: &str, width: usize) -> PyResult<String> {
    if row.table.kind.name() != "transactions" {
        return Err(value_error(format!("a row of {} carries no values", row.table.kind.name())));
    }
    Ok(lines::carried(&row.core(), base(address)?, width))
}
