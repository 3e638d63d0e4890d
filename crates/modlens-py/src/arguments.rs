//! Conversion of arguments and errors between Python and the core.

use std::sync::Arc;

use modlens_protocol::line::LineSettings;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A `ValueError` with this message: the caller has passed something invalid.
pub fn value_error(message: String) -> PyErr {
    PyValueError::new_err(message)
}

/// Changes a table that others may share: they keep theirs, and where the change fails, it stays as it was.
pub fn change_if_valid<T: Clone>(table: &mut Arc<T>, change: impl FnOnce(&mut T) -> Result<(), String>) -> PyResult<()> {
    let mut changed = T::clone(table);
    change(&mut changed).map_err(value_error)?;
    *table = Arc::new(changed);
    Ok(())
}

/// Line settings as Python passes them: baud, data bits, parity, stop bits.
pub type SettingsTuple = (u32, u8, String, f64);

/// Line settings from that tuple.
pub fn line_settings((baud, data_bits, parity, stop_bits): SettingsTuple) -> PyResult<LineSettings> {
    let stop = if stop_bits.fract() == 0.0 { format!("{stop_bits:.0}") } else { format!("{stop_bits}") };
    format!("{baud}-{data_bits}{parity}{stop}").parse().map_err(value_error)
}

/// Bytes as hex digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, b| text + &format!("{b:02x}"))
}
