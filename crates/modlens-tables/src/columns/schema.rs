//! The tables and their columns, read once from `analyzer/columns.toml`.

use std::sync::OnceLock;

use serde_json::Value as Json;

use super::reader::{ColumnReader, RowReader};
use super::reading_columns::BLOCK_COLUMNS;
use super::row_columns::{Connections, Diagnoses, Findings, Frames, Transactions, BUS_COLUMNS, EXCHANGE_KIND_COLUMNS};
use super::sink::CellSink;
use modlens_protocol::renamed::{current, Vocabulary};

/// The embedded definition of the columns.
const COLUMNS: &str = include_str!("../../../../analyzer/columns.toml");

/// The names of the tables in options.
pub const TABLES: [&str; 6] = ["frames", "transactions", "readings", "findings", "connections", "diagnoses"];

/// The embedded definition as plain data: `version`, and a list of columns for each table.
pub fn definition() -> &'static Json {
    static DEFINITION: OnceLock<Json> = OnceLock::new();
    DEFINITION.get_or_init(|| toml::from_str(COLUMNS).expect("the embedded columns are tested"))
}

/// The version of the columns, which is written into file formats that have a field for it.
pub fn version() -> u64 {
    definition()["version"].as_u64().expect("a version")
}

/// The type of a column's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnType {
    /// An integer (int64).
    Int,
    /// A duration in microseconds (float64).
    Us,
    /// A time (timestamp in ns, UTC).
    Time,
    /// A number (float64).
    Float,
    /// A truth value.
    Bool,
    /// Text (utf8); bytes are shown as hex.
    Text,
    /// A list of int32.
    Ints,
    /// A list of utf8.
    Texts,
    /// A JSON object, as text.
    Map,
}

/// A column as `columns.toml` has it.
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name.
    pub key: String,
    /// The type of its values.
    pub kind: ColumnType,
}

/// One of the tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// One row per frame.
    Frames,
    /// One row per transaction.
    Transactions,
    /// One row per register, bit, or value of a profile.
    Readings,
    /// One row per finding.
    Findings,
    /// One row per TCP connection of a capture.
    Connections,
    /// One row per cause of trouble.
    Diagnoses,
}

impl TableKind {
    /// All tables, in the order of their names.
    pub const ALL: [Self; 6] =
        [Self::Frames, Self::Transactions, Self::Readings, Self::Findings, Self::Connections, Self::Diagnoses];

    /// The table of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        TABLES.iter().position(|table| *table == name).map(|i| Self::ALL[i])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        TABLES[self as usize]
    }

    /// What one of its rows is called.
    pub fn row_name(self) -> &'static str {
        match self {
            Self::Diagnoses => "diagnosis",
            _ => self.name().trim_end_matches('s'),
        }
    }

    /// Its columns, in order.
    pub fn columns(self) -> &'static [Column] {
        static ALL: OnceLock<Vec<Vec<Column>>> = OnceLock::new();
        let all = ALL.get_or_init(|| {
            let file = definition();
            TABLES.iter().map(|table| file[*table].as_array().expect("a list").iter().map(column).collect()).collect()
        });
        &all[self as usize]
    }

    /// The reader of a column for one kind of writer.
    pub fn reader<S: CellSink>(self, column: usize) -> ColumnReader<S> {
        ColumnReader(match self {
            Self::Frames => RowReader::Frame(Frames::emit(column)),
            Self::Transactions => RowReader::Transaction(Transactions::emit(column), Transactions::emit_exchanges(column)),
            Self::Findings => RowReader::Finding(Findings::emit(column)),
            Self::Connections => RowReader::Connection(Connections::emit(column)),
            Self::Diagnoses => RowReader::Diagnosis(Diagnoses::emit(column)),
            Self::Readings => RowReader::Reading(column),
        })
    }

    /// Whether all rows of a bus have the same value in this column.
    fn is_constant_per_bus(self, column: usize) -> bool {
        !matches!(self, Self::Readings | Self::Connections | Self::Diagnoses)
            && BUS_COLUMNS.contains(&self.columns()[column].key.as_str())
    }

    /// Whether rows have the same value in this column as others of their group (`RowRef::group`).
    pub fn is_constant_per_group(self, column: usize) -> bool {
        match self {
            Self::Readings => BLOCK_COLUMNS.contains(&self.columns()[column].key.as_str()),
            _ => self.is_constant_per_bus(column),
        }
    }

    /// Whether all compact exchanges of a bus and a kind have the same value in this column, if they have one.
    pub fn is_constant_per_exchange_kind(self, column: usize) -> bool {
        self.is_constant_per_bus(column) || EXCHANGE_KIND_COLUMNS.contains(&self.columns()[column].key.as_str())
    }

    /// The column with the time of a row: when it happened, or began.
    pub fn time_column(self) -> &'static str {
        match self {
            Self::Connections => "opened",
            Self::Diagnoses => "since",
            _ => "time",
        }
    }

    /// The index of a column. The error lists the known names.
    pub fn column(self, key: &str) -> Result<usize, String> {
        let key = current(Vocabulary::Column, key);
        let columns = self.columns();
        columns.iter().position(|column| column.key == key).ok_or_else(|| {
            let known: Vec<&str> = columns.iter().map(|column| column.key.as_str()).collect();
            format!("{} has no column {key:?}; it has {}", self.name(), known.join(", "))
        })
    }
}

/// A column from its row in the file.
fn column(row: &Json) -> Column {
    let kind = match row["type"].as_str() {
        Some("int") => ColumnType::Int,
        Some("us") => ColumnType::Us,
        Some("time") => ColumnType::Time,
        Some("float") => ColumnType::Float,
        Some("bool") => ColumnType::Bool,
        Some("ints") => ColumnType::Ints,
        Some("texts") => ColumnType::Texts,
        Some("map") => ColumnType::Map,
        Some("text" | "hex") => ColumnType::Text,
        other => panic!("columns.toml: unknown type {other:?}"),
    };
    Column { key: row["key"].as_str().expect("a key").to_owned(), kind }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::reading_columns::READINGS;

    #[test]
    fn columns_of_the_file_and_of_the_code_agree() {
        let in_code: [Vec<&str>; 6] = [
            Frames::KEYS.to_vec(),
            Transactions::KEYS.to_vec(),
            READINGS.iter().map(|c| c.0).collect(),
            Findings::KEYS.to_vec(),
            Connections::KEYS.to_vec(),
            Diagnoses::KEYS.to_vec(),
        ];
        for (kind, in_code) in TableKind::ALL.iter().zip(in_code) {
            let in_file: Vec<&str> = kind.columns().iter().map(|column| column.key.as_str()).collect();
            assert_eq!(in_code, in_file, "{}", kind.name());
        }
    }
}
