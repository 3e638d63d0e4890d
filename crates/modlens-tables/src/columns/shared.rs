//! What the rows of a batch share.

use std::sync::Arc;

use modlens_engine::records::Buses;
use modlens_protocol::functions::Functions;

use crate::columns::table::Table;

/// The buses of the rows of a batch, the table of functions that decodes them, and whether a profile applies to any: what follows
/// from these and the kind of an exchange is the same in all batches that share them. To hold them means that no other ones come to
/// lie in their place.
#[derive(Clone, Debug)]
pub struct SharedByRows {
    buses: Arc<Buses>,
    functions: Option<Arc<Functions>>,
    has_points: bool,
}

impl SharedByRows {
    /// What the rows of this table share.
    pub fn of(table: &Table) -> Self {
        let batch = &table.batch;
        Self { buses: Arc::clone(&batch.buses), functions: batch.functions.clone(), has_points: batch.has_points() }
    }

    /// Whether the rows of this table share the same.
    pub fn is_shared_by(&self, table: &Table) -> bool {
        let functions = match (&self.functions, &table.batch.functions) {
            (Some(one), Some(other)) => Arc::ptr_eq(one, other),
            (one, other) => one.is_none() && other.is_none(),
        };
        functions && Arc::ptr_eq(&self.buses, &table.batch.buses) && self.has_points == table.batch.has_points()
    }
}
