//! Rows as text, Arrow and captures, straight from the columns.

pub mod arrow;
pub mod capture;
pub mod csv;
#[cfg(feature = "files")]
pub mod files;
pub mod influx;
pub mod jsonl;
pub mod lines;
#[cfg(feature = "files")]
mod parquet;
pub mod recording;
mod values;
pub mod view;
pub mod zeek;

pub use lines::LineWriter;
