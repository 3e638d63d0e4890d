//! The family of workloads that speed is measured on: kinds of ordinary traffic, none of which repeats its bytes.
//!
//! `kinds` is the table, `traffic` makes the exchanges, `written` writes them as a recording and counts what is in it.

pub mod kinds;
mod traffic;
pub mod written;
