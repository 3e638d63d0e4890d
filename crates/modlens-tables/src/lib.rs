//! Columns of the tables, filters over rows, and register maps collected from rows.

pub mod cell_text;
pub mod columns;
pub mod latest_values;
pub mod predicate;
pub mod register_survey;
