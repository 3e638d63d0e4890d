//! A recording from its first bytes to its last rows.
//!
//! [`format::decide`] chooses the format, for every face of modlens: the command line asks it through the border, the page
//! through `modlens-web`. [`Recording`] feeds a session with a recording whose bytes come block by block, as in the page.
//! Files, pipes and archives are not known here.

pub mod format;
mod recording;

pub use recording::{Options, Recording};
