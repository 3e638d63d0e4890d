//! Which tables there are, and which columns they have: `analyzer/columns.toml`, read once.

use std::sync::OnceLock;

use serde_json::Value as Json;

use super::tables::{Findings, Frames, Transactions, OF_THE_BUS};
use super::{Put, Reader, Way};

/// The embedded columns.
pub const COLUMNS: &str = include_str!("../../../../analyzer/columns.toml");

/// Names of the tables, as options spell them.
pub const TABLES: [&str; 4] = ["frames", "transactions", "readings", "findings"];

/// The version of the columns, which travels in files that have a place for it.
pub fn version() -> u64 {
    static VERSION: OnceLock<u64> = OnceLock::new();
    *VERSION.get_or_init(|| {
        let file: Json = toml::from_str(COLUMNS).expect("the embedded columns are tested");
        file["version"].as_u64().expect("a version")
    })
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// int64.
    Int,
    /// Microseconds, float64.
    Us,
    /// timestamp[ns, UTC].
    Time,
    /// float64.
    Float,
    /// bool.
    Bool,
    /// utf8, bytes as hex among them.
    Text,
    /// list of int32.
    Ints,
    /// list of utf8.
    Texts,
    /// JSON text.
    Map,
}

/// A column as `columns.toml` has it.
#[derive(Clone, Debug)]
pub struct Column {
    /// Name.
    pub key: String,
    /// Type.
    pub kind: Kind,
}

/// Which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// One row a frame.
    Frames,
    /// One row a transaction.
    Transactions,
    /// One row a register or bit.
    Readings,
    /// One row a finding.
    Findings,
}

impl TableKind {
    /// The table of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let kinds = [Self::Frames, Self::Transactions, Self::Readings, Self::Findings];
        TABLES.iter().position(|table| *table == name).map(|i| kinds[i])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        TABLES[self as usize]
    }

    /// Its columns, in order.
    pub fn columns(self) -> &'static [Column] {
        static ALL: OnceLock<Vec<Vec<Column>>> = OnceLock::new();
        let all = ALL.get_or_init(|| {
            let file: Json = toml::from_str(COLUMNS).expect("the embedded columns are tested");
            TABLES.iter().map(|table| file[*table].as_array().expect("a list").iter().map(column).collect()).collect()
        });
        &all[self as usize]
    }

    /// How a column is read for writers of this kind.
    pub fn reader<S: Put>(self, column: usize) -> Reader<S> {
        Reader(match self {
            Self::Frames => Way::Frame(Frames::pass(column)),
            Self::Transactions => Way::Transaction(Transactions::pass(column)),
            Self::Findings => Way::Finding(Findings::pass(column)),
            Self::Readings => Way::Reading(column),
        })
    }

    /// Whether all rows of a bus have the same value in this column.
    pub fn of_the_bus(self, column: usize) -> bool {
        self != Self::Readings && OF_THE_BUS.contains(&self.columns()[column].key.as_str())
    }

    /// The place of a column, or all known names in the error.
    pub fn column(self, key: &str) -> Result<usize, String> {
        let columns = self.columns();
        columns.iter().position(|column| column.key == key).ok_or_else(|| {
            let known: Vec<&str> = columns.iter().map(|column| column.key.as_str()).collect();
            format!("{} has no column {key:?}; it has {}", self.name(), known.join(", "))
        })
    }
}

fn column(row: &Json) -> Column {
    let kind = match row["type"].as_str() {
        Some("int") => Kind::Int,
        Some("us") => Kind::Us,
        Some("time") => Kind::Time,
        Some("float") => Kind::Float,
        Some("bool") => Kind::Bool,
        Some("ints") => Kind::Ints,
        Some("texts") => Kind::Texts,
        Some("map") => Kind::Map,
        Some("text" | "hex") => Kind::Text,
        other => panic!("columns.toml: unknown type {other:?}"),
    };
    Column { key: row["key"].as_str().expect("a key").to_owned(), kind }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::readings::READINGS;

    #[test]
    fn every_column_of_the_file_has_its_line_here() {
        let here: [Vec<&str>; 4] =
            [Frames::KEYS.to_vec(), Transactions::KEYS.to_vec(), READINGS.iter().map(|c| c.0).collect(), Findings::KEYS.to_vec()];
        for (kind, here) in
            [TableKind::Frames, TableKind::Transactions, TableKind::Readings, TableKind::Findings].iter().zip(here)
        {
            let there: Vec<&str> = kind.columns().iter().map(|column| column.key.as_str()).collect();
            assert_eq!(here, there, "{}", kind.name());
        }
    }
}
