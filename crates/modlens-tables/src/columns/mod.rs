//! The columns of the tables: each is one line that reads its value from a row. `analyzer/columns.toml` has their types
//! and descriptions.
//!
//! Writers, filters and the Python border see rows only through `Table` and its columns.

mod bus_cells;
mod cell;
mod column_value;
mod exchange_chunk;
mod exchange_ref;
mod exchange_value;
mod fields;
mod function_rows;
mod identification;
mod reader;
mod reading_blocks;
mod reading_columns;
mod reading_rows;
mod row_columns;
mod schema;
mod shared;
mod sink;
mod table;
mod table_rows;
mod transaction_view;

pub use cell::{Cell, Items};
pub use exchange_chunk::{ExchangeChunk, ReadData, ReadLayout};
pub use exchange_ref::ExchangeRef;
pub use exchange_value::{ExchangeDuration, ExchangeNumber, ExchangeValue};
pub use fields::Fields;
pub use function_rows::{functions, row_of};
pub use reader::ColumnReader;
pub use reading_columns::{each_value, ReadingView};
pub use schema::{definition, version, Column, ColumnType, TableKind, TABLES};
pub use shared::SharedByRows;
pub use sink::CellSink;
pub use table::{RowRef, Table};
pub use table_rows::{RowChunk, TableRow};
pub use transaction_view::{blocks, exception_name, read_data, read_range, write_data, write_range, Blocks};
