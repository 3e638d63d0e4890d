//! The report: the HTML of a document of a recording.
//!
//! The document is JSON (docs/stats.schema.json describes it); one from elsewhere may lack anything, which is then left out.
//!
//! - `layout` is the table of sections (`analyzer/report/layout.toml`), `rows` finds the rows of a table in the document.
//! - `texts` writes values, `cells` the cells of a column, `tables` whole tables.
//! - `causes` and `examples` are what the doctor says, and the transactions that it names.
//! - `html` puts all of it together. Text becomes HTML in there only, and is escaped there.

mod causes;
mod cells;
mod examples;
mod html;
mod layout;
mod rows;
mod tables;
mod texts;

pub use html::{body, title};
pub use layout::layout;
