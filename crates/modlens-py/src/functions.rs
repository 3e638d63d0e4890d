//! The table of functions, by which PDUs are decoded and encoded.

use std::borrow::Cow;
use std::sync::Arc;

use modlens_protocol::annotate::{self, annotate, guess_direction, Body, Piece, Wrapping};
use modlens_protocol::framing::{Direction, Mode};
use modlens_protocol::functions::Functions as Core;
use modlens_protocol::pdu;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::Value as Json;

use crate::arguments::{change_if_valid, value_error};

/// The embedded functions and those that users have added.
#[pyclass(module = "_modlens")]
pub struct Functions {
    pub(crate) core: Arc<Core>,
    /// How often rows have been added.
    loads: usize,
}

#[pymethods]
impl Functions {
    #[new]
    fn new() -> Self {
        Self { core: Arc::new(Core::default()), loads: 0 }
    }

    fn load(&mut self, text: &str, origin: &str) -> PyResult<()> {
        self.loads += 1;
        change_if_valid(&mut self.core, |functions| functions.load(text, origin, None))
    }

    #[getter]
    fn loads(&self) -> usize {
        self.loads
    }

    fn load_vendor(&mut self, name: &str) -> PyResult<()> {
        self.loads += 1;
        Arc::make_mut(&mut self.core).load_vendor(name).map_err(value_error)
    }

    fn rows(&self) -> String {
        self.core.rows().map(|row| row.source.clone()).collect::<Json>().to_string()
    }

    fn decode(&self, pdu: &[u8], direction: &str) -> PyResult<String> {
        Ok(pdu::describe(&self.core, pdu, is_response(direction)?).to_string())
    }

    /// The direction whose layout fits a PDU: "request", "response" or "unknown".
    fn guess_direction(&self, pdu: &[u8]) -> &'static str {
        guess_direction(&self.core, pdu).text()
    }

    /// The blocks of a frame of a mode ("rtu", "ascii", "tcp", or "pdu" for a PDU alone).
    #[pyo3(signature = (frame, mode, direction, request=None, has_checksum=true))]
    fn annotate(
        &self,
        frame: &[u8],
        mode: &str,
        direction: &str,
        request: Option<&[u8]>,
        has_checksum: bool,
    ) -> PyResult<Vec<PieceTuple>> {
        let unknown = || value_error(format!("direction {direction:?} is not one of request, response, unknown"));
        let direction = Direction::from_text(direction).ok_or_else(unknown)?;
        let wrapping = match mode {
            "pdu" => Wrapping::None,
            mode => Wrapping::Frame { mode: frame_mode(mode)?, has_checksum },
        };
        let body = Body { functions: &self.core, direction, request };
        Ok(annotate(frame, wrapping, body).into_iter().map(piece_tuple).collect())
    }

    fn encode(&self, function: u8, direction: &str, values: &str) -> PyResult<Vec<u8>> {
        let values: Json = serde_json::from_str(values).map_err(|e| value_error(e.to_string()))?;
        let values = values.as_object().ok_or_else(|| value_error("values must be a JSON object".into()))?;
        pdu::encode(&self.core, function, is_response(direction)?, values).map_err(value_error)
    }
}

/// A block as Python takes it: offset, bytes, name, value, meaning, layer, whether it is valid.
type PieceTuple = (usize, Cow<'static, [u8]>, String, String, String, &'static str, bool);

fn piece_tuple(piece: Piece) -> PieceTuple {
    let Piece { offset, bytes, name, value, meaning, layer } = piece;
    (offset, Cow::Owned(bytes), name, value, meaning.text, layer.text(), meaning.is_valid)
}

/// The PDU in a frame of a mode.
#[pyfunction]
#[pyo3(signature = (frame, mode, has_checksum=true))]
pub fn pdu_of<'py>(py: Python<'py>, frame: &[u8], mode: &str, has_checksum: bool) -> PyResult<Option<Bound<'py, PyBytes>>> {
    Ok(annotate::pdu_of(frame, frame_mode(mode)?, has_checksum).map(|pdu| PyBytes::new(py, &pdu)))
}

/// Whether the frame of a transaction has its checksum, right or wrong.
#[pyfunction]
pub fn has_checksum(frame: &[u8], mode: &str, is_sound: bool) -> PyResult<bool> {
    Ok(annotate::has_checksum(frame, frame_mode(mode)?, is_sound))
}

fn frame_mode(name: &str) -> PyResult<Mode> {
    Mode::from_text(name).ok_or_else(|| value_error(format!("mode {name:?} is not one of rtu, ascii, tcp")))
}

/// Whether a direction is that of responses.
fn is_response(direction: &str) -> PyResult<bool> {
    match direction {
        "request" => Ok(false),
        "response" => Ok(true),
        other => Err(value_error(format!("direction {other:?} is neither request nor response"))),
    }
}
