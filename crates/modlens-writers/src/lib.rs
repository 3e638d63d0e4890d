//! Writes rows: as text and captures for programs, and as lines for people.
//!
//! - `lines` writes text formats with one row per line; `csv` and `jsonl` are its formats. `influx` and `zeek` write rows
//!   for other programs in their own formats.
//! - `capture` writes frames as pcapng or pcap for Wireshark.
//! - `mqtt` reads addresses of brokers and makes topics.
//! - `view` lays rows out in columns for a terminal.
//!
//! `csv` and `jsonl` receive values through `CellSink`: the reader of a column is compiled together with each of them.
//!
//! Captures are Modbus/UDP inside exported PDUs, because Wireshark's RTU dissector guesses who speaks and leaves most
//! functions undecoded; `capture::payload` says how. What most frames have is not said in a capture
//! (`modlens_readers::pcap::metadata::DEFAULTS`). Files go out in blocks of 64 KiB, made in the same memory again.

pub mod capture;
pub mod csv;
mod exchange_lines;
pub mod influx;
pub mod jsonl;
pub mod line_format;
pub mod lines;
pub mod mqtt;
mod text_block;
pub mod view;
pub mod zeek;

pub use lines::LineWriter;
pub use text_block::{Separator, TextBlock, BLOCK_BYTES};
