//! Device profiles, the register map that traffic shows, and the inference of register types.

use std::sync::Arc;

use modlens_profiles::learn;
use modlens_profiles::points::{Conversion, Plan};
use modlens_profiles::profile::{self, Mistake, Order, Profile as Core, ProfileFormat, Type, SHIPPED, SUNSPEC};
use modlens_protocol::register_type::Space;
use modlens_tables::latest_values::LatestValues;
use modlens_tables::register_survey::RegisterSurvey as CoreSurvey;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::value_error;
use crate::batch::Batch;

/// A device profile without errors.
#[pyclass(frozen, module = "_modlens")]
pub struct Profile {
    pub(crate) plan: Arc<Plan>,
}

#[pymethods]
impl Profile {
    #[new]
    fn new(text: &str, form: &str) -> PyResult<Self> {
        let form = ProfileFormat::from_word(form)
            .ok_or_else(|| value_error(format!("form {form:?} is not one of toml, yaml, csv, json")))?;
        let core = Core::parse(text, form).map_err(|mistakes| value_error(errors_json(&mistakes)))?;
        Ok(Self { plan: Arc::new(Plan::new(core)) })
    }

    fn model(&self) -> String {
        profile::to_json(&self.plan.profile).to_string()
    }
}

/// Errors of a profile as JSON.
fn errors_json(mistakes: &[Mistake]) -> String {
    let row = |mistake: &Mistake| json!({"line": Some(mistake.line).filter(|&line| line > 0), "key": mistake.key, "message": mistake.message, "hint": mistake.hint});
    mistakes.iter().map(row).collect::<Json>().to_string()
}

/// The JSON Schema of device profiles.
#[pyfunction]
pub fn profile_schema() -> String {
    format!("{:#}\n", profile::schema())
}

/// The shipped profiles, as (name, TOML text).
#[pyfunction]
pub fn shipped_profiles() -> Vec<(&'static str, &'static str)> {
    SHIPPED.to_vec()
}

/// Converts the bytes of registers to one value: the number, if a float can hold it, and its exact text.
#[pyfunction]
pub fn convert(r#type: &str, order: &str, data: &[u8]) -> PyResult<(Option<f64>, Option<String>)> {
    let kind = Type::from_word(r#type).ok_or_else(|| value_error(format!("no type {type:?}")))?;
    let order = Order::from_word(order).ok_or_else(|| value_error(format!("no order {order:?}")))?;
    let needed = usize::from(kind.registers()) * 2;
    if data.is_empty() || !data.len().is_multiple_of(2) || (needed > 0 && data.len() != needed) {
        return Err(value_error(format!("{} bytes are not a {}", data.len(), kind.word())));
    }
    let value = Conversion::of_type(kind, order).value(data, None);
    Ok((value.number(), value.text()))
}

/// The last value of every register, as traffic shows it.
#[pyclass(module = "_modlens")]
#[derive(Default)]
pub struct RegisterMap {
    core: LatestValues,
}

#[pymethods]
impl RegisterMap {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        py.detach(|| self.core.add(&batch.core));
    }

    #[pyo3(signature = (first=0, most=usize::MAX))]
    fn rows(&self, first: usize, most: usize) -> String {
        self.core.json(first, most).to_string()
    }
}

/// Statistics of the registers of each unit, from which their types are inferred.
#[pyclass(module = "_modlens")]
#[derive(Default)]
pub struct Survey {
    core: CoreSurvey,
}

#[pymethods]
impl Survey {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        py.detach(|| self.core.add(&batch.core));
    }

    /// The blocks of each table of each unit.
    fn tables(&self) -> String {
        self.core.tables().to_string()
    }

    /// What was learnt of a table, from the point with the number `first` on, at most `most` points.
    fn points(&mut self, py: Python<'_>, unit: u8, space: &str, first: usize, most: usize) -> PyResult<String> {
        let space = Space::from_word(space).ok_or_else(|| value_error(format!("no table {space:?}")))?;
        Ok(py.detach(|| self.core.points(unit, space, first, most).to_string()))
    }

    /// How the points of a table moved in so many parts of the time, and what they say of each other.
    fn movements(&mut self, py: Python<'_>, unit: u8, space: &str, parts: usize) -> PyResult<String> {
        let space = Space::from_word(space).ok_or_else(|| value_error(format!("no table {space:?}")))?;
        Ok(py.detach(|| self.core.movements(unit, space, parts.max(1)).to_string()))
    }

    /// Takes the scale of a point as known, with the evidence for it in bits.
    fn anchor(&mut self, unit: u8, space: &str, address: u16, factor: f64, bits: f64) -> PyResult<()> {
        let space = Space::from_word(space).ok_or_else(|| value_error(format!("no table {space:?}")))?;
        self.core.anchor(unit, space, learn::Anchor { address, factor, bits });
        Ok(())
    }

    /// How well a profile fits a unit.
    fn fit(&mut self, py: Python<'_>, unit: u8, profile: &Profile) -> String {
        let found = py.detach(|| self.core.fit(unit, &profile.plan));
        json!({"percent": found.percent, "bits": found.bits, "share": found.share, "fits": found.fits, "reasons": found.reasons})
            .to_string()
    }

    /// The samples that are kept of each block, at most.
    #[getter]
    fn most_rows(&self) -> usize {
        self.core.most_rows()
    }
}

/// Which type, in which order: claims on rows of two or four registers, best first, as JSON.
#[pyfunction]
pub fn judge(rows: Vec<Vec<u16>>) -> String {
    let rows: Vec<&[u16]> = rows.iter().map(Vec::as_slice).collect();
    let claim = |claim: &learn::TypeHypothesis| json!({"type": claim.kind.word(), "order": claim.order.word(), "bits": claim.bits, "sure": claim.is_certain, "reason": claim.reason});
    learn::rank_types(&rows, &vec![true; rows.len()], &learn::Habits::default()).iter().map(claim).collect::<Json>().to_string()
}

/// The shipped `SunSpec` models, as (number, TOML text).
#[pyfunction]
pub fn sunspec_models() -> Vec<(u16, &'static str)> {
    SUNSPEC.to_vec()
}
