//! What a session makes of the exchanges that the fast path takes: rows, statistics, and what framer and pairing learn.
//!
//! | where an exchange is found | file |
//! |--|--|
//! | in a block of an RTU line without a clock, compact | `contiguous` (`compact_run`) |
//! | at the head of any other RTU or ASCII line | `heads` |
//! | in the packets of a connection or the lines of a log with times, as they come | `messages` (`message_run`, `message_runs`; reads of the memo: `known_pairs`) |
//!
//! `matching` decides whether a request and the bytes after it are an exchange, `emit` makes rows or a compact exchange of it and
//! learns from it, `run` has what stays the same in a run of exchanges. What qualifies, and why the rows are those of the slow
//! path, is described in `fast_path`.

mod compact_run;
mod contiguous;
mod emit;
mod heads;
mod known_pairs;
mod matching;
pub(crate) mod message_run;
pub(crate) mod message_runs;
mod messages;
mod run;

use crate::framer::Framer;
use crate::session::decoder::Decoder;
use modlens_protocol::framing::Mode;

impl Decoder {
    /// Emits the exchanges at the head of the only line of the bus with this index, as long as each of them qualifies for the
    /// fast path. The caller goes on frame by frame after them.
    ///
    /// Does nothing if the bus's clock went back, if a request is outstanding or anything else of an earlier frame is undecided, or
    /// if the bus is not a single RTU or ASCII line.
    pub(crate) fn emit_exchanges(&mut self, bus: usize) {
        let state = &self.buses[bus];
        let [(_, line)] = &state.lines[..] else { return };
        if state.clock_jumped || !state.pairing.is_idle() || !line.is_settled() {
            return;
        }
        match line.framer.mode() {
            Mode::Rtu if self.emits_compact(bus) => self.emit_contiguous(bus),
            mode @ (Mode::Rtu | Mode::Ascii) => self.emit_heads(bus, mode),
            Mode::Tcp => {}
        }
    }
}
