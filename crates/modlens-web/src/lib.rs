//! The border to a page in a browser.
//!
//! A worker of the page calls the functions of `abi`: bytes and JSON go in, bytes and JSON come out. [`Decoding`] reads
//! one recording; [`answer`] says what was found in it. Nothing here decides anything: the format is the choice of
//! `modlens-recording`, rows and causes come from the engine and the doctor,
//! the HTML of a report is that of `modlens-report`.

// The functions that WebAssembly exports pass pointers into its memory.
#[cfg(target_arch = "wasm32")]
#[allow(unsafe_code)]
mod abi;
mod annotated;
mod answers;
mod decoding;
mod export;
mod listening;
mod port;
mod registers;
mod report;
mod view;
mod words;

pub use answers::answer;
pub use decoding::{Decoding, Purpose};
pub use registers::check_profile;
pub use report::report;
pub use words::words;
