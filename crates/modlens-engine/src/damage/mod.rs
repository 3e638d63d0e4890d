//! Is it noise, or a damaged frame?

pub(crate) mod alignment;
pub(crate) mod ascii;
pub(crate) mod candidates;
pub(crate) mod chain;
pub(crate) mod crc_correction;
pub(crate) mod expected_frame;
pub(crate) mod fragments;
pub mod kind;
pub(crate) mod recovery;
pub(crate) mod region;
pub(crate) mod truncation;
