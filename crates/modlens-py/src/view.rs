//! Rows as lines for the terminal.

use std::ops::Range;

use modlens_protocol::register_type::Space;
use modlens_tables::columns::RowRef;
use modlens_writers::view as lines;
use modlens_writers::view::{AddressNotation, StyledText, TableOptions, TimeDisplay, Zone};
use pyo3::prelude::*;

use crate::arguments::value_error;
use crate::table::{Row, Table};

/// A text and the name of its style.
type TextAndStyle = (String, &'static str);

/// The notation of addresses by name.
fn address_notation(name: &str) -> PyResult<AddressNotation> {
    AddressNotation::from_name(name)
        .ok_or_else(|| value_error(format!("address {name:?} is not one of wire, 5digit, 6digit, hex")))
}

/// A function of Python that returns the offset to UTC for a time in ns, as a function of Rust. If it raises an exception,
/// the exception is reported and the time counts as UTC.
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

/// Parts of a line with the names of their styles.
fn styled(parts: Vec<StyledText>) -> Vec<TextAndStyle> {
    parts.into_iter().map(|(text, style)| (text, style.name())).collect()
}

/// The lines of one table that grows during a live session.
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
            other => return Err(value_error(format!("times {other:?} are not one of clock, elapsed, delta"))),
        };
        let kind = rows.first().ok_or_else(|| value_error("a table begins with a row".into()))?.table.kind;
        if rows.iter().any(|row| row.table.kind != kind) {
            return Err(value_error("rows of several tables".into()));
        }
        let first: Vec<RowRef<'_>> = rows.iter().map(|row| row.core()).collect();
        let look = TableOptions { addresses: address_notation(address)?, times, zone: zone(shift), width, labels };
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
    fn parts(&mut self, table: &Table, start: usize, count: usize) -> PyResult<Vec<Vec<TextAndStyle>>> {
        let mut out = Vec::new();
        let range = self.range(table, start, count)?;
        self.core.rows(&table.core, range, |line| out.push(styled(line)));
        Ok(out)
    }

    fn head(&self) -> Vec<TextAndStyle> {
        styled(self.core.head())
    }

    fn row(&mut self, row: &Row) -> PyResult<Vec<TextAndStyle>> {
        self.check(row.table.kind.name())?;
        Ok(styled(self.core.row(&row.core())))
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

/// A wire address in a notation; in that of the wire where the register type is not known.
#[pyfunction]
#[pyo3(signature = (wire, register_type, notation))]
pub fn register_number(wire: u32, register_type: Option<&str>, notation: &str) -> PyResult<String> {
    Ok(address_notation(notation)?.address(wire, register_type.and_then(Space::from_word)))
}

/// The register values of a transaction, as many as fit into the width.
#[pyfunction]
pub fn carried(row: &Row, address: &str, width: usize) -> PyResult<String> {
    if row.table.kind.name() != "transactions" {
        return Err(value_error(format!("a row of {} carries no values", row.table.kind.name())));
    }
    Ok(lines::carried(&row.core(), address_notation(address)?, width))
}
