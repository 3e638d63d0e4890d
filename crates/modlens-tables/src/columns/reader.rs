//! The compiled readers of columns.

use modlens_engine::records::{Connection, DiagnosisRow, FindingRow, Frame};

use crate::columns::exchange_ref::ExchangeRef;
use crate::columns::row_columns::{Emit, EmitExchanges, EmitTransaction};

/// The compiled reader of one column, for one kind of writer.
pub struct ColumnReader<S>(pub(super) RowReader<S>);

impl<S> ColumnReader<S> {
    /// Passes the values of compact exchanges to a writer.
    #[inline]
    pub fn pass_exchanges(&self, exchanges: &[ExchangeRef<'_>], to: &mut S) {
        // The reader of another table has nothing to do with exchanges.
        if let RowReader::Transaction(_, pass) = &self.0 {
            pass(exchanges, to);
        }
    }
}

/// How the reader gets its value, by table.
pub(super) enum RowReader<S> {
    Frame(Emit<Frame, S>),
    /// That of rows, and that of compact exchanges.
    Transaction(EmitTransaction<S>, EmitExchanges<S>),
    Finding(Emit<FindingRow, S>),
    Connection(Emit<Connection, S>),
    Diagnosis(Emit<DiagnosisRow, S>),
    /// The index of a column of readings, which are not compiled for each writer.
    Reading(usize),
}
