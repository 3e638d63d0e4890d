//! What rules and a baseline find while rows come: each thing once, as soon as it is seen.
//!
//! Deviations are those of the current hour, so that what begins after weeks is seen at once. One that lasts is reported when
//! it begins; it is reported again after it was absent for a whole hour.

use std::collections::BTreeSet;
use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_protocol::Ns;
use serde_json::Value as Json;

use crate::compare::compare;
use crate::usage::Usage;
use crate::usual::Usual;

/// The time over which usage is compared with the baseline.
const WINDOW: Ns = 3_600_000_000_000;

/// Rows are compared with the baseline at most so often.
const STEP: Ns = 1_000_000_000;

/// Compares rows with a baseline while they come.
#[derive(Debug, Default)]
pub struct Live {
    usual: Usual,
    recent: Usage,
    begun: Option<Ns>,
    compared: Option<Ns>,
    /// Deviations of the window before, and of this one.
    before: BTreeSet<String>,
    now: BTreeSet<String>,
}

impl Live {
    /// Compares with this baseline.
    pub fn new(usual: Usual) -> Self {
        Self { usual, ..Self::default() }
    }

    /// Counts the rows of a batch; gives the deviations that begin with it, as `compare` lists them.
    pub fn observe(&mut self, batch: &Arc<Batch>) -> Vec<Json> {
        self.recent.observe(batch);
        let Some(latest) = self.recent.buses.values().filter_map(|bus| bus.times).map(|times| times.1).max() else {
            return self.deviations();
        };
        let begun = *self.begun.get_or_insert(latest);
        if self.compared.is_some_and(|compared| (0..STEP).contains(&(latest - compared))) {
            return Vec::new();
        }
        self.compared = Some(latest);
        let found = self.deviations();
        if latest - begun >= WINDOW {
            self.before = std::mem::take(&mut self.now);
            self.recent = Usage::default();
            self.begun = None;
        }
        found
    }

    /// The deviations that were not reported yet; for the end of the rows, too.
    pub fn deviations(&mut self) -> Vec<Json> {
        let Json::Array(found) = compare(&self.usual, &self.recent, false) else { return Vec::new() };
        let key =
            |row: &Json| ["code", "bus", "client", "unit", "function", "address"].map(|field| row[field].to_string()).join(" ");
        found.into_iter().filter(|row| self.now.insert(key(row)) && !self.before.contains(&key(row))).collect()
    }
}
