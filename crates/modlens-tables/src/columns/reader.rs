//! The compiled readers of columns.

use modlens_engine::records::{Connection, DiagnosisRow, FindingRow, Frame};

use crate::columns::row_columns::{Emit, EmitTransaction};

/// The compiled reader of one column, for one kind of writer.
pub struct ColumnReader<S>(pub(super) RowReader<S>);

/// How the reader gets its value, by table.
pub(super) enum RowReader<S> {
    Frame(Emit<Frame, S>),
    Transaction(EmitTransaction<S>),
    Finding(Emit<FindingRow, S>),
    Connection(Emit<Connection, S>),
    Diagnosis(Emit<DiagnosisRow, S>),
    /// The index of a column of readings, which are not compiled for each writer.
    Reading(usize),
}
