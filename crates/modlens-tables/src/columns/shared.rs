//! What the rows of a batch share.

use std::sync::Arc;

use modlens_engine::records::Buses;
use modlens_protocol::functions::Functions;

use crate::columns::table::Table;

/// The buses of the rows of a batch, and the table of functions that decodes them: what follows from these two and the kind of an
/// exchange is the same in all batches that share them.
#[derive(Clone, Debug)]
pub struct SharedByRows {
    buses: Arc<Buses>,
    functions: Option<Arc<Functions>>,
}

impl SharedByRows {
    /// What the rows of this table share.
    pub fn of(table: &Table) -> Self {
        Self { buses: Arc::clone(&table.batch.buses), functions: table.batch.functions.clone() }
    }

    /// Whether the rows of this table share the same.
    pub fn is_shared_by(&self, table: &Table) -> bool {
        let functions = match (&self.functions, &table.batch.functions) {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (one, other) => one.is_none() && other.is_none(),
        };
        functions && Arc::ptr_eq(&self.buses, &table.batch.buses)
    }
}
