//! Security rules, usage, comparison, and both sides of a gateway.

use std::sync::Arc;

use modlens_tables::predicate::Predicate as CorePredicate;
use modlens_watch::compare::compare;
use modlens_watch::join::{Join as CoreJoin, Side};
use modlens_watch::live::Live;
use modlens_watch::rules::Rules;
use modlens_watch::usage::Usage;
use modlens_watch::usual::Usual;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::value_error;
use crate::batch::Batch;

fn parsed(text: &str) -> PyResult<Json> {
    serde_json::from_str(text).map_err(|error| value_error(error.to_string()))
}

/// Who does what on the buses.
#[pyclass(module = "_modlens")]
pub struct Watch {
    rules: Rules,
    usage: Usage,
    live: Option<Live>,
    news: Vec<Json>,
}

#[pymethods]
impl Watch {
    #[new]
    #[pyo3(signature = (rules="[]", usual=None))]
    fn new(rules: &str, usual: Option<&str>) -> PyResult<Self> {
        let rules = Rules::new(&parsed(rules)?).map_err(value_error)?;
        let usual = usual.map(|usual| Usual::new(&parsed(usual)?).map_err(value_error)).transpose()?;
        Ok(Self { rules, usage: Usage::default(), live: usual.map(Live::new), news: Vec::new() })
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        let core = Arc::clone(&batch.core);
        py.detach(|| {
            self.rules.observe(&core);
            self.usage.observe(&core);
            self.news.extend(self.live.as_mut().map_or_else(Vec::new, |live| live.observe(&core)));
        });
    }

    fn finish(&mut self) {
        self.rules.finish();
        self.news.extend(self.live.as_mut().map_or_else(Vec::new, Live::deviations));
    }

    fn alerts(&self) -> String {
        let (alerts, not_judged) = (self.rules.alerts(), self.rules.not_judged());
        json!({"alerts": alerts, "not_judged": not_judged, "not_kept": self.rules.not_kept()}).to_string()
    }

    fn news(&mut self) -> String {
        let mut news = self.rules.begun();
        news.append(&mut self.news);
        Json::Array(news).to_string()
    }

    fn usage(&self) -> String {
        self.usage.json().to_string()
    }

    #[pyo3(signature = (usual, *, values=false))]
    fn compare(&self, usual: &str, values: bool) -> PyResult<String> {
        let usual = Usual::new(&parsed(usual)?).map_err(value_error)?;
        Ok(compare(&usual, &self.usage, values).to_string())
    }
}

/// Both sides of a gateway.
#[pyclass(module = "_modlens")]
pub struct Join {
    core: CoreJoin,
}

#[pymethods]
impl Join {
    #[new]
    #[pyo3(signature = (filter=None))]
    fn new(filter: Option<&str>) -> PyResult<Self> {
        let filter = filter.map(|tree| CorePredicate::new("transactions", tree)).transpose().map_err(value_error)?;
        Ok(Self { core: CoreJoin::new(filter) })
    }

    fn add(&mut self, py: Python<'_>, side: &str, batch: &Batch) -> PyResult<()> {
        let (side, batch) = (self::side(side)?, Arc::clone(&batch.core));
        py.detach(|| self.core.add(side, &batch));
        Ok(())
    }

    fn end(&mut self, py: Python<'_>, side: &str) -> PyResult<()> {
        let side = self::side(side)?;
        py.detach(|| self.core.end(side));
        Ok(())
    }

    fn wants(&self) -> Option<&'static str> {
        self.core.wants().map(|side| if side == Side::Network { "network" } else { "line" })
    }

    fn is_aligned(&self) -> Option<bool> {
        self.core.is_aligned()
    }

    fn rows(&mut self) -> String {
        self.core.rows().to_string()
    }

    fn summary(&self) -> String {
        self.core.summary().to_string()
    }
}

fn side(name: &str) -> PyResult<Side> {
    match name {
        "network" => Ok(Side::Network),
        "line" => Ok(Side::Line),
        other => Err(value_error(format!("no side {other:?}; network or line"))),
    }
}
