//! The search for the register that holds a value.

use modlens_profiles::find::{self, BlockSeries, Found, Query};
use modlens_tables::register_series::RegisterSeries;
use modlens_tables::register_survey::RegisterSurvey;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::value_error;
use crate::batch::Batch;

/// The values of all registers of a recording, and the search in them.
#[pyclass(module = "_modlens")]
pub struct Finder {
    series: RegisterSeries,
    survey: RegisterSurvey,
}

#[pymethods]
impl Finder {
    /// Around the times in `kept` (from, to), every sample is kept.
    #[new]
    fn new(kept: Vec<(i64, i64)>) -> Self {
        let series = RegisterSeries::new(kept.into_iter().map(|(from, to)| from..=to).collect());
        Self { series, survey: RegisterSurvey::default() }
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        py.detach(|| {
            self.series.add(&batch.core);
            self.survey.add(&batch.core);
        });
    }

    /// The first and the last time of a sample.
    #[getter]
    fn span(&self) -> Option<(i64, i64)> {
        self.series.span()
    }

    #[getter]
    fn dropped(&self) -> u64 {
        self.series.dropped()
    }

    fn find(&mut self, py: Python<'_>, query: &str) -> PyResult<String> {
        let json: Json = serde_json::from_str(query).map_err(|error| value_error(format!("query: {error}")))?;
        let query = Query::from_json(&json).ok_or_else(|| value_error("query: not of the known form".to_owned()))?;
        Ok(py.detach(|| {
            let blocks = self.series.blocks();
            let found = find::find(&blocks, &self.survey.layout_hints(), &query);
            found_json(&blocks, &found).to_string()
        }))
    }
}

fn found_json(blocks: &[BlockSeries], found: &Found) -> Json {
    let row = |one: &find::Candidate| {
        let block = &blocks[one.reading.block as usize];
        let variant = &found.variants[usize::from(one.reading.variant)];
        let is_bit = one.reading.bit.is_some() || block.space.is_bits();
        json!({
            "unit": block.unit, "register_type": block.space.long_name(), "space": block.space.short_name(),
            "address": block.first.wrapping_add(one.reading.at), "count": variant.words, "bit": one.reading.bit,
            "type": if is_bit { "bool" } else { variant.kind.word() }, "order": variant.order.word(),
            "scale": one.scale, "offset": one.offset, "odds_bits": (one.odds_bits * 10.0).round() / 10.0, "chance": one.chance,
            "r2": one.fit.map(|fit| fit.0), "lag_ns": one.fit.map(|fit| fit.1),
        })
    };
    json!({
        "readings": found.readings, "registers": found.registers, "candidates": found.candidates.iter().map(row).collect::<Json>(),
        "look": found.look.as_ref().map(|look| json!({"time_ns": look.time, "values": look.values})),
    })
}
