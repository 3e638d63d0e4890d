//! Parquet and Arrow files.
//!
//! Both give their bytes piece by piece, so that they can be written while rows are still to come.

use std::collections::HashMap;

use arrow_ipc::writer::FileWriter;
use arrow_schema::{ArrowError, Schema};

use super::arrow::{batch_of, schema_of};
use super::parquet::Parquet;
use modlens_tables::columns::{Table, TableKind};

/// A file of rows of one table.
pub struct RowFile(Option<Writer>);

enum Writer {
    Arrow(Vec<usize>, Box<FileWriter<Vec<u8>>>),
    Parquet(Box<Parquet>),
}

/// The schema with what a reader may want to know of its writer.
fn described(kind: TableKind, columns: &[usize], version: &str) -> Schema {
    let schema = schema_of(kind, columns);
    let schema_version = modlens_tables::columns::version();
    let metadata: HashMap<String, String> = [
        ("modlens.table", kind.name().to_owned()),
        ("modlens.schema_version", schema_version.to_string()),
        ("modlens.version", version.to_owned()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into();
    schema.with_metadata(metadata)
}

impl RowFile {
    /// An Arrow file (the IPC format with a footer, also called Feather 2).
    pub fn arrow(kind: TableKind, columns: Vec<usize>, version: &str) -> Result<Self, ArrowError> {
        let writer = FileWriter::try_new(Vec::new(), &described(kind, &columns, version))?;
        Ok(Self(Some(Writer::Arrow(columns, Box::new(writer)))))
    }

    /// A Parquet file: zstd, dictionaries where values are few, times as differences.
    pub fn parquet(kind: TableKind, columns: Vec<usize>, version: &str) -> Result<Self, ArrowError> {
        let file = Parquet::new(kind, &columns, &described(kind, &columns, version), version)?;
        Ok(Self(Some(Writer::Parquet(Box::new(file)))))
    }

    /// Takes the rows of a table; `out` gets what can be written.
    pub fn rows(&mut self, table: &Table, out: &mut Vec<u8>) -> Result<(), ArrowError> {
        match &mut self.0 {
            Some(Writer::Arrow(columns, writer)) => {
                if !table.is_empty() {
                    let batch = batch_of(table, 0..table.len(), columns).with_schema(writer.schema().clone())?;
                    writer.write(&batch)?;
                }
                out.append(writer.get_mut());
            }
            Some(Writer::Parquet(writer)) => writer.rows(table, out)?,
            None => {}
        }
        Ok(())
    }

    /// The end of the file.
    pub fn end(&mut self, out: &mut Vec<u8>) -> Result<(), ArrowError> {
        match self.0.take() {
            Some(Writer::Arrow(_, mut writer)) => {
                writer.finish()?;
                out.append(writer.get_mut());
            }
            Some(Writer::Parquet(writer)) => writer.end(out)?,
            None => {}
        }
        Ok(())
    }
}
