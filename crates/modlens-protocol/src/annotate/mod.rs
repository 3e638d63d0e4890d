//! Annotates the bytes of one frame: which bytes are what, as a list of blocks. The blocks cover the frame: joined, their
//! bytes are the frame again, however damaged it is.
//!
//! `modlens show`, `craft` and `explain`, the report and the page draw what is decided here. What a field is called and
//! permits is in the table of functions, what its numbers are called in `vocabulary.toml`.

mod body;
mod context;
mod field_meaning;
mod frame;
mod named_values;
mod names;
mod part;
mod piece;
mod violations;

pub use body::Body;
pub use frame::{annotate, has_checksum, pdu_of, Wrapping};
pub use names::exception_name;
pub use part::guess_direction;
pub use piece::{spaced_hex, Layer, Piece};

#[cfg(test)]
mod tests;
