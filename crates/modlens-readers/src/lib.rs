//! What comes in: chunks of bytes with their marks, recordings in text, captures of networks, logic samples.
//!
//! A reader takes blocks of a file as they come and gives the bytes of the line (`chunk`) with what the source knows of them:
//! times, who sent them, where a record starts, line errors, lost bytes. It opens no file, and it frames nothing; that is the
//! engine's. What a reader drops (printed copies, wrappers, retransmissions, lines that it cannot parse) is counted and listed.
//!
//! **Text** (`text`) is read line by line, by the rows of `analyzer/sources/dialects.toml` that the file needs: the first row
//! that can read a line to its end has it. Where the bytes of a row may begin is found in one pass for all of its rules. A
//! line that none of them reads is tried with all other rows, alone or with the lines before it, and a checksum has to prove
//! what they find. So a file may mix dialects, and one may begin after the bytes that were looked at first. What waits for a
//! further line (a frame printed over several, the last word of a dump) is delivered by the next entry, the end, or `settle`,
//! which `--follow` calls after half a second.
//!
//! **Captures** (`pcap`): a segment waits until everything that its sender had acknowledged has been handed on, so that a
//! response never comes before its request, however a mirror port mixes the two directions: their time stamps come from two
//! queues, the ACK number does not lie. `pcap::classify` looks at the first bytes of a connection and says whether it is Modbus,
//! and in which framing. Connections and their waiting bytes are bounded. Captures that modlens has written say so in custom
//! options (`pcap::metadata`): the ports of a raw recording are lines of its buses, and exported frames are read back as they
//! were reported, because the file may lack the bytes around them that decided.
//!
//! **Logic samples** (`logic`) become characters: which channels are serial lines, and their settings, is found from the edges.
//!
//! `parmrk` and `pace` are for live ports: line errors in a driver's words, and how often a busy line is read.

pub mod chunk;
pub mod logic;
pub mod pace;
pub mod parmrk;
pub mod pcap;
pub mod text;
