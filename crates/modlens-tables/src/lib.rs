//! The tables (frames, transactions, readings, findings, diagnoses): how their columns are read from rows, filters over rows,
//! and register maps collected from rows.
//!
//! - `columns` has one line per column. Writers, filters and the Python border see rows only through it.
//! - `cell_text` is the text of a value, as in CSV; filters compare this text.
//! - `predicate` evaluates filter expressions.
//! - `latest_values` keeps the last value of every register and point, `register_series` all values for searches,
//!   `register_survey` collects what a master reads and
//!   writes, for a first profile of a device, `overview` what happened over time, for reports.
//! - `selection` keeps the rows that a user has chosen, before anything is counted.

pub mod cell_text;
pub mod columns;
pub mod latest_values;
pub mod overview;
pub mod predicate;
pub mod register_series;
pub mod register_survey;
pub mod selection;
