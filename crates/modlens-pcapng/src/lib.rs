//! Writes blocks of pcapng, and raw recordings that are made of them.
//!
//! - `blocks` writes the blocks and options of pcapng and the records of classic pcap.
//! - `recording` writes the raw reads of a tap.
//!
//! Both are read by `modlens_readers::pcap`. A recorder needs them and nothing else of what writes; captures of decoded
//! frames are made of the same blocks (`modlens_writers::capture`).

pub mod blocks;
pub mod recording;
