//! The report: the document of a recording, and its HTML.
//!
//! The document is JSON (docs/stats.schema.json describes it); one from elsewhere may lack anything, which is then left out.
//!
//! - `document` makes it of what has been counted; `sources` says how each recording was read, `summary` is what stands at the
//!   top.
//! - `layout` is the table of sections (`analyzer/report/layout.toml`), `rows` finds the rows of a table in the document.
//! - `texts` writes values, `cells` the cells of a column, `tables` whole tables.
//! - `causes` and `examples` are what the doctor says, and the transactions that it names.
//! - `html` puts all of it together. Text becomes HTML in there only, and is escaped there.

mod causes;
mod cells;
mod document;
mod examples;
mod html;
mod layout;
mod rows;
mod sources;
mod summary;
mod tables;
mod texts;

pub use document::{document, Parts};
pub use html::{body, title};
pub use layout::layout;
