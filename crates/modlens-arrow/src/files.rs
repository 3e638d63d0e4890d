//! Parquet and Arrow files.
//!
//! Both give their bytes block by block, so that they can be written while rows are still to come.

use std::collections::HashMap;
use std::error::Error;

use arrow_ipc::writer::FileWriter;

use super::batch::{batch_of, schema_of};
use super::parquet::Parquet;
use modlens_tables::columns::{Table, TableKind};

/// What can go wrong is said by either library in words of its own.
pub type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

/// A file of rows of one table.
pub struct RowFile(Option<Writer>);

enum Writer {
    Arrow(Vec<usize>, Box<FileWriter<Vec<u8>>>),
    Parquet(Box<Parquet>),
}

/// What a reader may want to know of a file's writer.
fn metadata(kind: TableKind, version: &str) -> [(&'static str, String); 3] {
    [
        ("modlens.table", kind.name().to_owned()),
        ("modlens.schema_version", modlens_tables::columns::version().to_string()),
        ("modlens.version", version.to_owned()),
    ]
}

impl RowFile {
    /// An Arrow file (the IPC format with a footer, also called Feather 2).
    pub fn arrow(kind: TableKind, columns: Vec<usize>, version: &str) -> Result<Self> {
        let metadata: HashMap<String, String> = metadata(kind, version).map(|(key, value)| (key.to_owned(), value)).into();
        let writer = FileWriter::try_new(Vec::new(), &schema_of(kind, &columns).with_metadata(metadata))?;
        Ok(Self(Some(Writer::Arrow(columns, Box::new(writer)))))
    }

    /// A Parquet file: zstd, dictionaries where values are few, times as differences.
    pub fn parquet(kind: TableKind, columns: Vec<usize>, version: &str) -> Result<Self> {
        let file = Parquet::new(kind, &columns, &metadata(kind, version), version)?;
        Ok(Self(Some(Writer::Parquet(Box::new(file)))))
    }

    /// Takes the rows of a table; `out` gets what can be written.
    pub fn rows(&mut self, table: &Table, out: &mut Vec<u8>) -> Result<()> {
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
    pub fn end(&mut self, out: &mut Vec<u8>) -> Result<()> {
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
