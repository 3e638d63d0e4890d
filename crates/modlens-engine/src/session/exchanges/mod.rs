//! What a session makes of the exchanges that the fast path takes: rows, statistics, and what framer and pairing learn.
//!
//! | where an exchange is found | file |
//! |--|--|
//! | at the head of an RTU line: with rows, or compact | `rtu_batch`, `rtu_compact` (`compact_run`) |
//! | at the head of an ASCII line | `ascii_batch` |
//! | at the heads of the two lines of a connection | `tcp_batch` |
//! | in the packets of a connection as they come | `packet_pairs` (`packet_run`; reads of the memo: `known_pairs`) |
//! | in the lines of a log with times as they come | `line_pairs` (`line_run`) |
//!
//! They share `run` (what stays the same in a run of exchanges), `emit` and `rows`. What qualifies, and why the rows are those of
//! the slow path, is described in `fast_path`.

mod ascii_batch;
mod compact_run;
mod emit;
mod known_pairs;
mod line_pairs;
pub(crate) mod line_run;
mod packet_pairs;
pub(crate) mod packet_run;
mod rows;
mod rtu_batch;
mod rtu_compact;
mod run;
mod tcp_batch;

use crate::framer::Framer;
use crate::session::bus::FROM_SERVER;
use crate::session::Session;
use modlens_protocol::framing::Mode;

impl Session {
    /// Emits the exchanges at the heads of the lines of the bus with this index, as long as each of them qualifies for the
    /// fast path. The caller goes on frame by frame after them.
    ///
    /// Does nothing if the bus's clock went back, if one side of a connection has no bytes, if a request is outstanding (but for
    /// a connection, where each exchange has to leave it alone) or anything else of an earlier frame is undecided, or if the bus
    /// is neither a single RTU or ASCII line nor a TCP connection with a line for each side.
    pub(crate) fn emit_exchanges(&mut self, bus: usize) {
        let state = &self.buses[bus];
        let is_connection = state.options.bus.network.is_some() && state.lines.len() == 2;
        let is_idle = if is_connection { state.pairing.is_idle_but_for_open() } else { state.pairing.is_idle() };
        if is_connection && state.lines.iter().any(|(_, line)| line.input.bytes().is_empty()) {
            return;
        }
        if state.clock_jumped || !is_idle || !state.lines.iter().all(|(_, line)| line.is_settled()) {
            return;
        }
        match &state.lines[..] {
            [(_, line)] if line.framer.mode() == Mode::Rtu => self.emit_rtu_exchanges(bus),
            [(_, line)] if line.framer.mode() == Mode::Ascii => self.emit_ascii_exchanges(bus),
            [(first, line), _] if state.options.bus.network.is_some() && line.framer.mode() == Mode::Tcp => {
                let server_first = *first == FROM_SERVER;
                self.emit_tcp_exchanges(bus, [usize::from(server_first), usize::from(!server_first)]);
            }
            _ => {}
        }
    }
}
