//! What comes in: chunks of bytes with their marks, recordings in text, captures of networks, logic samples.

pub mod chunk;
pub mod logic;
pub mod pace;
pub mod parmrk;
pub mod pcap;
pub mod text;
