//! Rows as columns: Arrow record batches, Arrow files and Parquet files.
//!
//! - `batch` makes record batches; Python gets them by the C data interface.
//! - `files` writes both kinds of files block by block, `parquet` feeds the column writers of the library.
//! - `values` collects the values of a column. It receives them through `CellSink`: the reader of a column is compiled
//!   together with it.
//! - `rows_to_columns` goes through rows. Compact exchanges are taken many at a time where they can be (`column_values`,
//!   `of_exchanges`), and what follows from the kind of an exchange is read once (`kinds`).
//!
//! It is a crate of its own because of that: a change in a writer of text does not compile these readers, nor the generic
//! code of the libraries, again.

mod array_in_making;
mod arrays;
pub mod batch;
mod column_values;
#[cfg(feature = "files")]
pub mod files;
mod given;
mod kinds;
mod of_exchanges;
#[cfg(feature = "files")]
mod parquet;
mod rows_to_columns;
mod validity;
mod values;
