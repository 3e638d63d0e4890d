//! The rows of the table of functions that apply to a batch.

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::functions::{FunctionRow, Functions};

/// The table of functions that was used to decode the rows of a batch.
#[inline]
pub fn functions(batch: &Batch) -> &Functions {
    batch.functions.as_deref().unwrap_or_else(|| Functions::embedded())
}

/// The row of the table of functions for a transaction. The request selects the variant if it was observed, otherwise
/// the response.
#[inline]
pub fn row_of<'a>(batch: &'a Batch, t: &Transaction) -> Option<&'a FunctionRow> {
    let pdu = if t.request.pdu.length > 0 { t.request.pdu } else { t.response.pdu };
    functions(batch).row(t.function, pdu.of(&batch.arena).get(1..).unwrap_or(&[]))
}
