//! Parquet and Arrow files, from the columns by arrow-rs.
//!
//! Both give their bytes piece by piece, so that they can be written while rows are still to come.

use std::collections::HashMap;
use std::io::Write;
use std::sync::{Arc, Mutex};

use arrow_ipc::writer::FileWriter;
use arrow_schema::{ArrowError, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;

use super::arrow::{batch_of, schema_of};
use crate::columns::{Kind, Table, TableKind};

/// Rows that a part of a Parquet file holds; its columns are in memory until it is complete.
const ROW_GROUP: usize = 65_536;

/// Rows that are Arrow columns at the same time on their way to Parquet. Larger columns are fresh memory each time, and
/// leave the processor's cache before they are encoded.
const AT_ONCE: usize = 1024;

/// Bytes of a page before compression, for the same reason: a tenth less time than with the usual megabyte, and a hundredth
/// more bytes.
const PAGE: usize = 1 << 16;

/// Values of a column between two looks at how full its page is: a list of registers is many values.
const BETWEEN_LOOKS: usize = 8192;

/// Columns with few different values: a dictionary makes them small. On all others it costs time and room.
const FEW_VALUES: [&str; 21] = [
    "bus",
    "line",
    "client",
    "server",
    "connection",
    "mode",
    "direction",
    "unit",
    "function",
    "function_name",
    "exception",
    "exception_name",
    "verdict",
    "cut_by",
    "operation",
    "register_type",
    "status",
    "code",
    "severity",
    "evidence",
    "advice",
];

/// Bytes that a writer made and nobody has taken yet.
#[derive(Clone, Default)]
struct Made(Arc<Mutex<Vec<u8>>>);

impl Made {
    fn take(&self, out: &mut Vec<u8>) {
        out.append(&mut self.0.lock().expect("nobody panics with it"));
    }
}

impl Write for Made {
    fn write(&mut self, data: &[u8]) -> std::io::Result<usize> {
        self.0.lock().expect("nobody panics with it").extend_from_slice(data);
        Ok(data.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

enum Writer {
    Arrow(Box<FileWriter<Made>>),
    Parquet(Box<ArrowWriter<Made>>),
}

/// A file of rows of one table.
pub struct RowFile {
    columns: Vec<usize>,
    made: Made,
    writer: Option<Writer>,
}

/// The schema with what a reader may want to know of its writer.
fn described(kind: TableKind, columns: &[usize], version: &str) -> Schema {
    let schema = schema_of(kind, columns);
    let schema_version = crate::columns::version();
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
        let made = Made::default();
        let writer = FileWriter::try_new(made.clone(), &described(kind, &columns, version))?;
        Ok(Self { columns, made, writer: Some(Writer::Arrow(Box::new(writer))) })
    }

    /// A Parquet file: zstd, dictionaries where values are few, times as differences.
    pub fn parquet(kind: TableKind, columns: Vec<usize>, version: &str) -> Result<Self, ArrowError> {
        let made = Made::default();
        let schema = described(kind, &columns, version);
        let mut properties = WriterProperties::builder()
            .set_created_by(format!("modlens {version}"))
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
            .set_data_page_size_limit(PAGE)
            .set_write_batch_size(BETWEEN_LOOKS)
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_max_row_group_row_count(Some(ROW_GROUP));
        for &column in &columns {
            let column = &kind.columns()[column];
            let path = ColumnPath::from(column.key.as_str());
            if FEW_VALUES.contains(&column.key.as_str()) {
                properties = properties.set_column_dictionary_enabled(path, true);
            } else if matches!(column.kind, Kind::Int | Kind::Time) {
                properties = properties.set_column_encoding(path, Encoding::DELTA_BINARY_PACKED);
            } else if matches!(column.kind, Kind::Text | Kind::Map) {
                // The least and the greatest of bytes in hex help no query, and are a quarter of the work.
                properties = properties.set_column_statistics_enabled(path, EnabledStatistics::None);
            } else if column.kind == Kind::Ints {
                // Nor do those of all registers of a device.
                let items = [column.key.as_str(), "list", "item"].map(str::to_owned).to_vec();
                properties = properties.set_column_statistics_enabled(ColumnPath::new(items), EnabledStatistics::None);
            }
        }
        let writer = ArrowWriter::try_new(made.clone(), Arc::new(schema), Some(properties.build()))?;
        Ok(Self { columns, made, writer: Some(Writer::Parquet(Box::new(writer))) })
    }

    /// Takes the rows of a table; `out` gets what can be written.
    pub fn rows(&mut self, table: &Table, out: &mut Vec<u8>) -> Result<(), ArrowError> {
        match self.writer.as_mut() {
            Some(Writer::Arrow(writer)) if !table.is_empty() => {
                let batch = batch_of(table, 0..table.len(), &self.columns).with_schema(Arc::clone(writer.schema()))?;
                writer.write(&batch)?;
            }
            Some(Writer::Parquet(writer)) => {
                for start in (0..table.len()).step_by(AT_ONCE) {
                    writer.write(&batch_of(table, start..table.len().min(start + AT_ONCE), &self.columns))?;
                }
            }
            _ => {}
        }
        self.made.take(out);
        Ok(())
    }

    /// The end of the file.
    pub fn end(&mut self, out: &mut Vec<u8>) -> Result<(), ArrowError> {
        match self.writer.take() {
            Some(Writer::Arrow(mut writer)) => writer.finish()?,
            Some(Writer::Parquet(writer)) => drop(writer.close()?),
            None => {}
        }
        self.made.take(out);
        Ok(())
    }
}
