//! A selection: the rows of a recording that a user has chosen, before anything is counted.
//!
//! A condition chooses transactions. Frames and findings that belong to a transaction follow it; those that belong to none are
//! chosen by the same condition, if their table has all of its columns, and are left out otherwise. A connection is chosen in
//! the same way, and also if it carries a chosen transaction.

use std::collections::{BTreeSet, VecDeque};
use std::mem::take;
use std::sync::Arc;

use modlens_engine::records::{Batch, FindingRow, Frame};
use modlens_engine::stats::Stats;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::Functions;
use serde_json::Value as Json;

use crate::columns::{Table, TableKind};
use crate::predicate::Predicate;

/// Numbers of chosen transactions that are remembered for findings that come after their rows.
const MAX_CHOSEN: usize = 1 << 16;

/// The rows that meet a condition, and their statistics.
///
/// Frames are emitted before their transaction is decided. They wait here until then, so that frames are kept in the order of
/// their numbers.
pub struct Selection {
    conditions: Vec<Predicate>,
    /// The latest transactions that were chosen.
    chosen: BTreeSet<u64>,
    /// The highest number of a transaction that was decided.
    decided: u64,
    /// Connections that carry chosen transactions.
    connections: BTreeSet<u64>,
    frames: VecDeque<WaitingFrame>,
    findings: VecDeque<(FindingRow, bool)>,
    stats: Stats,
}

/// A frame that waits for its transaction, with its bytes and findings.
struct WaitingFrame {
    row: Frame,
    wire: Vec<u8>,
    codes: Vec<Finding>,
    /// Whether it meets the condition itself.
    is_met: bool,
}

impl Selection {
    /// A selection by a condition, compiled for each table that has its columns.
    ///
    /// # Errors
    ///
    /// Says so if the condition for transactions is missing.
    pub fn new(conditions: Vec<Predicate>) -> Result<Self, String> {
        if !conditions.iter().any(|one| one.kind == TableKind::Transactions) {
            return Err("a selection needs a condition for transactions".into());
        }
        Ok(Self {
            conditions,
            chosen: BTreeSet::new(),
            decided: 0,
            connections: BTreeSet::new(),
            frames: VecDeque::new(),
            findings: VecDeque::new(),
            stats: Stats::default(),
        })
    }

    /// Keeps the chosen rows of a batch and counts them. The batch has no compact exchanges.
    #[must_use]
    pub fn apply(&mut self, batch: Batch) -> Batch {
        let shared = Arc::new(batch);
        let met = |kind| self.met(&shared, kind);
        let (transactions, frames) = (met(TableKind::Transactions), met(TableKind::Frames));
        let (findings, connections) = (met(TableKind::Findings), met(TableKind::Connections));
        let mut batch = Arc::into_inner(shared).expect("no table holds it any more");
        self.transactions(&mut batch, &transactions);
        self.frames(&mut batch, &frames);
        self.findings(&mut batch, &findings);
        let mut met = connections.iter();
        batch.connections.retain(|row| {
            let carries = self.connections.remove(&row.number);
            *met.next().unwrap_or(&false) || carries
        });
        self.stats.rows(&batch);
        batch
    }

    /// The statistics of the rows so far, as JSON with the keys of those of a session.
    pub fn stats_json(&self, functions: &Functions) -> Json {
        self.stats.json(functions)
    }

    /// For each row of a table whether it meets the condition.
    fn met(&self, batch: &Arc<Batch>, kind: TableKind) -> Vec<bool> {
        let table = Table::new(Arc::clone(batch), kind);
        let condition = self.conditions.iter().find(|one| one.kind == kind);
        (0..table.len()).map(|row| condition.is_some_and(|condition| condition.holds(&table, row))).collect()
    }

    fn transactions(&mut self, batch: &mut Batch, met: &[bool]) {
        let mut met = met.iter();
        let buses = Arc::clone(&batch.buses);
        batch.transactions.retain(|row| {
            self.decided = self.decided.max(row.number);
            let is_chosen = *met.next().unwrap_or(&false);
            if is_chosen {
                self.chosen.insert(row.number);
                self.connections.extend(buses[row.bus as usize].network.as_ref().map(|network| network.connection));
            }
            is_chosen
        });
    }

    /// Puts the chosen frames among those that are decided into the batch.
    fn frames(&mut self, batch: &mut Batch, met: &[bool]) {
        for (row, &is_met) in take(&mut batch.frames).into_iter().zip(met) {
            let (wire, codes) = (row.wire.of(&batch.arena).to_vec(), row.findings.of(&batch.codes).to_vec());
            self.frames.push_back(WaitingFrame { row, wire, codes, is_met });
        }
        while self.frames.front().is_some_and(|waiting| self.is_decided(waiting.row.txn)) {
            let Some(WaitingFrame { mut row, wire, codes, is_met }) = self.frames.pop_front() else { break };
            if self.is_chosen(row.txn, is_met) {
                row.wire = batch.store(&wire);
                row.findings = batch.store_findings(&codes);
                batch.frames.push(row);
            }
        }
    }

    /// The same for findings.
    fn findings(&mut self, batch: &mut Batch, met: &[bool]) {
        self.findings.extend(take(&mut batch.findings).into_iter().zip(met.iter().copied()));
        while self.findings.front().is_some_and(|(row, _)| self.is_decided(row.txn)) {
            let Some((row, is_met)) = self.findings.pop_front() else { break };
            if self.is_chosen(row.txn, is_met) {
                batch.findings.push(row);
            }
        }
        while self.chosen.len() > MAX_CHOSEN {
            self.chosen.pop_first();
        }
    }

    fn is_decided(&self, txn: Option<u64>) -> bool {
        txn.is_none_or(|txn| txn <= self.decided)
    }

    fn is_chosen(&self, txn: Option<u64>, is_met: bool) -> bool {
        txn.map_or(is_met, |txn| self.chosen.contains(&txn))
    }
}
