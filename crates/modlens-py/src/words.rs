//! What words on a command line mean: durations, sizes, line settings, the address of a broker.

use modlens_protocol::amount;
use modlens_protocol::line::LineSettings;
use modlens_recorder::{Retention, Rotation};
use modlens_writers::mqtt::{self, Address};
use pyo3::prelude::*;

use crate::arguments::{value_error, SettingsTuple};

/// A broker: TLS, host, port, user, password, prefix, whether a password is in the address.
type AddressTuple = (bool, String, u16, Option<String>, Option<String>, String, bool);

/// A duration in nanoseconds.
#[pyfunction]
pub fn parse_duration(text: &str) -> Option<i64> {
    amount::duration(text)
}

/// When a segment of a recording ends: seconds, or bytes.
#[pyfunction]
pub fn parse_rotation(text: &str) -> PyResult<(Option<u64>, Option<u64>)> {
    Ok(match text.parse().map_err(value_error)? {
        Rotation::Never => (None, None),
        Rotation::After(time) => (Some(time.as_secs()), None),
        Rotation::Bytes(bytes) => (None, Some(bytes)),
    })
}

/// What is kept of a recording: segments, or bytes.
#[pyfunction]
pub fn parse_retention(text: &str) -> PyResult<(Option<usize>, Option<u64>)> {
    Ok(match text.parse().map_err(value_error)? {
        Retention::All => (None, None),
        Retention::Segments(count) => (Some(count), None),
        Retention::Bytes(bytes) => (None, Some(bytes)),
    })
}

/// Line settings: baud, data bits, parity, stop bits.
#[pyfunction]
pub fn parse_line(text: &str) -> PyResult<SettingsTuple> {
    let line: LineSettings = text.parse().map_err(value_error)?;
    Ok((line.baud, line.data_bits, line.parity.letter().to_string(), f64::from(line.half_stop_bits) / 2.0))
}

/// The parts of the address of a broker.
#[pyfunction]
#[pyo3(signature = (text, password=None))]
pub fn parse_broker(text: &str, password: Option<String>) -> PyResult<AddressTuple> {
    let found = Address::parse(text, password).map_err(value_error)?;
    Ok((found.tls, found.host, found.port, found.user, found.password, found.prefix, found.has_password))
}

/// A name as one level of a topic.
#[pyfunction]
pub fn topic_level(name: &str) -> String {
    mqtt::level(name)
}
