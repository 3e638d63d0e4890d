//! How rows are read: columns, filters, and register maps collected over rows.

pub mod cell_text;
pub mod columns;
pub mod latest;
pub mod predicate;
pub mod survey;
