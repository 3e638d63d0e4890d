//! The rows that were kept, table by table, filtered or not.

use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_filters::{predicate, Changes};
use modlens_tables::columns::{Table, TableKind};
use modlens_tables::predicate::Predicate;
use serde_json::Value as Json;

/// The batches that were kept, and what is shown of them.
#[derive(Default)]
pub(crate) struct Views {
    batches: Vec<Arc<Batch>>,
    /// The first so many have findings only, of batches whose other rows were forgotten.
    stripped: usize,
    forgotten: Forgotten,
    shown: Vec<View>,
}

/// How many rows of a recording are not kept any more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Forgotten {
    pub transactions: usize,
    pub findings: usize,
}

/// Findings that are kept where their transactions are not: as many as take some 40 MB.
const MOST_FINDINGS: usize = 200_000;

/// The rows of one table that satisfy a filter.
pub(crate) struct View {
    kind: TableKind,
    /// The filter as it was written; empty for all rows.
    filter: String,
    predicate: Option<Predicate>,
    /// The rows of each batch.
    parts: Vec<Table>,
    /// The number of the first row of each part.
    starts: Vec<usize>,
    rows: usize,
}

/// Views that are kept beside each other: one a table, and one for an export.
const MAX_VIEWS: usize = 8;

impl Views {
    /// Keeps the rows of a batch.
    pub fn add(&mut self, batch: Arc<Batch>) {
        self.batches.push(batch);
    }

    /// The batches that were kept.
    pub fn batches(&self) -> &[Arc<Batch>] {
        &self.batches
    }

    /// How many rows are not kept any more.
    pub fn forgotten(&self) -> Forgotten {
        self.forgotten
    }

    /// Forgets the oldest batches while the others have this many transactions or more, but, with `keep_findings`, their
    /// findings, up to `MOST_FINDINGS` of the newest.
    pub fn forget_all_but(&mut self, transactions: usize, keep_findings: bool) {
        let mut kept: usize = self.batches.iter().map(|batch| batch.transaction_count()).sum();
        let is_old = |batch: &&Arc<Batch>| {
            kept -= batch.transaction_count();
            kept >= transactions
        };
        let count = self.batches[self.stripped..].iter().take_while(is_old).count();
        let old = self.stripped..self.stripped + count;
        self.forgotten.transactions += self.batches[old.clone()].iter().map(|batch| batch.transaction_count()).sum::<usize>();
        if !keep_findings {
            self.forgotten.findings += findings(&self.batches[old.clone()]);
            self.batches.drain(old);
            self.shown.iter_mut().for_each(|view| view.forget(count));
        } else if count > 0 {
            let kept: Vec<Arc<Batch>> = self.batches[old.clone()].iter().filter_map(|batch| findings_of(batch)).collect();
            self.stripped += kept.len();
            self.batches.splice(old, kept);
            self.forget_findings();
            self.shown.clear();
        }
    }

    /// Forgets the oldest of the batches that have findings only, while the others have `MOST_FINDINGS` or more.
    fn forget_findings(&mut self) {
        let mut kept = findings(&self.batches);
        let is_old = |batch: &&Arc<Batch>| {
            kept -= batch.findings.len();
            kept >= MOST_FINDINGS
        };
        let count = self.batches[..self.stripped].iter().take_while(is_old).count();
        self.forgotten.findings += findings(&self.batches[..count]);
        self.batches.drain(..count);
        self.stripped -= count;
    }

    /// The rows of a `table` that satisfy `where`, a filter (empty or null for all rows). The message says what is wrong
    /// with it.
    pub fn of(&mut self, question: &Json) -> Result<&View, String> {
        let kind = table_of(question)?;
        let filter = question["where"].as_str().unwrap_or_default();
        let found = self.shown.iter().position(|view| view.kind == kind && view.filter == filter);
        let mut view = match found {
            Some(at) => self.shown.remove(at),
            None => View::new(kind, filter, &|| local_changes(question))?,
        };
        view.add(&self.batches);
        self.shown.truncate(MAX_VIEWS - 1);
        self.shown.insert(0, view);
        Ok(&self.shown[0])
    }
}

fn findings(batches: &[Arc<Batch>]) -> usize {
    batches.iter().map(|batch| batch.findings.len()).sum()
}

/// The findings of a batch, if it has any.
fn findings_of(batch: &Batch) -> Option<Arc<Batch>> {
    let mut only = Batch::default();
    (only.buses, only.functions) = (Arc::clone(&batch.buses), batch.functions.clone());
    only.findings.clone_from(&batch.findings);
    (!only.findings.is_empty()).then(|| Arc::new(only))
}

/// The table of a question; transactions where it names none.
pub(crate) fn table_of(question: &Json) -> Result<TableKind, String> {
    let name = question["table"].as_str().unwrap_or("transactions");
    TableKind::from_name(name).ok_or_else(|| format!("no table {name:?}"))
}

/// The changes of the offset from UTC of the page's computer: `local` has pairs of seconds.
pub(crate) fn local_changes(question: &Json) -> Changes {
    const SECOND_NS: i64 = 1_000_000_000;
    let pairs = question["local"].as_array().map(Vec::as_slice).unwrap_or_default();
    let ns = |number: &Json| number.as_i64().map(|seconds| seconds.saturating_mul(SECOND_NS));
    pairs.iter().filter_map(|pair| Some((ns(&pair[0])?, ns(&pair[1])?))).collect()
}

impl View {
    fn new(kind: TableKind, filter: &str, local: &dyn Fn() -> Changes) -> Result<Self, String> {
        let predicate = if filter.is_empty() { None } else { Some(predicate(filter, kind.name(), local)?) };
        Ok(Self { kind, filter: filter.to_owned(), predicate, parts: Vec::new(), starts: Vec::new(), rows: 0 })
    }

    /// Adds the rows of the batches that were not looked at yet.
    fn add(&mut self, batches: &[Arc<Batch>]) {
        for batch in &batches[self.parts.len()..] {
            let all = Table::new(Arc::clone(batch), self.kind);
            let part = self.predicate.as_ref().map_or_else(|| all.clone(), |predicate| predicate.filter(&all));
            self.starts.push(self.rows);
            self.rows += part.len();
            self.parts.push(part);
        }
    }

    /// Forgets the oldest parts, as far as it has them.
    fn forget(&mut self, count: usize) {
        self.parts.drain(..count.min(self.parts.len()));
        self.starts.clear();
        self.rows = 0;
        for part in &self.parts {
            self.starts.push(self.rows);
            self.rows += part.len();
        }
    }

    /// The table.
    pub fn kind(&self) -> TableKind {
        self.kind
    }

    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Its rows, batch by batch.
    pub fn parts(&self) -> &[Table] {
        &self.parts
    }

    /// Up to `count` rows from the row `from` on, as parts and places in them.
    pub fn window(&self, from: usize, count: usize) -> impl Iterator<Item = (&Table, usize)> {
        let end = self.rows.min(from.saturating_add(count));
        (from..end).map(|row| {
            let part = self.starts.partition_point(|&start| start <= row) - 1;
            (&self.parts[part], row - self.starts[part])
        })
    }
}
